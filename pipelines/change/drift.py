"""Lateral drift between two scans, sub-pixel, from high-passed relief and texture with robust weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt
from numba import njit

from ..scan import Scan
from ..slabs import in_slabs, side_by_side
from .bands import FINE_CELLS, band_passed
from .ranks import robust_sigma
from .turn import CLIP, Turn, turn_left

__all__ = [
    "REACH",
    "SAMPLED",
    "SIMILAR",
    "Drift",
    "Fit",
    "Pattern",
    "bands_of_baseline",
    "lateral_drift",
    "pattern_of",
    "refined",
    "residual_spread",
    "residuals_at",
    "step_for",
]

Floats = npt.NDArray[np.float32]

REACH = 0.1
"""No drift is sought beyond this share of the shorter side."""
ROUNDS = 40
"""Far starts creep, a part of a cell a round; near ones end after three or four."""
NEAR = 0.1
"""Steps below this, cells, that shrink by one factor from round to round begin a geometric series: its sum is gone at
once, but no further than this."""
STEADY = 0.2
"""And do so if they differ by no more than this share from what the factor says."""
STEP_CELLS, LARGEST_STEP = 300_000, 3
"""A map of so many cells is matched at every one of them, a larger one at every second or third each way: the fine
Gaussian makes some 13 neighbouring cells share their errors, so that the cells between tell next to nothing."""
SIMILAR = 1.5
"""Shares of cells explained within this factor do not tell two shifts apart."""
SAMPLED = 20_000
BY_CHANCE = 6.0
"""Correlation, in spreads of that at all shifts within reach, that no shift has by chance: the best of 10^5 has 4.3."""
ALIKE = 0.5
"""Nor this correlation itself: along ridges it hardly falls, and the spread of all shifts tells nothing."""


@dataclass(frozen=True, slots=True)
class Drift:
    """Where the baseline's cells are found in the scan: scan(x + dx, y + dy) looks like baseline(x, y)."""

    dx_mm: float
    dy_mm: float
    sigma_mm: float
    conditioning: float
    ambiguous: bool = False
    """Another shift explains nearly as much: a part of the surface moved, or the pattern repeats."""
    turn: Turn = field(default_factory=Turn)
    """What the scan is turned besides."""


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _normal_equations(  # type: ignore[no-untyped-def]  # numba infers the types from the arrays
    ref, gx, gy, mov, at_row, u, v, scale, step, residuals, first, last
):
    """Tukey-weighted Gauss-Newton sums over a slab of one channel: xx, xy, yy, xr, yr; keeps the residuals.

    A residual is mov(i + v, j + u) - ref(i, j), bilinear; NaN where anything is missing. Row i of `ref` is row
    `at_row[i]` of the map, its column j is column 1 + step j.
    """
    rows, columns = mov.shape
    a = int(np.floor(u))
    b = int(np.floor(v))
    fu = u - a
    fv = v - b
    axx = axy = ayy = bx = by = 0.0
    # the cells whose four neighbours in the moved map exist: 0 <= 1 + step j + a, 1 + step j + a + 1 < columns
    left = min(ref.shape[1], max(0, -((1 + a) // step)))
    right = min(ref.shape[1], max(left, (columns - 3 - a) // step + 1))
    for i in range(first, last):
        r = at_row[i] + b
        if r < 0 or r + 1 >= rows:
            residuals[i] = np.nan
            continue
        residuals[i, :left] = np.nan
        residuals[i, right:] = np.nan
        for j in range(left, right):
            c = 1 + step * j + a
            m = (1 - fv) * ((1 - fu) * mov[r, c] + fu * mov[r, c + 1]) + fv * (
                (1 - fu) * mov[r + 1, c] + fu * mov[r + 1, c + 1]
            )
            d = m - ref[i, j]
            residuals[i, j] = d
            e = d / (CLIP * scale)
            w = (1 - e * e) ** 2 if abs(e) < 1.0 else 0.0
            d = d if abs(e) < 1.0 else 0.0
            axx += w * gx[i, j] * gx[i, j]
            axy += w * gx[i, j] * gy[i, j]
            ayy += w * gy[i, j] * gy[i, j]
            bx += w * gx[i, j] * d
            by += w * gy[i, j] * d
    return axx, axy, ayy, bx, by


@njit(cache=True, nogil=True)
def _some(residuals, every, sample):  # type: ignore[no-untyped-def]  # as above
    """Every so-manieth known residual into `sample`; how many are known, and how many were kept."""
    count = 0
    kept = 0
    for i in range(residuals.shape[0]):
        row = residuals[i]
        left, right = 0, row.size
        while left < right and not abs(row[left]) < np.inf:
            left += 1
        while right > left and not abs(row[right - 1]) < np.inf:
            right -= 1
        known = 0
        for j in range(left, right):
            known += abs(row[j]) < np.inf
        ahead = (every - count % every) % every  # known ones to pass over before the next that is kept
        if known == right - left:
            for j in range(left + ahead, right, every):
                if kept < sample.size:
                    sample[kept] = row[j]
                    kept += 1
        else:
            for j in range(left, right):
                if abs(row[j]) < np.inf:
                    if ahead == 0 and kept < sample.size:
                        sample[kept] = row[j]
                        kept += 1
                    ahead = every - 1 if ahead == 0 else ahead - 1
        count += known
    return count, kept


def _bands(scan: Scan) -> list[Floats]:
    """Band-passed height and texture, each scaled to a robust spread of 1; NaN where not measured."""
    bands = []
    for band in band_passed(scan):
        spread = robust_sigma(band)
        # a channel without contrast says nothing about x or y
        bands.append(band * np.float32(1 / spread) if spread > 0 else np.full_like(band, np.nan))
    return bands


@lru_cache(maxsize=1)
def bands_of_baseline(baseline: Scan) -> list[Floats]:
    """Band-passed height and texture of a baseline, each scaled to a robust spread of 1."""
    # kept: the same baseline comes back with every scan of an epoch
    return _bands(baseline)


@dataclass(frozen=True, slots=True, eq=False)
class _Likeness:
    """Normalised cross-correlation of one channel at every shift of whole cells within reach; and its spread."""

    at: Floats
    spread: float

    @property
    def peak(self) -> tuple[int, int]:
        """(dx, dy) of the highest."""
        row, column = np.unravel_index(int(np.argmax(self.at)), self.at.shape)
        return int(column) - self.at.shape[1] // 2, int(row) - self.at.shape[0] // 2

    def stands_out(self, u: float, v: float) -> bool:
        """Whether a shift is more alike than chance makes one."""
        row, column = round(v) + self.at.shape[0] // 2, round(u) + self.at.shape[1] // 2
        around = self.at[max(0, row - 1) : max(0, row + 2), max(0, column - 1) : max(0, column + 2)]
        return float(around.max(initial=0.0)) >= min(ALIKE, BY_CHANCE * self.spread)


def _likeness(first: Floats, second: Floats, reach: int) -> _Likeness:
    from scipy import fft

    # apart from `put_back`: within reach nearly all cells overlap at every shift, so one norm serves for all of them,
    # and maps are padded by the reach alone; there overlaps differ, are counted by a third product, and padding is full
    shape = [fft.next_fast_len(n + reach, real=True) for n in first.shape]
    maps = [np.clip(np.nan_to_num(one), -3, 3) for one in (first, second)]
    a, b = (fft.rfft2(one, shape, workers=1) for one in maps)
    whole = fft.irfft2(np.conj(a) * b, shape, workers=1)
    whole /= max(1e-30, float(np.linalg.norm(maps[0]) * np.linalg.norm(maps[1])))
    at = np.roll(whole, (reach, reach), axis=(0, 1))[: 2 * reach + 1, : 2 * reach + 1]
    return _Likeness(at, robust_sigma(at))


def lateral_drift(scan: Scan, baseline: Scan, use: npt.NDArray[np.bool_]) -> Drift:
    """Find the lateral shift of the sample between two scans of one grid.

    Height and texture are band-passed (Gaussians of 1 and 8 cells), scaled to equal spread and matched by
    Gauss-Newton with Tukey weights (Lucas and Kanade 1981; Tukey's biweight), begun at no shift and at the
    peaks of the cross-correlation. The best counts; where two differ and are about as good, the smaller shift does,
    because a rig moves less than what it watches. Every step is against the fixed baseline.

    Parameters
    ----------
    scan, baseline : Scan
        On one grid.
    use : ndarray of bool, shape (rows, columns)
        Cells of the baseline that may be used: the stable areas, or everything.

    Returns
    -------
    Drift
        All NaN, with conditioning 0, where nothing has contrast or no shift is more alike than chance makes one.
    """
    grid = baseline.grid
    reach = max(2, round(REACH * min(grid.shape)))
    bands = side_by_side(lambda: bands_of_baseline(baseline), lambda: _bands(scan))
    channels = [pair for pair in zip(*bands, strict=True) if all(np.isfinite(band).any() for band in pair)]
    nothing = Drift(float("nan"), float("nan"), float("nan"), 0.0)
    if not channels or not use.any():
        return nothing
    sought = [partial(_likeness, np.where(use, ref, np.float32(np.nan)), mov, reach) for ref, mov in channels]
    alike = side_by_side(*sought)
    starts = {(0, 0), *(one.peak for one in alike)}
    count_used = int(use.sum())
    step = step_for(count_used)
    every = max(1, count_used // step**2 // SAMPLED)
    patterns = [pattern_of(ref, mov, use, step) for ref, mov in channels]
    fits = [refined(patterns, every, start) for start in sorted(starts)]
    found = [one for one in fits if one is not None and max(abs(one.u), abs(one.v)) <= 1.5 * reach]
    if not found:
        return nothing
    support = _support(found)
    good = [one for one, share in zip(found, support, strict=True) if share * SIMILAR >= support.max()]
    nearest = min(good, key=lambda one: np.hypot(one.u, one.v))
    # starts that end within a cell of each other are one shift, and the one that explains most is the one that arrived
    same = [k for k, one in enumerate(found) if np.hypot(one.u - nearest.u, one.v - nearest.v) <= 1.0]
    best = found[max(same, key=lambda k: float(support[k]))]
    if not any(one.stands_out(best.u, best.v) for one in alike):
        return nothing
    ambiguous = max(np.hypot(one.u - best.u, one.v - best.v) for one in good) > 1.0
    pitch = grid.pitch_mm
    turn = turn_left(patterns, [residual_spread(residuals) for residuals in best.residuals], best.u, best.v)
    return Drift(best.u * pitch, best.v * pitch, best.sigma * pitch, best.conditioning, bool(ambiguous), turn)


def step_for(cells: int) -> int:
    """Every so-manieth row and column of a map of so many cells is enough to match it."""
    return min(LARGEST_STEP, max(1, int(np.ceil(np.sqrt(cells / STEP_CELLS)))))


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """One shift in cells, and its residuals, a sample of each channel."""

    u: float
    v: float
    sigma: float
    conditioning: float
    residuals: tuple[npt.NDArray[np.float64], ...]


def _support(found: list[Fit]) -> npt.NDArray[np.float64]:
    """Share of cells that each shift explains, by one bound for all: 3 spreads of the shift that fits best."""
    support = np.zeros(len(found))
    for channel in zip(*(one.residuals for one in found), strict=True):
        bound = 3 * min(residual_spread(residuals) for residuals in channel)
        support += [float((np.abs(residuals) <= bound).mean()) for residuals in channel]
    return support


def residual_spread(residuals: npt.NDArray[np.float64]) -> float:
    """Standard deviation from the lower quartile of the sizes: right even where half of them are gross errors."""
    lower = (residuals.size - 1) // 4  # one rank alone is found several times as fast as a quantile between two
    return max(1e-6, float(np.partition(np.abs(residuals), lower)[lower]) / 0.31864)


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """One channel of some rows of a map and every `step`-th column, with its slopes; and where it is sought."""

    ref: Floats
    gx: Floats
    gy: Floats
    mov: Floats
    rows: npt.NDArray[np.intp]
    step: int


def pattern_of(ref: Floats, mov: Floats, use: npt.NDArray[np.bool_], step: int, top: int = 0) -> Pattern:
    """Every `step`-th cell within a stretch of rows of a map that begins at row `top`; `mov` is a whole map."""
    half = np.float32(0.5)
    inner = slice(1, -1, step)
    gx = half * (ref[inner, 2::step] - ref[inner, :-2:step])
    gy = half * (ref[2::step, inner] - ref[:-2:step, inner])
    held = use[inner, inner] & np.isfinite(gx) & np.isfinite(gy)
    return Pattern(
        np.where(held, ref[inner, inner], np.float32(np.nan)),
        np.where(held, gx, 0),
        np.where(held, gy, 0),
        mov,
        top + 1 + step * np.arange(len(gx)),
        step,
    )


def residuals_at(one: Pattern, every: int, u: float, v: float) -> npt.NDArray[np.float64]:
    """A sample of one channel's residuals at a shift."""
    residuals, sample = np.empty_like(one.ref), np.empty(SAMPLED)
    _sums(one, u, v, 1.0, residuals)
    return sample[: _some(residuals, every, sample)[1]]


def _sums(one: Pattern, u: float, v: float, scale: float, residuals: Floats) -> npt.NDArray[np.float64]:
    """`_normal_equations` over all rows."""
    slabs = in_slabs(
        one.ref.shape[0],
        lambda first, last: _normal_equations(
            one.ref, one.gx, one.gy, one.mov, one.rows, u, v, scale, one.step, residuals, first, last
        ),
    )
    return np.sum(slabs, axis=0)  # type: ignore[no-any-return]  # numba is untyped


def _series(before: npt.NDArray[np.float64] | None, move: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Go at once where steps lead that shrink by one factor (Aitken); the step itself where they do not.

    Weights that follow the residuals make the steps shrink slowly where much of the surface changed: by 0.92 a round
    on a soil whose plates curl.
    """
    if before is None or not before.any() or np.hypot(*move) > NEAR:
        return move
    factor = float(move @ before) / float(before @ before)
    if not 0 < factor < 1 or np.hypot(*(move - factor * before)) > STEADY * np.hypot(*move):
        return move
    return move * min(1 / (1 - factor), max(1.0, NEAR / float(np.hypot(*move))))


def refined(channels: Sequence[Pattern], every: int, start: tuple[float, float]) -> Fit | None:
    """Gauss-Newton from one start; None where it cannot be done."""
    u, v = float(start[0]), float(start[1])
    samples = [np.empty(SAMPLED) for _ in channels]
    residuals_of = [np.empty_like(one.ref) for one in channels]
    step = channels[0].step
    scales = [1.0 for _ in channels]
    before: npt.NDArray[np.float64] | None = None
    for turn in range(ROUNDS):
        total, right = np.zeros((2, 2)), np.zeros(2)
        residuals = []
        for index, one in enumerate(channels):
            axx, axy, ayy, bx, by = _sums(one, u, v, scales[index], residuals_of[index])
            count, kept = _some(residuals_of[index], every, samples[index])
            if count < 50:
                return None
            total += np.array([[axx, axy], [axy, ayy]]) / scales[index] ** 2
            right += np.array([bx, by]) / scales[index] ** 2
            residuals.append(samples[index][:kept])
            scales[index] = residual_spread(residuals[-1])
        if not np.isfinite(total).all() or np.linalg.det(total) <= 0:
            return None
        move = np.asarray(np.linalg.solve(total, right), dtype=np.float64)
        ahead = _series(before, move)
        leaps = ahead is not move
        before = None if leaps else move  # after a leap the next step tells nothing of the series
        length = float(np.hypot(*ahead))
        most = min(1.0, 1.0 / max(1e-12, length))  # at most one cell a round
        u, v = u - most * float(ahead[0]), v - most * float(ahead[1])
        if turn > 2 and length < (1e-4 if leaps else 1e-5):
            break
    singular = np.linalg.svd(total, compute_uv=False)
    # residuals share their errors over the smoothing's footprint (4 pi sigma^2 cells), so they count that much less;
    # 0.01 cell is what bilinear resampling leaves
    shared = max(1.0, 4 * np.pi * FINE_CELLS**2 / step**2)
    sigma = float(np.sqrt(shared / singular[-1] + 0.01**2))
    return Fit(u, v, sigma, float(singular[-1] / singular[0]), tuple(r.copy() for r in residuals))

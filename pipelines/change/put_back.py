"""Where a sample may lie that was put back by hand: any turn about the vertical, any shift, some tilt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..grid import Grid
from ..scan import LEVEL_NONE, Scan
from .bands import band_passed
from .blocks import block_means
from .motion import Motion
from .move import apply_motion
from .ranks import median, robust_sigma
from .stable import fit_plane, levelling

__all__ = ["place_put_back", "stands_out"]

Floats = npt.NDArray[np.float32]
Matrix = npt.NDArray[np.float64]

SIDE = 100
"""Places are sought on maps of about so many cells along the shorter side."""
FINER = 3
"""Point clouds have so many times as many points each way."""
TURN_STEP_DEG = 3.0
"""Half of it moves the corners of such a map by some two cells, which is as wide as its relief is fine."""
LEAST_OVERLAP = 0.3
LEAST_CELLS = 200
TRIED = 4
"""So many places that look alike are looked at closely."""
APART_CELLS, APART_STEPS = 12.0, 2
"""Places farther apart than one of these are different places; along a crack maps are alike a few cells off, too."""
NEIGHBOURS = 12
REACH_CELLS = 3.0
"""Points of two clouds that are farther apart are not the same point."""
SIMILAR = 1.5
"""Likenesses within this factor do not tell two places apart."""
LIKE = 7.0
"""Least likeness, in spreads of what chance gives: the best of the 10^6 places looked at has 5 to 6 by chance."""
LIKE_THERE = 5.0
"""The same of one given place."""


@dataclass(frozen=True, slots=True, eq=False)
class _Bands:
    """Band-passed height and texture of a map, each of spread 1 and 0 where not measured; and 1 where measured."""

    channels: tuple[Floats, ...]
    known: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """A motion and how alike the maps are after it."""

    matrix: Matrix
    like: float


def place_put_back(scan: Scan, baseline: Scan, about: Matrix | None = None) -> Matrix | None:
    """Find where in the baseline a scan lies whose sample was taken away and put back by hand.

    Band-passed relief and texture of coarse maps are correlated (FFT, all shifts) at every turn about the vertical. The
    most alike places are each the start of a generalised ICP (Segal, Haehnel and Thrun 2009; small_gicp) between point
    clouds, which finds tilt, turn, shift and lift together. It is no registration: register from there, and judge that.

    Parameters
    ----------
    scan, baseline : Scan
        On one grid.
    about : ndarray of float64, shape (4, 4), optional
        Where it lies but for some cells or a degree: it is sought nowhere else.

    Returns
    -------
    ndarray of float64, shape (4, 4), or None
        x_baseline = matrix @ x_scan, mm, right to some cells. None where nothing is more alike than by chance, or
        another place nearly as much; or where nothing is more alike than what is given.
    """
    side = max(1, round(min(baseline.grid.shape) / SIDE))
    known, seen = _coarse(baseline, side), _coarse(scan, side)
    ours, theirs = _bands(known), _bands(seen)
    if min(ours.known.sum(), theirs.known.sum()) < LEAST_CELLS:
        return None
    finer = max(1, side // FINER)
    clouds = _Clouds(_coarse(scan, finer), _coarse(baseline, finer))
    if about is not None:
        closer = clouds.aligned(about)
        before, after = (_likeness(matrix, seen, known.grid, ours) for matrix in (about, closer))
        return closer if after > before else None
    places, chance = _alike(theirs, ours, known.grid)
    found: list[_Place] = []
    for place in places:
        start = _raised(place, seen, known)
        each = [(_likeness(matrix, seen, known.grid, ours), matrix) for matrix in (start, clouds.aligned(start))]
        like, matrix = max(each, key=lambda one: one[0])
        found.append(_Place(matrix, like))
    if not found:
        return None
    best = max(found, key=lambda one: one.like)
    others = [one.like for one in found if _apart(one.matrix, best.matrix, known.grid)]
    return best.matrix if best.like >= max(LIKE * chance, SIMILAR * max(others, default=0.0)) else None


def stands_out(scan: Scan, baseline: Scan, matrix: Matrix) -> bool | None:
    """Whether a scan can be seen to lie where a motion brings it: no shift beside it makes the maps nearly as alike.

    Parameters
    ----------
    scan, baseline : Scan
        On one grid.
    matrix : ndarray of float64, shape (4, 4)

    Returns
    -------
    bool or None
        None where too little is measured to tell.
    """
    side = max(1, round(min(baseline.grid.shape) / SIDE))
    known = _coarse(baseline, side)
    ours, theirs = _bands(known), _bands(_moved(matrix, _coarse(scan, side), known.grid))
    if min(ours.known.sum(), theirs.known.sum()) < LEAST_CELLS:
        return None
    across = _Correlation(ours, theirs.known.shape)
    like = across.like(theirs)
    there = float(like[:2, :2].max(initial=max(like[0, -1], like[-1, 0], like[-1, -1], like[1, -1], like[-1, 1])))
    chance = robust_sigma(like)
    return bool(there >= max(LIKE_THERE * chance, SIMILAR * float(like[across.farther(0, 0)].max())))


def _coarse(scan: Scan, side: int) -> Scan:
    """Means over blocks of side x side cells; not measured where less than half of a block is."""
    if side == 1:
        return scan
    grid = scan.grid
    half = -(-side * side // 2)
    height = block_means(scan.height, side, half)
    texture = block_means(np.where(np.isfinite(scan.height), scan.texture, np.float32(np.nan)), side, half)
    enough = np.isfinite(height)
    middle = (side - 1) / 2 * grid.pitch_mm
    return Scan(
        Grid(height.shape[0], height.shape[1], grid.pitch_mm * side, grid.x0_mm + middle, grid.y0_mm + middle),
        scan.time,
        height,
        np.where(enough, np.float32(1), np.float32(np.nan)),
        np.rint(np.where(enough, texture, 0)).astype(np.uint8),
        np.where(enough, 0, LEVEL_NONE).astype(np.uint8),
    )


def _bands(scan: Scan) -> _Bands:
    known = np.isfinite(scan.height)
    channels = []
    for band in band_passed(scan):
        spread = robust_sigma(band)
        scaled = np.clip(band / spread, -3, 3) if spread > 0 else np.zeros_like(band)
        channels.append(np.where(known, scaled, 0).astype(np.float32))
    return _Bands(tuple(channels), known.astype(np.float32))


class _Correlation:
    """How alike a baseline is to other maps, of one shape, at all shifts at once (FFT)."""

    def __init__(self, ours: _Bands, shape: tuple[int, ...]) -> None:
        from scipy import fft

        self._shape = [fft.next_fast_len(n + m, real=True) for n, m in zip(ours.known.shape, shape, strict=True)]
        self._least = LEAST_OVERLAP * float(ours.known.sum())
        self._ours = [np.conj(each) for each in self._spectra(ours)]
        # row r of a correlation belongs to shift r, or to r less all rows where the other map lies to the other side
        rows, columns = (
            np.where(np.arange(n) < m, np.arange(n), np.arange(n) - n) for n, m in zip(self._shape, shape, strict=True)
        )
        self.down, self.right = rows[:, None], columns[None, :]

    def like(self, theirs: _Bands) -> npt.NDArray[np.float64]:
        """Sum of products over the root of the number of cells, by shift; -inf where too few overlap."""
        from scipy import fft

        *channels, known = (a * b for a, b in zip(self._ours, self._spectra(theirs), strict=True))
        count = fft.irfft2(known, self._shape, workers=1)
        total = fft.irfft2(sum(channels), self._shape, workers=1)
        return np.where(count >= self._least, total / np.sqrt(np.maximum(count, 1.0)), -np.inf)

    def farther(self, down: float, right: float) -> npt.NDArray[np.bool_]:
        """Which shifts are of other places."""
        found: npt.NDArray[np.bool_] = np.hypot(self.down - down, self.right - right) > APART_CELLS
        return found

    def _spectra(self, bands: _Bands) -> list[npt.NDArray[np.complex64]]:
        from scipy import fft

        return [fft.rfft2(each, self._shape, workers=1) for each in (*bands.channels, bands.known)]


def _alike(theirs: _Bands, ours: _Bands, grid: Grid) -> tuple[list[_Place], float]:
    """The most alike places of a coarse scan in a baseline, and the spread of likenesses by chance."""
    from scipy import ndimage

    wide = int(np.ceil(np.hypot(*theirs.known.shape)))
    across = _Correlation(ours, (wide, wide))
    centre = (np.array(theirs.known.shape) - 1) / 2
    spreads, peaks = [], []
    for turn in np.deg2rad(np.arange(0, 360, TURN_STEP_DEG)):
        c, s = np.cos(turn), np.sin(turn)
        back = np.array([[c, -s], [s, c]])
        offset = centre - back @ [(wide - 1) / 2, (wide - 1) / 2]
        *channels, known = (
            ndimage.affine_transform(each, back, offset, (wide, wide), order=1)
            for each in (*theirs.channels, theirs.known)
        )
        like = across.like(_Bands(tuple(channels), known))
        spreads.append(robust_sigma(like))
        for _ in range(2):
            row, column = np.unravel_index(int(np.argmax(like)), like.shape)
            if not np.isfinite(like[row, column]):
                break
            down, right = across.down[row, 0], across.right[0, column]
            peaks.append(_Place(_matrix(turn, down, right, wide, grid), float(like[row, column])))
            like[~across.farther(down, right)] = -np.inf
    chance = float(np.median(spreads))
    kept: list[_Place] = []
    for one in sorted(peaks, key=lambda peak: -peak.like):
        if len(kept) < TRIED and all(_apart(one.matrix, other.matrix, grid) for other in kept):
            kept.append(one)
    return kept if chance > 0 else [], chance


def _matrix(turn: float, down: float, right: float, wide: int, grid: Grid) -> Matrix:
    """The motion of a scan that was turned about its middle, onto a square map, and then lies so many cells off."""
    c, s = np.cos(turn), np.sin(turn)
    matrix = np.eye(4)
    matrix[:2, :2] = [[c, -s], [s, c]]
    matrix[:2, 3] = np.array([grid.x0_mm, grid.y0_mm]) + grid.pitch_mm * ((wide - 1) / 2 - np.array([right, down]))
    matrix[:2, 3] -= matrix[:2, :2] @ _middle(grid)
    return matrix


def _middle(grid: Grid) -> npt.NDArray[np.float64]:
    return np.array([grid.x_mm.mean(), grid.y_mm.mean()])


def _apart(one: Matrix, other: Matrix, grid: Grid) -> bool:
    """Whether two motions bring the middle of the map to different places, or turn it differently."""
    x, y = ((one - other) @ [*_middle(grid), 0.0, 1.0])[:2]
    turns = one[:2, :2] @ other[:2, :2].T
    steps = abs(np.rad2deg(np.arctan2(turns[1, 0], turns[0, 0]))) / TURN_STEP_DEG
    return bool(np.hypot(x, y) > APART_CELLS * grid.pitch_mm or steps > APART_STEPS)


def _moved(matrix: Matrix, scan: Scan, grid: Grid) -> Scan:
    return apply_motion(scan, Motion.guess(matrix), grid)


def _likeness(matrix: Matrix, scan: Scan, grid: Grid, ours: _Bands) -> float:
    """How alike the maps are where they overlap after a motion: as the correlation counts it."""
    theirs = _bands(_moved(matrix, scan, grid))
    both = float((theirs.known * ours.known).sum())
    if both < LEAST_OVERLAP * float(ours.known.sum()):
        return 0.0
    return sum(float((a * b).sum()) for a, b in zip(theirs.channels, ours.channels, strict=True)) / float(np.sqrt(both))


def _raised(place: _Place, scan: Scan, baseline: Scan) -> Matrix:
    """A place with the plane of dz taken out."""
    grid = baseline.grid
    dz = _moved(place.matrix, scan, grid).height - baseline.height
    rows, columns = np.nonzero(np.isfinite(dz))
    plane = fit_plane(grid.x_mm[columns], grid.y_mm[rows], dz[rows, columns].astype(np.float64))
    return place.matrix if plane is None else levelling(plane, median(baseline.height)) @ place.matrix


class _Clouds:
    """The points of a scan and of its baseline, and small_gicp's tree over them."""

    def __init__(self, scan: Scan, baseline: Scan) -> None:
        self._reach = REACH_CELLS * baseline.grid.pitch_mm
        self._scan, _ = _cloud(scan)
        self._baseline, self._tree = _cloud(baseline)

    def aligned(self, start: Matrix) -> Matrix:
        import small_gicp

        found = small_gicp.align(
            self._baseline, self._scan, self._tree, start, max_correspondence_distance=self._reach, max_iterations=20
        )
        return np.asarray(found.T_target_source, dtype=np.float64)


def _cloud(scan: Scan) -> tuple[Any, Any]:
    import small_gicp

    rows, columns = np.nonzero(np.isfinite(scan.height))
    grid = scan.grid
    points = np.stack([grid.x_mm[columns], grid.y_mm[rows], scan.height[rows, columns].astype(np.float64)], axis=1)
    cloud = small_gicp.PointCloud(points)
    tree = small_gicp.KdTree(cloud)
    small_gicp.estimate_normals_covariances(cloud, tree, NEIGHBOURS)
    return cloud, tree

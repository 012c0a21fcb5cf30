"""Sub-pixel positions: pattern minus inverse crosses zero at the edges of a cell; between them it is linear."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numba as nb
import numpy as np
import numpy.typing as npt

from .codebook import Codebook
from .decode import decode, frame_indices, frame_of, noise_counts
from .frames import Frames
from .patterns import AXES
from .pixel_maps import Decoded

__all__ = ["locate", "refine"]

REACH = 96  # camera px: between edges further apart nothing is known to be linear
# What the frames' noise does not explain, projector px: flicker of the light leaves FLAT_PX, and a straight line
# through an edge that is not straight BENT_PX times the square of projector px per camera px (cells that the camera
# hardly resolves; of the whole capture: the local one is measured between the very edges that may be misplaced).
# Read off a rendered capture with known answers.
FLAT_PX, BENT_PX = 0.02, 0.12
# How far a pixel is off, of the bend of the map over one cell to either side: sqrt(1/120) of it where the surface
# bends (the mean of a parabola's distance from its chord), half of it where an edge is misplaced (then the errors of
# four edges make the bend, and those of the inner two the pixel's). Which it is cannot be told: their geometric mean.
BEND = 0.21


def locate(frames: Frames) -> Decoded:
    """Decode a capture and place each pixel within its cell: `decode`, then `refine`."""
    return refine(frames, decode(frames))


def refine(frames: Frames, decoded: Decoded) -> Decoded:
    """Place each decoded pixel within its cell.

    Along the image direction in which an axis grows faster, the two edges of the pixel's cell are where the bit that
    flips there crosses zero, to a fraction of a camera pixel; between them the position is linear. Pixels without an
    edge on both sides keep the middle of their cell and its sigma. Stripes and phase
    sets are placed by `decode` already and left alone.

    Parameters
    ----------
    frames : Frames
    decoded : Decoded
        Of these frames.

    Returns
    -------
    Decoded
    """
    patterns = frames.patterns
    if patterns.kind != "gray":
        return decoded
    bits, plus, minus = frame_indices(patterns)
    stack = np.ascontiguousarray(frames.stack)
    noise = max(noise_counts(frames), 0.29) * (np.sqrt(2) if patterns.complementary else np.sqrt(6))

    def along(axis: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        places = (decoded.column, decoded.sigma_column), (decoded.row, decoded.sigma_row)
        place, sigma = places[axis]
        if not bits[axis]:
            return place, sigma
        book = patterns.codebook(AXES[axis])
        fine, spread = np.empty_like(place), np.empty_like(sigma)
        down, density = _runs(place)
        flat = np.hypot(FLAT_PX, BENT_PX * density**2)
        _between_edges(
            stack,
            frame_of(patterns, "white"),
            frame_of(patterns, "black"),
            plus[axis],
            minus[axis],
            int(bits[axis]),
            book.word,
            book.first.astype(np.float32) - np.float32(0.5),
            _cells(place, book, patterns.size[axis]),
            down,
            noise,
            flat,
            place,
            sigma,
            fine,
            spread,
        )
        _add_bend(fine, spread, down, max(1, min(round(1 / max(density, 1e-3)), REACH)))
        return fine, spread

    with ThreadPoolExecutor(2) as pool:  # the axes know nothing of each other
        both = list(pool.map(along, range(2)))
    (column, sigma_column), (row, sigma_row) = both
    return replace(decoded, column=column, row=row, sigma_column=sigma_column, sigma_row=sigma_row)


def _cells(place: npt.NDArray[np.float32], book: Codebook, length: int) -> npt.NDArray[np.int32]:
    """Cell of each pixel, -1 where it was not decoded."""
    of_px = np.zeros(length, np.int32)
    of_px[book.first] = 1
    cell = np.empty(place.shape, np.int32)
    _look_up(place.reshape(-1), np.cumsum(of_px, dtype=np.int32) - np.int32(1), cell.reshape(-1))
    return cell


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _look_up(place, of_px, cell):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    for n in range(place.size):
        at = place[n]
        cell[n] = of_px[np.int64(at)] if at == at else np.int32(-1)


def _runs(place: npt.NDArray[np.float32]) -> tuple[bool, float]:
    """Whether an axis grows faster down the image than along its rows, and by how many px per camera px."""
    steps = [max(1, side // 200) for side in place.shape]
    coarse = place[:: steps[0], :: steps[1]]
    growth = []
    for axis in (1, 0):
        change = np.abs(np.diff(coarse, axis=axis))
        change = change[np.isfinite(change)]
        if len(change):  # whole cells: a mean and no median, but without the edges of surfaces
            change = change[change <= np.quantile(change, 0.98)]
        growth.append(float(change.mean()) / steps[axis] if len(change) else 0.0)
    return growth[1] > growth[0], max(growth)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _edge(stack, white, black, plus, minus, bits, flips, a, b, c, d):  # type: ignore[no-untyped-def]  # numba infers
    """Where between pixel (a, b), 0, and its neighbour (c, d), 1, the bits in `flips` cross zero; -1 if none does."""
    total, inverse, count = 0.0, 0.0, 0
    for bit in range(bits):
        if (flips >> (bits - 1 - bit)) & 1:
            p = float(stack[plus[bit], a, b])
            q = float(stack[plus[bit], c, d])
            if minus[bit] >= 0:
                p -= float(stack[minus[bit], a, b])
                q -= float(stack[minus[bit], c, d])
            else:
                p = 2 * p - float(stack[white, a, b]) - float(stack[black, a, b])
                q = 2 * q - float(stack[white, c, d]) - float(stack[black, c, d])
            if (p > 0) != (q > 0):
                total += p / (p - q)
                inverse += 1 / abs(p - q)
                count += 1
    if count == 0:
        return -1.0, 0.0
    return total / count, inverse / count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _between_edges(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    stack, white, black, plus, minus, bits, word, edge, cell, down, noise, flat, place, sigma, fine, spread
):
    """Run along each line, remember the edge behind, and fill a run of one cell when its far edge is met.

    Lines are the image's rows, or its columns if `down`; both are visited row by row, as memory lies.
    """
    H, W = cell.shape
    lines = W if down else H
    start = np.zeros(lines, np.int32)  # first pixel of the run that each line is in
    known = np.zeros(lines, np.bool_)  # whether the edge behind it is
    behind, value_behind, error_behind = np.zeros(lines), np.zeros(lines), np.zeros(lines)
    for i in range(H):
        for j in range(W):
            fine[i, j] = place[i, j]
            spread[i, j] = sigma[i, j]
            line, at = (j, i) if down else (i, j)
            if at == 0:
                continue
            a, b = (i - 1, j) if down else (i, j - 1)
            k, n = cell[a, b], cell[i, j]
            if k == n:
                continue
            jump = n - k
            if k < 0 or n < 0 or jump < -2 or jump > 2:
                start[line], known[line] = at, False
                continue
            step = 1 if jump > 0 else -1
            position, inverse = _edge(stack, white, black, plus, minus, bits, word[k] ^ word[k + step], a, b, i, j)
            if known[line] and position >= 0 and at - start[line] <= REACH:
                value = edge[max(k, k + step)]
                if value != value_behind[line]:
                    length = at - 1 + position - behind[line]
                    slope = (value - value_behind[line]) / length
                    for m in range(start[line], at):
                        share = (m - behind[line]) / length
                        e0 = (1 - share) * error_behind[line] * slope
                        e1 = share * noise * inverse * slope
                        r, c = (m, j) if down else (i, m)
                        fine[r, c] = value_behind[line] + share * (value - value_behind[line])
                        spread[r, c] = np.sqrt(e0 * e0 + e1 * e1 + flat * flat)
            if jump != step:  # the camera skips a cell: the edge behind the next run is another one
                position, inverse = _edge(stack, white, black, plus, minus, bits, word[n] ^ word[n - step], a, b, i, j)
            start[line], known[line] = at, position >= 0
            behind[line], error_behind[line] = at - 1 + position, noise * inverse
            value_behind[line] = edge[max(n, n - step)]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _add_bend(fine, spread, down, cells):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Add to `spread` what the bend of `fine` over `cells` camera px to either side says."""
    H, W = fine.shape
    a, b = (cells, 0) if down else (0, cells)
    share = np.float32(BEND * BEND)
    for i in range(a, H - a):
        before, here, after, error = fine[i - a], fine[i], fine[i + a], spread[i]
        for j in range(b, W - b):
            bend = before[j - b] - 2 * here[j] + after[j + b]
            more = share * bend * bend
            # beyond a cell it is no bend but an edge of the surface; NaN is neither
            error[j] = np.sqrt(error[j] * error[j] + (more if abs(bend) < np.float32(1) else np.float32(0)))

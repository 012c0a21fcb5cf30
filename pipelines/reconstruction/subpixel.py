"""Sub-pixel positions: pattern minus inverse crosses zero at the edges of a cell; between them it is linear."""

from __future__ import annotations

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

REACH = 48  # camera px: an edge further away tells nothing about this pixel
# What the frames' noise does not explain, projector px: flicker of the light leaves FLAT_PX, and a straight line
# through an edge that is not straight BENT_PX times the square of projector px per camera px (cells that the camera
# hardly resolves). Read off a rendered capture with known answers.
FLAT_PX, BENT_PX = 0.02, 0.12


def locate(frames: Frames) -> Decoded:
    """Decode a capture and place each pixel within its cell: `decode`, then `refine`."""
    return refine(frames, decode(frames))


def refine(frames: Frames, decoded: Decoded) -> Decoded:
    """Place each decoded pixel within its cell.

    Along the image direction in which an axis grows faster, the two edges of the pixel's cell are where the bit that
    flips there crosses zero, to a fraction of a camera pixel; between them the position is linear. Pixels without an
    edge on both sides keep the middle of their cell and its sigma. Phase sets have no cells and are left alone.

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
    if patterns.kind == "phase":
        return decoded
    bits, plus, minus = frame_indices(patterns)
    stack = np.ascontiguousarray(frames.stack)
    noise = max(noise_counts(frames), 0.29) * (np.sqrt(2) if patterns.complementary else np.sqrt(6))
    both = []
    for axis, place, sigma in (
        (0, decoded.column, decoded.sigma_column),
        (1, decoded.row, decoded.sigma_row),
    ):
        if not bits[axis]:
            both.append((place, sigma))
            continue
        book = patterns.codebook(AXES[axis])
        cell = _cells(place, book, patterns.size[axis])
        fine, spread = np.empty_like(place), np.empty_like(sigma)
        _between_edges(
            stack,
            frame_of(patterns, "white"),
            frame_of(patterns, "black"),
            plus[axis],
            minus[axis],
            int(bits[axis]),
            book.word,
            book.first.astype(np.float32) - np.float32(0.5),
            cell,
            _runs_down(place),
            noise,
            place,
            sigma,
            fine,
            spread,
        )
        both.append((fine, spread))
    (column, sigma_column), (row, sigma_row) = both
    return replace(decoded, column=column, row=row, sigma_column=sigma_column, sigma_row=sigma_row)


def _cells(place: npt.NDArray[np.float32], book: Codebook, length: int) -> npt.NDArray[np.int32]:
    """Cell of each pixel, -1 where it was not decoded."""
    of_px = np.zeros(length, np.int32)
    of_px[book.first] = 1
    of_px = np.cumsum(of_px, dtype=np.int32) - 1
    known = np.isfinite(place)
    return np.where(known, of_px[np.where(known, place, 0).astype(np.int32)], -1).astype(np.int32)


def _runs_down(place: npt.NDArray[np.float32]) -> bool:
    """Whether an axis grows faster down the image than along its rows."""
    coarse = place[:: max(1, place.shape[0] // 200), :: max(1, place.shape[1] // 200)]
    along, down = np.abs(np.diff(coarse, axis=1)), np.abs(np.diff(coarse, axis=0))
    along, down = along[np.isfinite(along)], down[np.isfinite(down)]
    if not len(along) or not len(down):
        return False
    stretch = max(1, place.shape[1] // 200) / max(1, place.shape[0] // 200)
    return bool(np.median(down) * stretch > np.median(along))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _between_edges(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    stack, white, black, plus, minus, bits, word, edge, cell, down, noise, place, sigma, fine, spread
):
    H, W = cell.shape
    di, dj = (1, 0) if down else (0, 1)
    at = np.empty(2, np.float64)
    value = np.empty(2, np.float64)
    error = np.empty(2, np.float64)
    for i in range(H):
        for j in range(W):
            fine[i, j] = place[i, j]
            spread[i, j] = sigma[i, j]
            k = cell[i, j]
            if k < 0:
                continue
            found = 0
            for side in range(2):
                step = 2 * side - 1
                a, b = i, j
                n = 0
                while n < REACH:
                    c, d = a + step * di, b + step * dj
                    if c < 0 or d < 0 or c >= H or d >= W or cell[c, d] != k:
                        break
                    a, b = c, d
                    n += 1
                c, d = a + step * di, b + step * dj
                if n == REACH or c < 0 or d < 0 or c >= H or d >= W or cell[c, d] < 0:
                    break
                jump = cell[c, d] - k
                if jump < -2 or jump > 2:
                    break
                beside = k + 1 if jump > 0 else k - 1
                flips = word[k] ^ word[beside]
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
                    break
                at[side] = step * (n + total / count)
                error[side] = noise * inverse / count
                value[side] = edge[max(k, beside)]
                found += 1
            if found == 2 and value[0] != value[1]:
                length = at[1] - at[0]
                share = -at[0] / length
                slope = (value[1] - value[0]) / length
                fine[i, j] = value[0] + share * (value[1] - value[0])
                e0, e1 = (1 - share) * error[0] * slope, share * error[1] * slope
                spread[i, j] = np.sqrt(e0 * e0 + e1 * e1 + FLAT_PX * FLAT_PX + (BENT_PX * slope * slope) ** 2)

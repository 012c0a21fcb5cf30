"""Did the image move during the capture? Pattern plus inverse is white plus black, unless it lies elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .diagnose_order import pairs_of
from .diagnose_sample import Sample, quantile

__all__ = ["Motion2D", "image_motion"]

Doubles = npt.NDArray[np.float64]
Floats = npt.NDArray[np.float32]

FEW = 256
COARSE_PX = 0.7
"""From here on the linear fit falls short and whole shifts are tried."""
REACH_PX = 6
CLEAR_PEAK = 8.0
"""Standard deviations of a correlation: noise alone reaches 4 to 5 in a tile, an image that moved far more."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion2D:
    """Where the image of each group of frames lies against that of the white and the black frame.

    Parameters
    ----------
    frames : tuple of tuple of int
        The frames of each group: a pattern and its inverse, or all steps of a phase.
    shift_px : ndarray, shape (group, 2)
        Along columns, rows; camera px.
    sigma_px : ndarray, shape (group,)
        Standard deviation of the larger of the two.
    """

    frames: tuple[tuple[int, ...], ...]
    shift_px: Doubles
    sigma_px: Doubles


def image_motion(sample: Sample) -> Motion2D:
    """Measure by how much each group of frames lies beside the white and the black frame.

    The mean of a group is the mean of white and black. A shift d changes it by -d times the gradient of the image;
    d is fitted, together with the light's flicker, by least squares over the lit pixels.

    Parameters
    ----------
    sample : Sample
        Of a capture whose frames are in order.

    Returns
    -------
    Motion2D
        Without groups where nothing can be told: no inverses, or an image without texture.
    """
    groups = _groups(sample)
    white = next(n for n, role in enumerate(sample.roles) if role.what == "white")
    black = next(n for n, role in enumerate(sample.roles) if role.what == "black")
    tiles = sample.tiles
    if min(tiles.shape[2:]) < 2 * REACH_PX + 4:
        return Motion2D((), np.zeros((0, 2)), np.zeros(0))
    still = (tiles[white] + tiles[black]) / 2
    mean = tiles.mean(axis=0)  # quiet enough for a gradient
    inner = (slice(None), slice(1, -1), slice(1, -1))
    along_x = (mean[:, 1:-1, 2:] - mean[:, 1:-1, :-2]) / 2
    along_y = (mean[:, 2:, 1:-1] - mean[:, :-2, 1:-1]) / 2
    usable = sample.lit[inner] & (np.hypot(along_x, along_y) < 0.5 * sample.swing[inner])  # no walls and no glints
    usable[..., ::2] = False  # half of them tell enough
    if usable.sum() < FEW:
        return Motion2D((), np.zeros((0, 2)), np.zeros(0))
    at = np.flatnonzero(np.pad(usable, ((0, 0), (1, 1), (1, 1))))
    pixels = tiles.reshape(len(tiles), -1)[:, at]
    base = still.ravel()[at]
    # shadow edges and texture count alike; the pattern's own edges are in the gradient of no group
    columns = np.empty((5, at.size), np.float32)
    columns[0], columns[1] = along_x[usable], along_y[usable]
    columns[2], columns[3] = sample.swing.ravel()[at], 1
    shifts, sigmas, kept = [], [], []
    for group in groups:
        columns[4] = pixels[group[0]] - pixels[group[1]]
        shift, sigma = _fit(columns, _mean(pixels, group) - base)
        if np.abs(shift).max() > COARSE_PX or sigma > COARSE_PX / 8:
            whole = _whole_shift(still, _mean(tiles, group))
            if np.abs(whole).max() > max(1.0, float(np.abs(shift).max())):
                shift = whole
        shifts.append(shift)
        sigmas.append(sigma)
        kept.append(group)
    return Motion2D(tuple(kept), np.array(shifts).reshape(-1, 2), np.array(sigmas))


def _mean(frames: Floats, group: tuple[int, ...]) -> Floats:
    total = frames[group[0]] + frames[group[1]]
    for more in group[2:]:
        total += frames[more]
    return np.asarray(total / np.float32(len(group)), np.float32)


def _groups(sample: Sample) -> list[tuple[int, ...]]:
    groups: list[tuple[int, ...]] = [(p, n) for _, _, p, n in pairs_of(sample.patterns) if n >= 0]
    for axis in ("columns", "rows"):
        steps = [n for n, role in enumerate(sample.roles) if role.what == "phase" and role.axis == axis]
        if steps:
            groups.append(tuple(steps))
    return sorted(groups)


def _fit(columns: Floats, value: Floats) -> tuple[Doubles, float]:
    """Shift and its standard deviation, px; pixels that fit badly are left out once."""
    normal = (columns @ columns.T).astype(np.float64)
    normal += np.eye(len(normal)) * 1e-9 * float(np.trace(normal))
    found = np.linalg.solve(normal, (columns @ value).astype(np.float64))
    rest = value - found @ columns
    size = np.abs(rest)
    near = size < 4 * max(1.4826 * quantile(size), 0.3)
    columns, value = columns * near, value * near
    normal = (columns @ columns.T).astype(np.float64)
    normal += np.eye(len(normal)) * 1e-9 * float(np.trace(normal))
    inverse = np.linalg.inv(normal)
    found = inverse @ (columns @ value).astype(np.float64)
    rest = value - found @ columns
    sigma = np.sqrt(float(rest @ rest) / np.count_nonzero(near) * np.diag(inverse)[:2].max())
    return np.asarray(-found[:2], np.float64), float(sigma)


def _whole_shift(still: Floats, moved: Floats) -> Doubles:
    """Shift in whole px by the cross-correlation of all tiles, edges and slow shading taken out."""
    window = np.outer(np.hanning(still.shape[1]), np.hanning(still.shape[2]))
    spectra = [np.fft.rfft2((image - image.mean(axis=(1, 2), keepdims=True)) * window) for image in (still, moved)]
    cross = (spectra[1] * np.conj(spectra[0])).sum(axis=0)
    peak = np.fft.irfft2(cross / np.maximum(np.abs(cross), 1e-9), s=still.shape[1:])
    if peak.max() < CLEAR_PEAK * peak.std():
        return np.zeros(2)  # no texture: the highest place is noise
    rows, columns = still.shape[1:]
    y, x = np.unravel_index(int(np.argmax(peak)), peak.shape)
    shift = np.array([(x + columns // 2) % columns - columns // 2, (y + rows // 2) % rows - rows // 2], float)
    return shift if np.abs(shift).max() <= REACH_PX else np.zeros(2)

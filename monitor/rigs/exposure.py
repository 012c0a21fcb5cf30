"""From a view to frames: patterns through the projector's blur, the camera's blur, light, noise and 8 bits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.ndimage import gaussian_filter1d

from pipelines import PatternSet

from .optics_model import Optics
from .ray_march import View

__all__ = ["Light", "Profiles", "expose", "profiles"]

OVERSAMPLING = 8
MARGIN = 4  # projector px beyond either end, dark
LEVELS = 14
DEFOCUS_MM = 3.5  # defocus of the last level; what is farther out blurs like it
PROJECTOR_BLUR_PX = 0.40
CAMERA_BLUR_PX = 0.45
LEAK = 0.012  # a black mirror's share of a white one's light
FULL_WELL = 9000.0  # electrons at 255
READ_NOISE = 0.6  # grey values
BLACK_LEVEL = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Profiles:
    """Each pattern as a blurred line along its axis.

    Parameters
    ----------
    tables : ndarray of float32, shape (frame, level, sample)
        Light, 0 to 1; `level` counts defocus, sample s is projector pixel s / OVERSAMPLING - MARGIN.
    along_rows : ndarray of bool, shape (frame,)
        Whether the pattern varies along the projector's rows.
    """

    tables: npt.NDArray[np.float32]
    along_rows: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """Power of projector and room in each frame, grey values at albedo 1, shape (frame,)."""

    projector: npt.NDArray[np.float32]
    room: npt.NDArray[np.float32]


def profiles(patterns: PatternSet, optics: Optics) -> Profiles:
    """Blur each pattern for each level of defocus.

    A defocus of z makes a disc of diameter 2 z NA; a Gaussian of its standard deviation (a quarter of the diameter)
    stands for it, on top of `PROJECTOR_BLUR_PX` for the lens itself.
    """
    images = patterns.images()
    projector = optics.projector
    defocus = np.linspace(0, DEFOCUS_MM, LEVELS)
    longest = max(patterns.size) + 2 * MARGIN
    tables = np.zeros((len(images), LEVELS, longest * OVERSAMPLING), np.float32)
    along_rows = np.array([role.axis == "rows" for role in patterns.roles])
    for frame, image in enumerate(images):
        line = image[:, 0] if along_rows[frame] else image[0, :]
        fine = np.repeat(np.pad(line.astype(np.float32) / 255, MARGIN), OVERSAMPLING)
        focal = projector.lens.K[1, 1] if along_rows[frame] else projector.lens.K[0, 0]
        for level, out_of_focus in enumerate(defocus):
            disc_px = out_of_focus * projector.aperture / 2 * focal / projector.focus_mm
            sigma = np.hypot(PROJECTOR_BLUR_PX, disc_px) * OVERSAMPLING
            tables[frame, level, : fine.size] = gaussian_filter1d(fine, sigma, mode="nearest", truncate=3.5)
    return Profiles(tables, along_rows)


def expose(
    view: View,
    optics: Optics,
    lines: Profiles,
    light: Light,
    noise: npt.NDArray[np.float32],
    start: int,
    frames: npt.NDArray[np.uint8],
) -> None:
    """Take the frames.

    Parameters
    ----------
    view : View
    optics : Optics
    lines : Profiles
    light : Light
    noise : ndarray of float32, shape (n,)
        Standard normal numbers, n a power of two well above a row; each row of each frame reads on from another place.
    start : int
        Where the first row reads.
    frames : ndarray of uint8, shape (frame, row, column)
        Is filled.
    """
    camera, projector = optics.camera, optics.projector
    off_projector = np.abs(view.depth_projector - projector.focus_mm)
    level = np.minimum(np.rint(off_projector * ((LEVELS - 1) / DEFOCUS_MM)), LEVELS - 1).astype(np.int32)
    samples = lines.tables.shape[2]
    places = []
    for position in (view.column, view.row):
        sample = np.clip((position + (MARGIN + 0.5)) * OVERSAMPLING - 0.5, 0, samples - 2).astype(np.float32)
        whole = sample.astype(np.int32)
        places.append((whole + level * samples, sample - whole))
    disc_px = np.abs(view.depth_camera - camera.focus_mm) * (
        camera.aperture / 2 * camera.lens.K[0, 0] / camera.focus_mm
    )
    variance = CAMERA_BLUR_PX**2 + disc_px**2
    passes = max(1, int(np.ceil(float(variance.max()) / 0.6)))
    side = (variance / (2 * passes)).astype(np.float32)  # a kernel (w, 1-2w, w) has variance 2 w
    (column, column_part), (row, row_part) = places
    _expose(
        lines.tables.reshape(len(lines.tables), -1),
        lines.along_rows,
        column,
        column_part,
        row,
        row_part,
        view.lit,
        view.ambient,
        side,
        passes,
        light.projector,
        light.room,
        noise,
        start,
        frames,
    )


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _expose(  # type: ignore[no-untyped-def]  # numba infers
    tables,
    along_rows,
    column,
    column_part,
    row,
    row_part,
    lit,
    ambient,
    side,
    passes,
    power,
    room,
    noise,
    start,
    frames,
):
    rows, columns = lit.shape
    image = np.empty((rows, columns), np.float32)
    spare = np.empty((rows, columns), np.float32)
    shot = np.float32(255.0 / FULL_WELL)
    read = np.float32(READ_NOISE**2)
    black = np.float32(BLACK_LEVEL)
    leak = np.float32(LEAK)
    half = np.float32(0.5)
    mask = len(noise) - 1
    place = start
    for f in range(len(tables)):
        table = tables[f]
        where = row if along_rows[f] else column
        part = row_part if along_rows[f] else column_part
        strong = power[f]
        dim = room[f]
        for r in range(rows):
            for c in range(columns):
                s = where[r, c]
                pattern = table[s] + part[r, c] * (table[s + 1] - table[s])
                image[r, c] = strong * lit[r, c] * (leak + (np.float32(1.0) - leak) * pattern) + dim * ambient[r, c]
        for _ in range(passes):
            for r in range(rows):
                spare[r, 0] = image[r, 0]
                spare[r, columns - 1] = image[r, columns - 1]
                for c in range(1, columns - 1):
                    mid = image[r, c]
                    spare[r, c] = mid + side[r, c] * (image[r, c - 1] + image[r, c + 1] - mid - mid)
            for r in range(rows):
                up = max(r - 1, 0)
                down = min(r + 1, rows - 1)
                for c in range(columns):
                    mid = spare[r, c]
                    image[r, c] = mid + side[r, c] * (spare[up, c] + spare[down, c] - mid - mid)
        for r in range(rows):
            place = (place * 1103515245 + 12345) & mask  # another stretch of the noise for every row
            first = min(place, mask + 1 - columns)
            for c in range(columns):
                clean = image[r, c]
                grey = clean + black + noise[first + c] * np.sqrt(shot * max(clean, np.float32(0.0)) + read) + half
                frames[f, r, c] = np.uint8(min(max(grey, np.float32(0.0)), np.float32(255.0)))

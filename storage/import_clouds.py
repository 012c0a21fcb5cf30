"""Clouds of points laid onto cells: PLY, LAS and LAZ, and text of x y z."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from configs import InputError, MicroreliefError
from pipelines import Grid, Instant, parse_instant

from .raster import Raster

__all__ = ["Cloud", "gridded", "las", "ply", "xyz"]

MOST_CELLS = 100_000_000
Cloud = tuple[npt.NDArray[np.float64], Instant | None]
"""Points of shape (point, 3), in the file's unit, and when they were taken, where the file says so."""


def gridded(points: npt.NDArray[np.float64], path: Path, grid: Grid | None, pitch_mm: float | None) -> Raster:
    """Lay points onto cells: a cell's height is the mean of the points in it, its sigma their standard error.

    Parameters
    ----------
    points : ndarray of float64, shape (point, 3)
        mm.
    path : Path
        Named in messages.
    grid : Grid or None
        Where the cells are; without one they cover the points.
    pitch_mm : float or None
        Side of a cell of a grid that covers the points; without it the spacing at which a cell holds one point.

    Returns
    -------
    Raster
        NaN where no point fell; sigma NaN where fewer than three did.
    """
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        raise InputError(f"{path}: holds no point")
    if grid is None:
        grid = _covering(points, path, pitch_mm)
    column = np.rint((points[:, 0] - grid.x0_mm) / grid.pitch_mm).astype(np.int64)
    row = np.rint((points[:, 1] - grid.y0_mm) / grid.pitch_mm).astype(np.int64)
    inside = (row >= 0) & (row < grid.rows) & (column >= 0) & (column < grid.columns)
    if not inside.any():
        raise InputError(f"{path}: none of its {len(points)} points lies in the store's cells: are its units mm?")
    cell, z = row[inside] * grid.columns + column[inside], points[inside, 2]
    size = grid.rows * grid.columns
    count = np.bincount(cell, minlength=size)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(cell, z, size) / count
        spread = np.bincount(cell, (z - mean[cell]) ** 2, size) / (count - 1)
        sigma = np.where(count >= 3, np.sqrt(spread / count), np.nan)
    side = (grid.pitch_mm, grid.pitch_mm)
    layers = {"sigma": sigma.reshape(grid.shape)}
    return Raster(mean.reshape(grid.shape), side, (grid.x0_mm, grid.y0_mm), layers=layers)


def ply(path: Path) -> Cloud:
    """Read the vertices of a PLY, text or binary; a comment ``time ...`` says when."""
    from plyfile import PlyData, PlyParseError

    try:
        data = PlyData.read(str(path), known_list_len={"face": {"vertex_indices": 3}})
    except PlyParseError as error:
        raise InputError(f"{path}: is no readable .ply: {error}") from None
    vertex = data["vertex"]
    times = [line.removeprefix("time ") for line in data.comments if line.startswith("time ")]
    time = parse_instant(times[0]) if times else None
    return np.stack([np.asarray(vertex[axis], np.float64) for axis in "xyz"], axis=1), time


def las(path: Path) -> Cloud:
    """Read a LAS (1.0 to 1.4), or a LAZ where lazrs or laszip is installed, in metres."""
    import laspy

    try:
        data = laspy.read(path)
    except laspy.errors.LaspyException as error:
        reason = (str(error).splitlines() or [""])[0]
        if path.suffix.lower() == ".laz":
            raise MicroreliefError(
                f"{path}: cannot be read ({reason}); compressed LAS needs  pip install lazrs"
            ) from None
        raise InputError(f"{path}: is no readable .las: {reason}") from None
    about: dict[str, Any] = {}
    for record in data.header.vlrs:
        if record.user_id.rstrip("\0") == "microrelief":
            about = json.loads(bytes(record.record_data).decode("utf-8"))
    time = parse_instant(about["time"]) if "time" in about else None
    return np.stack([np.asarray(data.x), np.asarray(data.y), np.asarray(data.z)], axis=1).astype(np.float64), time


def xyz(path: Path) -> Cloud:
    """Read lines of x y z, parted by blanks, commas, semicolons or tabs; lines that begin otherwise are skipped."""
    import pandas as pd

    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    skip = next((at for at, line in enumerate(lines) if _numbers(line)), len(lines))
    if skip == len(lines):
        raise InputError(f"{path}: holds no line of x y z")
    table = pd.read_csv(path, sep=r"[\s,;]+", header=None, skiprows=skip, usecols=[0, 1, 2], engine="python")
    return table.to_numpy(np.float64), None


def _numbers(line: str) -> bool:
    parts = line.replace(",", " ").replace(";", " ").split()
    try:
        return len([float(part) for part in parts[:3]]) == 3
    except ValueError:
        return False


def _covering(points: npt.NDArray[np.float64], path: Path, pitch_mm: float | None) -> Grid:
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    if pitch_mm is None:
        area = float(np.prod(high - low))
        if area <= 0:
            raise InputError(f"{path}: its points lie on a line: give --pitch-mm")
        rough = np.sqrt(area / len(points))
        scale = 10.0 ** np.floor(np.log10(rough))
        pitch_mm = float(scale * min(step for step in (1.0, 2.0, 5.0, 10.0) if step * scale >= rough * 0.999))
    first = np.floor(low / pitch_mm + 0.5)
    columns, rows = (np.floor(high / pitch_mm + 0.5) - first + 1).astype(int)
    if rows * columns > MOST_CELLS:
        raise InputError(
            f"{path}: {columns}x{rows} cells of {pitch_mm:g} mm are too many: are its units mm? --pitch-mm"
        )
    return Grid(int(rows), int(columns), pitch_mm, float(first[0] * pitch_mm), float(first[1] * pitch_mm))

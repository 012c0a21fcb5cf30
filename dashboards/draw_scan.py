"""Draws scans: surface, maps, picture and facts of each."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pipelines import Instant
from storage import About, Stored

from . import paths
from .quantities import day_and_time, plain
from .raster import block_mean, change_png, level_png, texture_jpeg
from .scales import Scales
from .surface import surface

if TYPE_CHECKING:
    import rerun as rr

__all__ = ["LOOKS", "clock_line", "encoded", "log_baseline", "log_scan", "set_times", "to_pixels"]

LOOKS = "looks"
"""Archetype of the colours that the layout may give a surface instead of those by height."""


def log_scan(stream: rr.RecordingStream, stored: Stored, scales: Scales, about: About) -> None:
    """Log one scan; the baseline of an epoch also as the twin that stays beside those that follow."""
    import rerun as rr

    scan, change = stored.scan, stored.change
    set_times(stream, scan.time, stored.number)
    if scan.grid == scales.grid:
        drawn = _mesh(stored, scales)
        stream.log(f"{paths.SURFACE}/mesh", *drawn)
        if change is None:
            stream.log(f"{paths.BASELINE}/mesh", *drawn)
    else:  # an earlier epoch on another grid: the triangles of this one would join the wrong vertices
        stream.log(f"{paths.SURFACE}/mesh", rr.Clear(recursive=False))
    most = scales.detail.cells
    _log_values(stream, paths.HEIGHT, scan.height, scales)
    _log_values(stream, paths.SIGMA, scan.sigma, scales)
    stream.log(paths.CAMERA, encoded(texture_jpeg(scan.texture, most), "image/jpeg"))
    stream.log(paths.LEVEL, encoded(level_png(scan.level, most)))
    if scales.change_limit_mm > 0:
        nothing = np.zeros(scan.grid.shape, dtype=np.float32)
        dz, lod = (change.dz, change.lod) if change is not None else (nothing, nothing)
        if change is None:
            dz = np.where(np.isfinite(scan.height), nothing, np.float32(np.nan))
        stream.log(paths.CHANGE, encoded(change_png(dz, lod, scales.change_limit_mm, most)))
    sigma = scan.sigma[np.isfinite(scan.sigma)]
    figures = {"coverage": 100 * scan.coverage, "sigma": 1000 * float(np.median(sigma)) if sigma.size else np.nan}
    if change is not None:
        figures["residual"] = 1000 * change.motion.residual_mm
    for name, value in figures.items():
        stream.log(f"{paths.QUALITY}/{name}", rr.Scalars(value))
    stream.log(paths.ABOUT, rr.TextDocument(_facts(stored, about, figures), media_type="text/markdown"))
    stream.log(paths.LOG, rr.TextLog(clock_line(scan.time, _scan_line(stored)), level="INFO"))


def log_baseline(stream: rr.RecordingStream, baseline: Stored, scales: Scales, at: Instant, number: int) -> None:
    """Log a baseline's twin for scans that are shown without it, from the first of them on."""
    set_times(stream, at, number)
    if baseline.scan.grid == scales.grid:
        stream.log(f"{paths.BASELINE}/mesh", *_mesh(baseline, scales))


def set_times(stream: rr.RecordingStream, moment: Instant, number: int) -> None:
    """Say when, and at which scan, what is logged next was."""
    stream.set_time(paths.TIME_TIMELINE, timestamp=moment)
    stream.set_time(paths.SCAN_TIMELINE, sequence=number)


def clock_line(moment: Instant, text: str) -> str:
    """Begin with the time: the viewer's own time column is too narrow for it."""
    return f"{day_and_time(moment).removesuffix(' UTC')}  {text}"


def encoded(picture: bytes, media_type: str = "image/png") -> Any:
    """Wrap a picture file."""
    import rerun as rr

    return rr.EncodedImage(contents=picture, media_type=media_type)


def to_pixels(x_mm: npt.ArrayLike, y_mm: npt.ArrayLike, scales: Scales) -> npt.NDArray[np.float64]:
    """Give places of the site frame on a map, shape (n, 2); a map has the largest y on top."""
    grid, rows = scales.grid, scales.map_shape[0]
    column = (np.asarray(x_mm, dtype=np.float64) - grid.x0_mm) / grid.pitch_mm
    row = (np.asarray(y_mm, dtype=np.float64) - grid.y0_mm) / grid.pitch_mm
    return np.stack([(column + 0.5) / scales.factor, rows - (row + 0.5) / scales.factor], axis=-1)


def _mesh(stored: Stored, scales: Scales) -> tuple[Any, Any]:
    import rerun as rr

    shape = surface(stored.scan, stored.change, scales)
    colours = {
        "change": rr.components.ColorBatch(shape.by_change),
        "level": rr.components.ColorBatch(shape.by_level),
    }
    mesh = rr.Mesh3D.from_fields(
        vertex_positions=shape.positions, vertex_normals=shape.normals, vertex_colors=shape.by_height
    )
    return mesh, rr.DynamicArchetype(LOOKS, components=colours)


def _log_values(stream: rr.RecordingStream, path: str, cells: npt.NDArray[np.float32], scales: Scales) -> None:
    """Log a map whose values can be read under the cursor: half precision where that is finer than 0.5 µm."""
    import rerun as rr

    shown = np.flipud(block_mean(cells, scales.factor))
    reach = float(np.nanmax(np.abs(shown), initial=0.0))
    values = np.ascontiguousarray(shown, dtype=np.float16 if reach < 1.0 else np.float32)
    kind = rr.components.ImageFormat(
        width=shown.shape[1],
        height=shown.shape[0],
        channel_datatype="F16" if values.dtype == np.float16 else "F32",
    )
    stream.log(path, rr.DepthImage.from_fields(buffer=values.view(np.uint8).ravel(), format=kind))
    # its class 0 is transparent, which pixels of a picture would not be
    stream.log(f"{path}/holes", rr.SegmentationImage(np.isnan(shown).astype(np.uint8), opacity=1.0))


def _scan_line(stored: Stored) -> str:
    measured = f"scan {stored.number}: {100 * stored.scan.coverage:.1f} % measured"
    if stored.change is None:
        return f"{measured}, baseline"
    motion = stored.change.motion
    reason = f", {motion.reason}" if motion.reason else ""
    return f"{measured}, registration {motion.verdict}, {plain(1000 * motion.residual_mm, 2)} µm{reason}"


def _facts(stored: Stored, about: About, figures: dict[str, float]) -> str:
    """Say in a table what the scan is, and what it was made of."""
    scan, grid = stored.scan, stored.scan.grid
    rows = {
        "taken": day_and_time(scan.time),
        "planned": day_and_time(stored.planned),
        "epoch, baseline": f"{stored.epoch}, scan {stored.baseline}",
        "measured": f"{plain(figures['coverage'], 3)} %",
        "median sigma": f"{plain(figures['sigma'], 2)} µm",
    }
    if stored.change is not None:
        motion = stored.change.motion
        rows["registration"] = f"{motion.verdict}{f' ({motion.reason})' if motion.reason else ''}"
        rows["residual, overlap"] = f"{plain(figures['residual'], 2)} µm, {plain(100 * motion.overlap, 3)} %"
        lod = stored.change.lod[np.isfinite(stored.change.lod)]
        if lod.size:
            rows["level of detection"] = f"{plain(1000 * float(np.median(lod)), 2)} µm (median)"
    rows |= {
        "grid": f"{grid.columns} x {grid.rows} cells of {plain(1000 * grid.pitch_mm, 3)} µm",
        "calibration": scan.calibration_id[:12] or "none",
        "settings": about.campaign_hash[:12] or "none",
        "snapshot": about.snapshot[:12],
        "software": about.software,
    }
    lines = [f"### Scan {stored.number} · {about.site}", "", "| | |", "|---|---|"]
    return "\n".join([*lines, *(f"| {name} | {value} |" for name, value in rows.items())])

"""Draws cracks as lines with their numbers and widths, and plates with how far their rims have curled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from . import paths
from .draw_scan import encoded, to_pixels
from .palette import LABELS, LINES, Rgb
from .quantities import plain, with_uncertainty
from .raster import Range, plates_png
from .scales import Scales

if TYPE_CHECKING:
    import rerun as rr

    from pipelines.change import CrackSighting, Measurement, Plate

    from .followed import Sights

__all__ = ["log_sights"]

MOST_NAMED = 6
"""Cracks and plates that have a label and a line in a plot, the largest first: more would hide each other."""

MOST_LISTED = 12
"""Rows of a table."""


def log_sights(stream: rr.RecordingStream, sights: Sights, scales: Scales) -> None:
    """Log what was found in the scan whose times are set."""
    _log_cracks(stream, sights, scales)
    if sights.cells is not None:
        _log_plates(stream, sights, scales)


def _log_cracks(stream: rr.RecordingStream, sights: Sights, scales: Scales) -> None:
    import rerun as rr

    by_length = sorted(sights.cracks, key=lambda crack: -crack.size.length.value)
    named = {crack.identity: crack for crack in by_length[:MOST_NAMED]}
    widths = {crack.identity: crack.size.width.value for crack in sights.cracks}
    flat: list[npt.NDArray[np.float64]] = []
    solid: list[npt.NDArray[np.float64]] = []
    colours: list[Rgb] = []
    labels: list[str] = []
    longest: dict[int, tuple[int, int]] = {}
    for line in sights.lines:
        if line.x_mm.size > longest.get(line.identity, (0, 0))[0]:
            longest[line.identity] = (line.x_mm.size, len(flat))
        flat.append(to_pixels(line.x_mm, line.y_mm, scales))
        solid.append(_on_surface(sights, line.x_mm, line.y_mm))
        colours.append(_colour(line.identity))
        labels.append("")
    for identity, (_, number) in longest.items():
        if identity in named:
            width = widths[identity]
            labels[number] = f"{identity}: {plain(width, 2)} mm" if np.isfinite(width) else str(identity)
    stream.log(paths.CRACKS, rr.LineStrips2D(flat, colors=colours, radii=rr.Radius.ui_points(1.5)))
    # labels at places of their own: those of all lines, most of them empty, would be drawn as empty boxes
    at = [number for number, label in enumerate(labels) if label]
    places = [flat[number][len(flat[number]) // 2] for number in at]
    words = [labels[number] for number in at]
    stream.log(
        f"{paths.CRACKS}/labels",
        rr.Points2D(places, labels=words, colors=[LABELS], radii=0.0, show_labels=True)
        if at
        else rr.Clear(recursive=False),
    )
    stream.log(f"{paths.SURFACE}/cracks", rr.LineStrips3D(solid, colors=colours, radii=rr.Radius.ui_points(1.5)))
    for identity, crack in named.items():
        if np.isfinite(crack.size.width.value):
            _log_series(stream, f"{paths.CRACK_WIDTHS}/{identity}", "crack", identity, crack.size.width)
    stream.log(paths.CRACK_TABLE, rr.TextDocument(_crack_table(by_length), media_type="text/markdown"))


def _log_plates(stream: rr.RecordingStream, sights: Sights, scales: Scales) -> None:
    import rerun as rr

    assert sights.cells is not None
    limit = max(scales.change_limit_mm, 1e-6)
    lifts = np.full(int(sights.cells.max(initial=0)) + 1, np.nan, dtype=np.float32)
    for plate in sights.plates.values():
        lifts[plate.label] = plate.lift.value
    rows, columns = scales.map_shape
    picture = plates_png(sights.cells, lifts, Range(-limit, limit), (rows, columns))
    stream.log(paths.PLATES, encoded(picture))
    by_area = sorted(sights.plates.items(), key=lambda each: -each[1].area.value)
    largest = by_area[:MOST_NAMED]
    places = to_pixels([plate.x_mm for _, plate in largest], [plate.y_mm for _, plate in largest], scales)
    labels = [f"{name}: {_sign(plate.lift.value)} mm" for name, plate in largest]
    stream.log(
        f"{paths.PLATES}/labels",
        rr.Points2D(places, labels=labels, radii=0.0, colors=[LABELS], show_labels=True)
        if largest
        else rr.Clear(recursive=False),
    )
    for name, plate in largest:
        _log_series(stream, f"{paths.PLATE_LIFTS}/{name}", "plate", name, plate.lift)
    stream.log(paths.PLATE_TABLE, rr.TextDocument(_plate_table(by_area[:MOST_LISTED]), media_type="text/markdown"))


def _log_series(stream: rr.RecordingStream, path: str, kind: str, number: int, measured: Measurement) -> None:
    """Log one point of a line with its band, mm."""
    import rerun as rr

    variance = measured.sigma**2 if np.isfinite(measured.sigma) else 0.0
    point = rr.Measurements(
        [measured.value],
        variances=[variance],
        names=[f"{kind} {number}"],
        units=["mm"],
        colors=[_colour(number)],
        widths=[2.0],
    )
    stream.log(path, point)


def _colour(number: int) -> Rgb:
    return LINES[(number - 1) % len(LINES)]


def _on_surface(
    sights: Sights, x_mm: npt.NDArray[np.float64], y_mm: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Lay a line on the rims that it runs between: at the highest of the cells around each point."""
    grid, height = sights.scan.grid, sights.scan.height
    row = np.rint((y_mm - grid.y0_mm) / grid.pitch_mm).astype(int)
    column = np.rint((x_mm - grid.x0_mm) / grid.pitch_mm).astype(int)
    reach = (-3, 0, 3)
    around = np.stack(
        [
            height[np.clip(row + down, 0, grid.rows - 1), np.clip(column + right, 0, grid.columns - 1)]
            for down in reach
            for right in reach
        ]
    )
    top = np.where(np.isfinite(around), around, -np.inf).max(axis=0)
    middle = float(np.nanmedian(height)) if np.isfinite(height).any() else 0.0
    return np.stack([x_mm, y_mm, np.where(np.isfinite(top), top, middle)], axis=-1)


def _crack_table(cracks: Sequence[CrackSighting]) -> str:
    if not cracks:
        return "No crack was found in this scan."
    lines = ["| crack | length mm | width mm | widest mm | depth mm |", "|---|---|---|---|---|"]
    for crack in cracks[:MOST_LISTED]:
        size = crack.size
        lines.append(
            f"| {crack.identity} | {with_uncertainty(size.length)} "
            f"| {with_uncertainty(size.width)} | {plain(size.width_max_mm, 2)} "
            f"| {'≥ ' if np.isfinite(size.depth.value) else ''}{with_uncertainty(size.depth)} |"
        )
    if len(cracks) > MOST_LISTED:
        lines += ["", f"and {len(cracks) - MOST_LISTED} shorter ones"]
    return "\n".join(lines)


def _plate_table(plates: Sequence[tuple[int, Plate]]) -> str:
    if not plates:
        return "No plate between cracks could be measured in this scan."
    lines = ["| plate | area mm² | lift mm | angle ° | curvature 1/mm |", "|---|---|---|---|---|"]
    for name, plate in plates:
        values = (plate.area, plate.lift, plate.angle, plate.curvature)
        lines.append(f"| {name} | " + " | ".join(with_uncertainty(each) for each in values) + " |")
    return "\n".join(lines)


def _sign(value: float) -> str:
    return f"{'+' if value > 0 else ''}{plain(value, 2)}"

"""The kinds of views a review is made of: surfaces, maps, plots, lanes, log and tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from . import paths
from .draw_scan import LOOKS
from .metric_names import TrendGroup
from .quantities import plain, unit_text
from .scales import Scales

if TYPE_CHECKING:
    import rerun.blueprint as rrb

__all__ = ["document", "lanes", "log", "map_view", "series_view", "surface_view", "trend_view"]

_BACKGROUND = (24, 26, 30)


def surface_view(
    scales: Scales,
    name: str,
    *,
    colours: str = "",
    baseline: bool = False,
    cracks: bool = False,
    tracks: bool = False,
    far: float = 1.0,
) -> rrb.Spatial3DView:
    """Look at the whole surface from an oblique angle, from the front and a little from the left.

    `colours` is "change" or "level" instead of by height; `far` moves the eye away, for a narrow view.
    """
    import rerun as rr
    import rerun.blueprint as rrb
    from rerun.blueprint import encodings

    x_low, x_high, y_low, y_high = scales.grid.extent_mm
    middle = (scales.height.low + scales.height.high) / 2 * scales.exaggeration
    centre = np.array([(x_low + x_high) / 2, (y_low + y_high) / 2, middle])
    reach = far * float(np.hypot(x_high - x_low, y_high - y_low))
    eye = centre + reach * np.array([-0.27, -0.62, 0.6])
    taller = "" if scales.exaggeration == 1 else f", heights x {plain(scales.exaggeration)}"
    origin = paths.BASELINE if baseline else paths.SURFACE
    mesh = f"{origin}/mesh"
    overrides: dict[Any, Any] = {}
    if colours:
        mapping = encodings.VisualizerComponentMapping(
            target="Mesh3D:vertex_colors",
            source_kind=encodings.ComponentSourceKind.SourceComponent,
            source_component=f"{LOOKS}:{colours}",
        )
        overrides[mesh] = rr.Mesh3D.from_fields().visualizer(mappings=[mapping])
    return rrb.Spatial3DView(
        origin=origin,
        contents=[
            *(origin, mesh),
            *([f"{origin}/cracks"] if cracks else []),
            *([f"{paths.SURFACE_PATHS}/**"] if tracks else []),
        ],
        name=f"{name}, mm{taller}",
        overrides=overrides,
        background=rrb.Background(color=list(_BACKGROUND), kind=rrb.BackgroundKind.SolidColor),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye.tolist(),
            look_target=(centre - [0, 0.03 * reach / far, 0]).tolist(),
            eye_up=[0.0, 0.0, 1.0],
        ),
    )


def map_view(scales: Scales, path: str, name: str, *above: str, bar: bool | str = True) -> rrb.Spatial2DView:
    """Show a map whole, with room for a colour bar below: its own, or that of another map (`bar` is its path)."""
    import rerun.blueprint as rrb

    rows, columns = scales.map_shape
    bottom = 1.22 if bar else 1.02
    contents = [f"{path}/**", *(f"{each}/**" for each in above)]
    if isinstance(bar, str):
        contents.append(f"{bar}/scale/**")
    return rrb.Spatial2DView(
        origin="/",
        contents=contents,
        name=name,
        background=list(_BACKGROUND),
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-0.02 * columns, 1.02 * columns], y_range=[-0.02 * rows, bottom * rows]
        ),
    )


def trend_view(group: TrendGroup, limits: frozenset[str]) -> rrb.TimeSeriesView:
    """Plot metrics of one unit with their bands and limits, through the whole campaign."""
    import rerun.blueprint as rrb

    names = [metric.name for metric in group.metrics]
    limited = [f"{paths.LIMITS}/{name}/**" for name in names if name in limits]
    return rrb.TimeSeriesView(
        origin="/",
        contents=[*(paths.trend(name) for name in names), *limited],
        name=f"{group.title}, {unit_text(group.unit)}".rstrip(", "),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D[group.corner], visible=len(names) > 1 or bool(limited)),
        axis_x=_whole_time(),
    )


def series_view(path: str, name: str) -> rrb.TimeSeriesView:
    """Plot everything below a path, through the whole campaign."""
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(
        origin=path,
        name=name,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=path.count("/") == 1),
        axis_x=_whole_time(),
    )


def lanes() -> rrb.StateTimelineView:
    """Show visits, registrations and alarms as coloured lanes."""
    import rerun.blueprint as rrb

    return rrb.StateTimelineView(
        origin="/",
        contents=[paths.VISITS, paths.REGISTRATION, f"{paths.ALARMS}/**"],
        name="Visits and alarms",
        time_view=_whole_time(),
    )


def log() -> rrb.TextLogView:
    """List what happened, a line each."""
    import rerun.blueprint as rrb

    return rrb.TextLogView(
        origin=paths.LOG,
        name="Log",
        columns=rrb.TextLogColumns(timeline_columns=[paths.SCAN_TIMELINE], text_log_columns=["LogLevel", "Body"]),
    )


def document(path: str, name: str) -> rrb.TextDocumentView:
    """Show the table of the scan under the cursor."""
    import rerun.blueprint as rrb

    return rrb.TextDocumentView(origin=path, name=name)


def _whole_time() -> rrb.TimeAxis:
    """Show a campaign from its first to its last scan, whichever timeline is chosen."""
    import rerun as rr
    import rerun.blueprint as rrb

    ends = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
    return rrb.TimeAxis(view_range=ends)

"""The layout of a review, built in code: what is shown where, and how each view is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines import Grid

from . import paths
from .metric_names import TrendGroup
from .quantities import plain, unit_text
from .raster import Range, shrink_factor

if TYPE_CHECKING:
    import rerun.blueprint as rrb

__all__ = ["MOST_MAP_CELLS", "Layout", "review_blueprint"]

MOST_MAP_CELLS = 1_000_000
"""Maps with more cells than this are shrunk for the screen."""

_SCANS_PER_SECOND = 2.0
_BACKGROUND = (24, 26, 30)


@dataclass(frozen=True, slots=True)
class Layout:
    """What the layout depends on.

    Parameters
    ----------
    grid : Grid
    height : Range
        Ends of the height scale, mm.
    change_limit_mm : float
        Ends of the change scale, mm; 0 where no scan has a change.
    exaggeration : float
        How many times heights are drawn taller than they are.
    interval_s : float
        Typical time between scans: playing shows two of them a second.
    trends : sequence of TrendGroup
    """

    grid: Grid
    height: Range
    change_limit_mm: float
    exaggeration: float
    interval_s: float
    trends: Sequence[TrendGroup]

    @property
    def map_shape(self) -> tuple[int, int]:
        """Rows and columns of a map on the screen."""
        factor = shrink_factor(self.grid.rows, self.grid.columns, MOST_MAP_CELLS)
        return -(-self.grid.rows // factor), -(-self.grid.columns // factor)


def review_blueprint(layout: Layout) -> rrb.Blueprint:
    """Arrange a review: the surface large, maps beside it, trends to the right, alarm lanes and log below."""
    import rerun.blueprint as rrb

    maps: list[Any] = [
        _map_view(layout, paths.HEIGHT, "Height, mm: dark is low, yellow is high"),
        _map_view(layout, paths.CAMERA, "Camera", colour_bar=False),
    ]
    if layout.change_limit_mm > 0:
        maps.insert(0, _map_view(layout, paths.CHANGE, "Change, mm: red lost, blue gained"))
    trends: list[Any] = [
        rrb.TimeSeriesView(
            origin=paths.TRENDS,
            contents=[paths.trend(metric.name) for metric in group.metrics],
            name=f"{group.title}, {unit_text(group.unit)}".rstrip(", "),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=len(group.metrics) > 1),
            axis_x=_whole_time(),
        )
        for group in layout.trends
    ]
    below = rrb.Horizontal(
        rrb.StateTimelineView(
            origin="/",
            contents=[paths.VISITS, paths.REGISTRATION, f"{paths.ALARMS}/**"],
            name="Visits and alarms",
            time_view=_whole_time(),
        ),
        rrb.TextLogView(
            origin=paths.LOG,
            name="Log",
            columns=rrb.TextLogColumns(timeline_columns=[paths.SCAN_TIMELINE], text_log_columns=["LogLevel", "Body"]),
        ),
        column_shares=[4, 5],
    )
    columns: list[Any] = [
        rrb.Vertical(_surface_view(layout), below, row_shares=[3, 1]),
        rrb.Vertical(*maps),
    ]
    if trends:
        columns.append(rrb.Vertical(*trends) if len(trends) <= 5 else rrb.Grid(*trends, grid_columns=2))
    return rrb.Blueprint(
        rrb.Horizontal(*columns, column_shares=[5, 2.2, 2.8][: len(columns)]),
        rrb.TimePanel(
            state="collapsed",
            timeline=paths.TIME_TIMELINE,
            playback_speed=max(_SCANS_PER_SECOND * layout.interval_s, 1.0),
            fps=_SCANS_PER_SECOND,
            play_state="following",  # opens at the newest scan,
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _whole_time() -> rrb.TimeAxis:
    """Show a campaign from its first to its last scan, whichever timeline is chosen."""
    import rerun as rr
    import rerun.blueprint as rrb

    ends = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
    return rrb.TimeAxis(view_range=ends)


def _map_view(layout: Layout, origin: str, name: str, *, colour_bar: bool = True) -> rrb.Spatial2DView:
    """Show a map whole, with room for its colour bar below."""
    import rerun.blueprint as rrb

    rows, columns = layout.map_shape
    bottom = 1.2 if colour_bar else 1.02
    return rrb.Spatial2DView(
        origin=origin,
        name=name,
        background=list(_BACKGROUND),
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-0.02 * columns, 1.02 * columns], y_range=[-0.02 * rows, bottom * rows]
        ),
    )


def _surface_view(layout: Layout) -> rrb.Spatial3DView:
    """Look at the whole surface from an oblique angle, from the front and a little from the left."""
    import rerun.blueprint as rrb

    x_low, x_high, y_low, y_high = layout.grid.extent_mm
    middle = (layout.height.low + layout.height.high) / 2 * layout.exaggeration
    centre = np.array([(x_low + x_high) / 2, (y_low + y_high) / 2, middle])
    reach = float(np.hypot(x_high - x_low, y_high - y_low))
    eye = centre + reach * np.array([-0.27, -0.62, 0.6])
    taller = "" if layout.exaggeration == 1 else f", heights drawn {plain(layout.exaggeration)} times taller"
    return rrb.Spatial3DView(
        origin=paths.SURFACE,
        name=f"Surface, mm{taller}",
        background=rrb.Background(color=list(_BACKGROUND), kind=rrb.BackgroundKind.SolidColor),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye.tolist(),
            look_target=(centre - [0, 0.03 * reach, 0]).tolist(),
            eye_up=[0.0, 0.0, 1.0],
        ),
    )

"""The layout of a review, built in code: five presets as the tabs of one window, and which of them is in front."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

from . import paths
from .metric_names import TrendGroup
from .scales import Scales
from .view_kinds import (
    document,
    lanes,
    log,
    map_view,
    series_view,
    surface_view,
    trend_view,
)

if TYPE_CHECKING:
    import rerun.blueprint as rrb

__all__ = ["PRESETS", "Layout", "Preset", "review_blueprint"]

Preset = Literal["overview", "cracks", "curl", "video", "quality"]
PRESETS: tuple[Preset, ...] = get_args(Preset)

_SCANS_PER_SECOND = 2.0
_CURL = ("edge_lift", "plate_", "curl_")


@dataclass(frozen=True, slots=True)
class Layout:
    """What the layout depends on.

    Parameters
    ----------
    scales : Scales
    interval_s : float
        Typical time between scans: playing shows two of them a second.
    trends : sequence of TrendGroup
    limits : frozenset of str
        Metrics for which the campaign set limits.
    cracks, plates : bool
        Whether the campaign looks for them; a preset without its subject is left out.
    tracks : bool
        Whether there are paths of what moves on the surface.
    """

    scales: Scales
    interval_s: float
    trends: Sequence[TrendGroup]
    limits: frozenset[str] = frozenset()
    cracks: bool = False
    plates: bool = False
    tracks: bool = False

    @property
    def presets(self) -> tuple[Preset, ...]:
        """Presets that have something to show."""
        lacking = {"cracks"} if not self.cracks else set()
        lacking |= {"curl"} if not self.plates else set()
        return tuple(preset for preset in PRESETS if preset not in lacking)


def review_blueprint(layout: Layout, preset: Preset = "overview") -> rrb.Blueprint:
    """Arrange a review.

    Parameters
    ----------
    layout : Layout
    preset : {"overview", "cracks", "curl", "video", "quality"}
        The tab in front; the first where the store has nothing to show in it.
    """
    import rerun.blueprint as rrb

    shown = layout.presets
    tabs = [_TABS[name](layout) for name in shown]
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=shown.index(preset) if preset in shown else 0),
        rrb.TimePanel(
            state="collapsed",
            timeline=paths.TIME_TIMELINE,
            playback_speed=max(_SCANS_PER_SECOND * layout.interval_s, 1.0),
            fps=_SCANS_PER_SECOND,
            play_state="following",  # opens at the newest scan, and stays there where more come
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _overview(layout: Layout) -> Any:
    import rerun.blueprint as rrb

    return rrb.Horizontal(
        rrb.Vertical(
            rrb.Horizontal(
                surface_view(layout.scales, "Surface now", far=1.55),
                surface_view(layout.scales, "Baseline", baseline=True, far=1.55),
            ),
            rrb.Horizontal(lanes(), log(), column_shares=[4, 5]),
            row_shares=[3, 1.2],
        ),
        rrb.Vertical(*_maps(layout)),
        _trends(layout, lambda name: True, 4),
        column_shares=[5, 2.2, 2.8],
        name="Overview",
    )


def _cracks(layout: Layout) -> Any:
    import rerun.blueprint as rrb

    scales = layout.scales
    return rrb.Horizontal(
        rrb.Vertical(
            surface_view(scales, "Surface by change, cracks", colours="change", cracks=True),
            rrb.Horizontal(lanes(), document(paths.CRACK_TABLE, "Cracks of this scan"), column_shares=[7, 13]),
            row_shares=[3, 1.5],
        ),
        rrb.Vertical(
            map_view(scales, paths.HEIGHT, "Height and cracks, number: mean width", paths.CRACKS, paths.PLACES),
            map_view(scales, paths.CAMERA, "Camera and cracks", paths.CRACKS, bar=False),
        ),
        rrb.Vertical(
            series_view(paths.CRACK_WIDTHS, "Mean width of each crack, mm"),
            *_trend_views(layout, lambda name: name.startswith("crack_"), 3),
        ),
        column_shares=[4, 3, 3],
        name="Cracks",
    )


def _curl(layout: Layout) -> Any:
    import rerun.blueprint as rrb

    scales = layout.scales
    return rrb.Horizontal(
        rrb.Vertical(
            surface_view(scales, "Surface by change", colours="change"),
            document(paths.PLATE_TABLE, "Plates of this scan"),
            row_shares=[3, 1.5],
        ),
        rrb.Vertical(
            map_view(scales, paths.PLATES, "Plates, number: lift of the rim", paths.PLACES, bar=paths.CHANGE),
            *_maps(layout)[: int(scales.change_limit_mm > 0)],
        ),
        rrb.Vertical(
            series_view(paths.PLATE_LIFTS, "Lift of each plate's rim, mm"),
            *_trend_views(layout, lambda name: name.startswith(_CURL), 3),
        ),
        column_shares=[4, 3, 3],
        name="Curl",
    )


def _video(layout: Layout) -> Any:
    import rerun.blueprint as rrb

    return rrb.Horizontal(
        rrb.Vertical(surface_view(layout.scales, "Surface now", tracks=layout.tracks), log(), row_shares=[4, 1]),
        rrb.Vertical(*_maps(layout, tracks=layout.tracks)),
        rrb.Vertical(
            *_trend_views(layout, lambda name: True, 2),
            series_view(f"{paths.QUALITY}/residual", "Registration residual, µm"),
        ),
        column_shares=[5, 2.5, 2.5],
        name="Video",
    )


def _quality(layout: Layout) -> Any:
    import rerun.blueprint as rrb

    scales = layout.scales
    return rrb.Horizontal(
        rrb.Vertical(
            surface_view(scales, "Surface by level of stripes", colours="level"),
            rrb.Horizontal(lanes(), document(paths.ABOUT, "This scan and its provenance")),
            row_shares=[3, 2],
        ),
        rrb.Vertical(
            map_view(scales, paths.SIGMA, "Standard uncertainty, mm: dark is sure", paths.PLACES),
            map_view(scales, paths.LEVEL, "Stripes resolved: 0 the finest, + coarser"),
            map_view(scales, paths.CAMERA, "Camera", bar=False),
        ),
        rrb.Vertical(
            series_view(f"{paths.QUALITY}/coverage", "Measured, %"),
            series_view(f"{paths.QUALITY}/residual", "Registration residual, µm"),
            series_view(f"{paths.QUALITY}/sigma", "Median standard uncertainty, µm"),
            log(),
        ),
        column_shares=[4, 2.4, 3],
        name="Quality",
    )


_TABS: dict[Preset, Callable[[Layout], Any]] = {
    "overview": _overview,
    "cracks": _cracks,
    "curl": _curl,
    "video": _video,
    "quality": _quality,
}


def _maps(layout: Layout, *, tracks: bool = False) -> list[Any]:
    above = (paths.MAP_PATHS,) if tracks else ()
    maps = [
        map_view(layout.scales, paths.HEIGHT, "Height, mm: dark is low, yellow is high", *above),
        map_view(layout.scales, paths.CAMERA, "Camera", bar=False),
    ]
    if layout.scales.change_limit_mm > 0:
        maps.insert(0, map_view(layout.scales, paths.CHANGE, "Change, mm: red lost, blue gained", paths.PLACES))
    return maps


def _trends(layout: Layout, wanted: Callable[[str], bool], rows: int) -> Any:
    """Show trends one below the other, in two columns where there are many; the scan's facts where there are none."""
    import rerun.blueprint as rrb

    views = _trend_views(layout, wanted, None)
    if not views:
        return document(paths.ABOUT, "This scan and its provenance")
    return rrb.Vertical(*views) if len(views) <= rows else rrb.Grid(*views, grid_columns=2)


def _trend_views(layout: Layout, wanted: Callable[[str], bool], most: int | None) -> list[Any]:
    groups = [group for group in layout.trends if any(wanted(metric.name) for metric in group.metrics)]
    return [trend_view(group, layout.limits) for group in groups[:most]]

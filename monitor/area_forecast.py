"""Forecast of an area: how many tiles a visit has, how large its scans are, and how long it takes, if that is known."""

from __future__ import annotations

import statistics
from datetime import timedelta

import numpy as np

from configs import Area, Campaign, InputError, format_duration
from pipelines import Grid, Instant, PatternSet

from .area_plan import AreaPlan, plan_area
from .health_log import HealthLog, health_file
from .recipe import known_calibration

__all__ = ["SIMULATED_MM", "area_lines", "foreseen"]

SIMULATED_MM = 15.1, 11.3
"""What the simulated rig sees, before it was calibrated."""
LOOKED_AT = 10
"""So many of the newest visits tell how long one takes."""


def foreseen(area: Area, campaign: Campaign, patterns: PatternSet) -> AreaPlan | None:
    """Plan an area without a rig; None where there is no calibration to tell what a tile shows."""
    pitch_mm = campaign.grid.pitch_mm
    try:
        calibration = known_calibration(campaign, patterns)
    except InputError:  # whoever needs it says so
        return None
    if calibration is not None:
        from pipelines.reconstruction import footprint_grid

        footprint = footprint_grid(calibration, pitch_mm)
    else:
        pitch_mm = 0.02 if pitch_mm is None else pitch_mm
        columns, rows = (max(1, round(side / pitch_mm)) for side in SIMULATED_MM)
        footprint = Grid(rows, columns, pitch_mm)
    # which way the axes lie hardly changes how large it all is
    return plan_area(area if area.axes is not None else area.model_copy(update={"axes": ("x", "y")}), footprint)


def area_lines(area: Area, campaign: Campaign, patterns: PatternSet, coming: list[Instant]) -> list[str]:
    """Tell of an area's visits, and whether they are over before the next slot; `coming` are some slots in a row."""
    plan = foreseen(area, campaign, patterns)
    if plan is None:
        return []
    tiles, pitch = len(plan.tiles), plan.grid.pitch_mm
    size = f"{plan.grid.columns * pitch:.1f} x {plan.grid.rows * pitch:.1f} mm"
    lines = [f"  area: {tiles} tiles, together {size}; a scan needs {plan.least} of them"]
    taken = [each for each in HealthLog(health_file(campaign)).newest(LOOKED_AT) if each.state == "taken"]
    seconds = statistics.median([each.took_s for each in taken]) if taken else tiles * area.settle_s
    if taken:
        lines.append(f"  a visit takes {_told(seconds)}, as measured (median of {len(taken)})")
    else:
        lines.append(f"  a visit takes {_told(seconds)} to settle at all tiles; travel, capture and work come beside")
    between_s = _shortest_s(campaign, coming)
    if seconds > between_s:
        lines.append(
            f"  WARNING: that is longer than the {_told(between_s)} between slots: those due meanwhile are missed"
        )
    return lines


def _told(seconds: float) -> str:
    return format_duration(timedelta(seconds=round(seconds) if seconds >= 10 else round(seconds, 1)))


def _shortest_s(campaign: Campaign, coming: list[Instant]) -> float:
    """Shortest time between two slots that are to be expected, s."""
    adaptive = campaign.schedule.adaptive
    gaps = [float(gap / np.timedelta64(1, "s")) for gap in np.diff(np.array(coming, "datetime64[ns]"))]
    return min([*gaps, *([adaptive.burst.total_seconds()] if adaptive is not None else [])], default=float("inf"))

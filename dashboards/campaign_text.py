"""What a report needs of the campaign text that a store keeps: places, lags; read as YAML, never as a `Campaign`.

A report must not fail because a rig's options have changed since the store was made.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from pipelines import Grid
from pipelines.change import polygon_mask

__all__ = ["counted_cells", "max_lag_hours", "settings_of", "site_zone", "stable_cells"]

Mask = npt.NDArray[np.bool_]


def settings_of(campaign: str) -> dict[str, Any]:
    """Read a campaign file's text; empty where it is none."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        settings = YAML(typ="safe", pure=True).load(campaign)
    except YAMLError:
        return {}
    return settings if isinstance(settings, dict) else {}


def site_zone(campaign: str) -> str:
    """Find the site's time zone in a campaign file's text; UTC where it names none that is known."""
    from zoneinfo import available_timezones

    site = settings_of(campaign).get("site")
    zone = site.get("zone") if isinstance(site, dict) else None
    return zone if isinstance(zone, str) and zone in available_timezones() else "UTC"


def max_lag_hours(settings: dict[str, Any]) -> float:
    """Find the longest lag of the environment; 0 where none is named."""
    environment = settings.get("environment")
    lag = environment.get("max_lag_hours") if isinstance(environment, dict) else None
    return float(lag) if isinstance(lag, int | float) else 0.0


def stable_cells(settings: dict[str, Any], grid: Grid) -> Mask:
    """Mark the cells that the campaign says hold still; none where it names none."""
    register = settings.get("register")
    polygons = register.get("stable_mm") if isinstance(register, dict) else None
    found = _cells(polygons, grid) if isinstance(polygons, list) and polygons else None
    return found if found is not None else np.zeros(grid.shape, dtype=np.bool_)


def counted_cells(settings: dict[str, Any], grid: Grid) -> Mask:
    """Mark the cells that count in the metrics: the campaign's region, less what holds still."""
    region = settings.get("region_mm")
    found = _cells([region], grid) if isinstance(region, list) else None
    return (found if found is not None else np.ones(grid.shape, dtype=np.bool_)) & ~stable_cells(settings, grid)


def _cells(polygons: list[Any], grid: Grid) -> Mask | None:
    try:
        return polygon_mask(polygons, grid)
    except (TypeError, ValueError):
        return None

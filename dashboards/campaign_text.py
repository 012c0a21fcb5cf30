"""What a report needs of the campaign text that a store keeps: zone, lags; read as YAML, never as a `Campaign`.

A report must not fail because a rig's options have changed since the store was made.
"""

from __future__ import annotations

from typing import Any

__all__ = ["max_lag_hours", "settings_of", "site_zone"]


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

"""Frozen settings: what a campaign is, read from one YAML file. Knows nothing of the other packages."""

from typing import TYPE_CHECKING, Any

from .errors import CaptureError, ConfigError, DeviceUnavailable, InputError, MicroreliefError, StoreError

if TYPE_CHECKING:
    from .alarm import Alarm
    from .area import Area
    from .campaign import CalibrationSource, Campaign, RigSettings, Site
    from .environment import Environment
    from .exposure import AutoExposure
    from .load import CampaignFile, did_you_mean, load_campaign, parse_campaign, read_campaign
    from .notify import Condition, Notify
    from .places import Document, Route, read_yaml
    from .reports import Reports
    from .schedule import Adaptive, Schedule, Within
    from .units import format_duration, parse_duration

__all__ = [
    "Adaptive",
    "Alarm",
    "Area",
    "AutoExposure",
    "CalibrationSource",
    "Campaign",
    "CampaignFile",
    "CaptureError",
    "Condition",
    "ConfigError",
    "DeviceUnavailable",
    "Document",
    "Environment",
    "InputError",
    "MicroreliefError",
    "Notify",
    "Reports",
    "RigSettings",
    "Route",
    "Schedule",
    "Site",
    "StoreError",
    "Within",
    "did_you_mean",
    "format_duration",
    "load_campaign",
    "parse_campaign",
    "parse_duration",
    "read_campaign",
    "read_yaml",
]

_LATER = {
    "alarm": ("Alarm",),
    "area": ("Area",),
    "campaign": ("CalibrationSource", "Campaign", "RigSettings", "Site"),
    "environment": ("Environment",),
    "exposure": ("AutoExposure",),
    "load": ("CampaignFile", "did_you_mean", "load_campaign", "parse_campaign", "read_campaign"),
    "notify": ("Condition", "Notify"),
    "reports": ("Reports",),
    "places": ("Document", "Route", "read_yaml"),
    "schedule": ("Adaptive", "Schedule", "Within"),
    "units": ("format_duration", "parse_duration"),
}
"""Loaded when first asked for: pydantic costs a third of a second that `microrelief --help` need not wait for."""


def __getattr__(name: str) -> Any:
    from importlib import import_module

    for module, names in _LATER.items():
        if name in names:
            return getattr(import_module(f".{module}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

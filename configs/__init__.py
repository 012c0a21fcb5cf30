"""Frozen settings: what a campaign is, read from one YAML file. Knows nothing of the other packages."""

from .errors import CaptureError, DeviceUnavailable, InputError, MicroreliefError, StoreError

__all__ = ["CaptureError", "DeviceUnavailable", "InputError", "MicroreliefError", "StoreError"]

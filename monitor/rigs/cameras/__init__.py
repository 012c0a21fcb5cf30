"""Cameras: the registry of everything that can take a frame."""

from __future__ import annotations

from collections.abc import Callable

from .base import Camera, FrameLost, Image, Shot, lost_between
from .basler import BaslerCamera
from .gige import GigECamera
from .micromanager import MicroManagerCamera
from .uvc import UvcCamera

__all__ = ["CAMERAS", "Camera", "FrameLost", "Image", "Shot", "lost_between"]

CAMERAS: dict[str, Callable[..., Camera]] = {
    "basler": BaslerCamera,
    "gige": GigECamera,
    "micromanager": MicroManagerCamera,
    "uvc": UvcCamera,
}
"""Every kind of camera by name; each is made from plain keywords, the rig's option ``camera``."""

"""What the UVC camera must keep on the kernel's virtual camera: a script for the guest of vivid_guest.py, by its path.

The camera is imported without the package around it: numba and its like take minutes to load in an emulated machine.
"""

from __future__ import annotations

import importlib
import sys
import time
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

HOME = Path(__file__).parents[3]
SIZE = (640, 360)


def load_camera() -> Callable[..., Any]:
    """Import the camera alone."""
    sys.path.insert(0, str(HOME))
    for name in ("monitor", "monitor.rigs"):
        package = types.ModuleType(name)
        package.__path__ = [str(HOME.joinpath(*name.split(".")))]
        sys.modules[name] = package
    make: Callable[..., Any] = importlib.import_module("monitor.rigs.cameras.uvc").UvcCamera
    return make


def vivid() -> str:
    """The virtual camera's device."""
    names = Path("/sys/class/video4linux").glob("video*/name")
    return f"/dev/{next(file.parent.name for file in names if 'vivid' in file.read_text())}"


def every_frame_shows_what_was_shown_when_it_was_asked_for(make: Callable[..., Any]) -> None:
    """A second hand on the camera changes its picture as a projector would; 30 times, at any moment of a frame."""
    from linuxpy.video.device import Device

    projector = Device(vivid())
    projector.open()
    projector.controls["osd_text_mode"].value = 2  # no text
    pattern = projector.controls["test_pattern"]
    white, black = (next(k for k, name in pattern.data.items() if name == f"100% {c}") for c in ("White", "Black"))
    camera = make(device=vivid(), size=SIZE, pixel_format="GREY")
    camera.open()
    assert camera._device.controls["gain_automatic"].value is False  # locked
    camera.start()
    chance = np.random.default_rng(0)
    for number in range(30):
        lit = bool(chance.integers(2))
        pattern.value = white if lit else black
        time.sleep(float(chance.uniform(0, 0.25)))
        image = camera.take().image
        assert image.shape == (SIZE[1], SIZE[0])
        assert (image.mean() > 128) == lit, f"frame {number} is stale"
    camera.close()
    camera.close()
    camera.open()
    assert camera.take().image.shape == (SIZE[1], SIZE[0])
    camera.close()
    pattern.value = 0
    projector.close()


def what_it_has_not_is_refused(make: Callable[..., Any]) -> None:
    """Each with a word for people."""
    for options, told in (
        ({"controls": {"nosuch": 1}}, "has no control 'nosuch'"),
        ({"exposure_ms": 10.0}, "has no control 'exposure_time_absolute'"),
        ({"size": (17, 13)}, "gives no 17x13 in GREY"),
    ):
        with pytest.raises(ValueError, match=told):  # InputError is one
            make(device=vivid(), pixel_format="GREY", **options).open()


def colour_gives_its_brightness(make: Callable[..., Any]) -> None:
    """And a control that it has is set."""
    camera = make(device=vivid(), size=SIZE, pixel_format="YUYV", controls={"brightness": 77})
    camera.open()
    assert camera._device.controls["brightness"].value == 77
    image = camera.take().image
    assert image.shape == (SIZE[1], SIZE[0])
    assert image.std() > 20  # colour bars
    camera.close()


if __name__ == "__main__":
    camera_of = load_camera()
    for check in (
        every_frame_shows_what_was_shown_when_it_was_asked_for,
        what_it_has_not_is_refused,
        colour_gives_its_brightness,
    ):
        check(camera_of)
        print(f"kept: {check.__name__}", flush=True)

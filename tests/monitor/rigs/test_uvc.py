"""The UVC camera: its frames and words here, and the whole of it on the kernel's virtual camera in a guest.

The second part needs a kernel with vivid: `python -m pytest -m soak tests/monitor/rigs/test_uvc.py` starts one in qemu
and runs uvc_in_guest.py there.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from configs import DeviceUnavailable, InputError
from monitor.rigs.cameras import CAMERAS, FrameLost
from monitor.rigs.cameras.uvc import UvcCamera, grey
from monitor.rigs.parts import make_from_kind

from .peers import need
from .vivid_guest import run_with_vivid

IMAGE = np.add.outer(np.arange(32), 3 * np.arange(48)).astype(np.uint8)


@pytest.mark.parametrize("pixel_format", ["GREY", "YUYV", "MJPG"])
def test_brightness_is_taken_out_of_every_format(pixel_format: str) -> None:
    yuyv = np.full((32, 96), 128, np.uint8)
    yuyv[:, ::2] = IMAGE
    packed = {"GREY": IMAGE.tobytes(), "YUYV": yuyv.tobytes()}
    packed["MJPG"] = cv2.imencode(".jpg", IMAGE, [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    seen = grey(packed[pixel_format], 48, 32, pixel_format)
    assert seen.flags.c_contiguous
    assert np.abs(seen.astype(int) - IMAGE).max() <= (2 if pixel_format == "MJPG" else 0)
    with pytest.raises(FrameLost):
        grey(packed[pixel_format][:100], 48, 32, pixel_format)


def test_a_camera_that_is_not_there_is_unavailable() -> None:
    need("linuxpy")
    with pytest.raises(DeviceUnavailable, match="no camera can be opened at /dev/video77"):
        UvcCamera(device="/dev/video77").open()
    with pytest.raises(DeviceUnavailable, match=r"open\(\)"):
        UvcCamera().take()


@pytest.mark.parametrize(
    ("options", "message"),
    [({"pixel_format": "RGB3"}, "none of GREY, YUYV, MJPG"), ({"size": [640]}, "two whole numbers, columns and rows")],
)
def test_wrong_options_are_one_clear_line(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_from_kind("camera", CAMERAS, {"kind": "uvc", **options})


@pytest.mark.soak
def test_the_camera_keeps_its_word_on_the_kernels_virtual_camera(tmp_path: Path) -> None:
    need("linuxpy")
    script = Path(__file__).with_name("uvc_in_guest.py")
    said = run_with_vivid(f"HOME=/run TMPDIR=/run PYTHONDONTWRITEBYTECODE=1 {sys.executable} {script}", tmp_path)
    print(said)
    assert said.count("kept: ") == 3
    assert "guest ended with 0" in said

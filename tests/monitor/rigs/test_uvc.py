"""The UVC camera: its frames and words here, and the whole of it on the kernel's virtual camera in a guest.

The second part needs a kernel with vivid: `python -m pytest -m soak tests/monitor/rigs/test_uvc.py` starts one in qemu
and runs this file there, where MICRORELIEF_VIVID is set.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from configs import DeviceUnavailable, InputError
from monitor.rigs.cameras import CAMERAS, Camera, FrameLost
from monitor.rigs.cameras.uvc import UvcCamera, grey
from monitor.rigs.parts import make_from_kind

from .peers import need
from .vivid_guest import in_guest, run_with_vivid

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
    home = Path(__file__).parents[3]
    settings = "MICRORELIEF_VIVID=1 HOME=/tmp PYTHONDONTWRITEBYTECODE=1 NUMBA_CACHE_DIR=/tmp"
    command = f"cd {home} && {settings} {sys.executable} -m pytest -p no:cacheprovider -q {Path(__file__)} -k vivid"
    said = run_with_vivid(command, tmp_path)
    print(said)
    assert "guest ended with 0" in said
    assert " passed" in said
    assert "skipped" not in said


if in_guest():

    @pytest.fixture
    def camera() -> Iterator[UvcCamera]:
        camera = UvcCamera(device=_vivid(), size=(640, 360), pixel_format="GREY")
        yield camera
        camera.close()

    def _vivid() -> str:
        names = Path("/sys/class/video4linux").glob("video*/name")
        return f"/dev/{next(file.parent.name for file in names if 'vivid' in file.read_text())}"

    def _projector() -> object:
        """A second hand on the camera, which changes its picture as a projector would."""
        from linuxpy.video.device import Device

        device = Device(_vivid())
        device.open()
        device.controls["osd_text_mode"].value = 2
        return device

    def test_vivid_frames_keep_the_protocol(camera: UvcCamera) -> None:
        assert isinstance(camera, Camera)
        camera.open()
        camera.open()
        camera.start()
        shots = [camera.take() for _ in range(3)]
        assert {shot.image.shape for shot in shots} == {(360, 640)}
        assert not np.shares_memory(shots[0].image, shots[1].image)
        camera.close()
        camera.close()
        camera.open()
        assert camera.take().image.shape == (360, 640)

    def test_vivid_shows_in_each_frame_what_was_shown_when_it_was_asked_for(camera: UvcCamera) -> None:
        projector = _projector()
        pattern = projector.controls["test_pattern"]  # type: ignore[attr-defined]
        white, black = (next(k for k, name in pattern.data.items() if name == f"100% {c}") for c in ("White", "Black"))
        camera.open()
        camera.start()
        chance = np.random.default_rng(0)
        for _ in range(30):
            lit = bool(chance.integers(2))
            pattern.value = white if lit else black
            time.sleep(float(chance.uniform(0, 0.1)))  # the flush must hold wherever in a frame it begins
            assert (camera.take().image.mean() > 128) == lit
        projector.close()  # type: ignore[attr-defined]

    def test_vivid_controls_are_locked_and_named(camera: UvcCamera) -> None:
        camera.open()
        names = camera._names()
        assert "gain_automatic" in names
        assert camera._device.controls["gain_automatic"].value is False
        camera.close()
        with pytest.raises(InputError, match="has no control 'nosuch'"):
            UvcCamera(device=_vivid(), pixel_format="GREY", controls={"nosuch": 1}).open()
        with pytest.raises(InputError, match="has no control 'exposure_time_absolute'"):
            UvcCamera(device=_vivid(), pixel_format="GREY", exposure_ms=10).open()
        bright = UvcCamera(device=_vivid(), pixel_format="GREY", controls={"brightness": 77})
        bright.open()
        assert bright._device.controls["brightness"].value == 77
        bright.close()
        with pytest.raises(InputError, match="gives no 17x13 in GREY"):
            UvcCamera(device=_vivid(), size=(17, 13), pixel_format="GREY").open()

    @pytest.mark.parametrize("pixel_format", ["GREY", "YUYV"])
    def test_vivid_formats_show_the_same_picture(pixel_format: str) -> None:
        camera = UvcCamera(device=_vivid(), size=(640, 360), pixel_format=pixel_format)
        camera.open()
        image = camera.take().image
        assert image.shape == (360, 640)
        assert image.std() > 20  # colour bars
        camera.close()

"""What every camera keeps, each against a peer that we did not write; and what is each one's own."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from configs import DeviceUnavailable, InputError
from monitor.rigs.cameras import CAMERAS, Camera, FrameLost, lost_between
from monitor.rigs.cameras.base import to_full_range
from monitor.rigs.parts import make_from_kind

from .peers import demo_camera, emulated_basler, fake_gige_camera

RAMPS = (40 * np.arange(5)[:, None, None] + np.arange(160) // 4 + np.zeros((120, 1), int)).astype(np.uint8)
GIGE = {"kind": "gige", "address": "127.0.0.1", "region": [0, 0, 160, 120], "timeout_ms": 1000}


@pytest.fixture(params=[kind for kind in CAMERAS if kind != "uvc"])  # whose peer needs a kernel: test_uvc.py
def options(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[dict[str, Any]]:
    if request.param == "gige":
        with fake_gige_camera():
            yield dict(GIGE)
    else:
        peer: dict[str, Callable[[], dict[str, object]]] = {
            "basler": lambda: emulated_basler(tmp_path / "images", RAMPS),
            "micromanager": demo_camera,
        }
        yield peer[request.param]()


def make(options: dict[str, Any], **changed: object) -> Camera:
    return make_from_kind("camera", CAMERAS, {**options, **changed})


def opened(options: dict[str, Any]) -> Camera:
    """Open a camera; its peer may need a moment to come up."""
    camera = make(options)
    until = time.monotonic() + 30
    while True:
        try:
            camera.open()
        except DeviceUnavailable:
            if time.monotonic() > until:
                raise
        else:
            return camera


def test_every_camera_keeps_the_protocol_and_its_shape_and_count(options: dict[str, Any]) -> None:
    camera = make(options)
    assert isinstance(camera, Camera)
    with pytest.raises(DeviceUnavailable, match=r"open\(\)"):
        camera.take()
    camera.close()
    camera = opened({**options, "exposure_ms": 2.0})
    camera.open()  # harmless
    assert camera.exposure_ms == pytest.approx(2.0, rel=0.01)
    camera.start()
    shots = [camera.take() for _ in range(4)]
    assert len({(shot.image.shape, shot.image.dtype) for shot in shots}) == 1
    assert all(shot.image.flags.c_contiguous and shot.image.dtype == np.uint8 for shot in shots)
    for one, next_one in itertools.pairwise(shots):
        assert lost_between(one.number, next_one.number, camera.wraps_at) == 0
    assert not np.shares_memory(shots[0].image, shots[1].image)
    camera.close()
    camera.close()
    assert np.isnan(camera.exposure_ms)
    camera.open()
    camera.start()
    assert camera.take().image.shape == shots[0].image.shape
    camera.close()


def test_sixteen_bits_fill_the_range(options: dict[str, Any]) -> None:
    deep = {"properties": {"PixelType": "16bit", "BitDepth": "12"}} if options["kind"] == "micromanager" else None
    camera = opened({**options, **(deep or {"pixel_format": "Mono16"})})
    camera.start()
    image = camera.take().image
    assert image.dtype == np.uint16
    assert image.max() > 4095  # twelve bits as they come would stay below
    camera.close()


def test_a_setting_that_the_camera_lacks_is_named(options: dict[str, Any]) -> None:
    key = "properties" if options["kind"] == "micromanager" else "features"
    camera = make(options, **{key: {"NoSuchThing": 3}})
    with pytest.raises(InputError, match="NoSuchThing"):
        camera.open()
    camera.close()


def test_an_unknown_option_is_named_with_what_was_meant(options: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"rig option camera: camera option exposurems.*did you mean 'exposure_ms'"):
        make(options, exposurems=3)


def test_a_camera_that_is_not_there_is_unavailable(tmp_path: Path) -> None:
    absent = make({**emulated_basler(tmp_path / "images", RAMPS), "serial": "4711"})
    with pytest.raises(DeviceUnavailable, match="no Basler camera of serial 4711"):
        absent.open()


def test_pylon_replays_every_image_bit_by_bit(tmp_path: Path) -> None:
    camera = make(emulated_basler(tmp_path / "images", RAMPS))
    camera.open()
    camera.start()
    shots = [camera.take() for _ in range(len(RAMPS))]
    assert all(np.array_equal(shot.image, ramp) for shot, ramp in zip(shots, RAMPS, strict=True))
    camera.close()


def test_a_gige_count_that_wraps_loses_no_frame() -> None:
    with fake_gige_camera():
        camera = opened({**GIGE, "region": [0, 0, 16, 16], "features": {"AcquisitionFrameRate": 100.0}})
        camera.start()
        counts: list[int | None] = []
        told: list[int] = []  # how many were said to be lost before each
        while len(counts) < 140:  # the fake camera begins at 65401 for this
            lost, shot = 0, None
            while shot is None:
                try:
                    shot = camera.take()
                except FrameLost:  # a loaded machine may lose one
                    lost += 1
            counts.append(shot.number)
            told.append(lost)
        camera.close()
    assert max(count or 0 for count in counts) == 65535
    assert min(count or 0 for count in counts) == 1
    found = [lost_between(a, b, camera.wraps_at) for a, b in itertools.pairwise(counts)]
    assert all(one <= lost for one, lost in zip(found, told[1:], strict=True))
    assert sum(told) < 14


def test_lost_packets_are_a_lost_frame_and_never_a_wrong_image() -> None:
    with fake_gige_camera("-r", "20"):
        camera = opened({**GIGE, "region": [0, 0, 512, 512], "timeout_ms": 500})
        camera.start()
        whole, lost = [], 0
        for _ in range(12):
            try:
                whole.append(camera.take().image)
            except FrameLost:
                lost += 1
        camera.close()
    assert lost > 0
    assert all(image.shape == (512, 512) and image.max() > 0 for image in whole)


def test_a_gige_camera_that_is_unplugged_is_unavailable_and_comes_back() -> None:
    with fake_gige_camera() as process:
        camera = opened(dict(GIGE))
        camera.start()
        camera.take()
        process.kill()
        process.wait()
        with pytest.raises(DeviceUnavailable, match="went away"):
            _take_until_gone(camera)
        camera.close()
    with fake_gige_camera():
        again = opened(dict(GIGE))
        again.start()
        assert again.take().image.shape == (120, 160)
        again.close()


def _take_until_gone(camera: Camera) -> None:
    for _ in range(3):  # a frame that was on its way may still come
        with contextlib.suppress(FrameLost):
            camera.take()


@given(st.integers(1, 65535), st.integers(0, 1000))
def test_gaps_are_counted_through_the_wrap(before: int, missing: int) -> None:
    now = (before + missing) % 65535 + 1  # 1..65535, 0 is not used
    assert lost_between(before, now, 65535) == missing


@pytest.mark.parametrize(("before", "now"), [(None, 3), (3, None), (None, None), (7, 3)])
def test_without_a_count_nothing_is_said(before: int | None, now: int | None) -> None:
    assert lost_between(before, now, None) == 0


@given(st.integers(8, 16), st.integers(0, 2**16 - 1))
def test_the_full_range_is_a_scale(bits: int, value: int) -> None:
    image = np.array([[value % 2**bits]], np.uint16)
    assert int(to_full_range(image, bits)[0, 0]) == int(image[0, 0]) * 2 ** (16 - bits)

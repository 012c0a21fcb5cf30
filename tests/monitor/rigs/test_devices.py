"""A camera and a projector in step: frames through real drivers' emulation, lost frames, order, and the screen."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from configs import CaptureError, DeviceUnavailable, InputError
from monitor.rigs import DevicesRig, SimulatedRig, make_rig
from monitor.rigs.cameras import FrameLost, Shot
from monitor.rigs.projectors import PROJECTORS, Projector
from monitor.rigs.projectors.base import Again
from monitor.rigs.projectors.external import ExternalProjector
from monitor.visit import Recipe, make_scan, remarks, visit
from pipelines import Frames, PatternSet, parse_instant
from pipelines.reconstruction import diagnose, footprint_grid
from storage import read_capture, write_capture

from .known_optics import known_geometry
from .peers import emulated_basler, need, virtual_screen

PATTERNS = PatternSet("gray", (608, 684), bits=(8, 8))
NOW = parse_instant("2026-11-22T21:00:00Z")


@pytest.fixture(scope="module")
def seen() -> npt.NDArray[np.uint8]:
    """Frames of the simulated rig: what the emulated camera is to see."""
    rig = SimulatedRig(camera=(240, 180))
    rig.open()
    frames = rig.capture(PATTERNS, NOW)
    rig.close()
    return frames.stack.astype(np.uint8, copy=False)


def test_a_capture_through_pylon_is_the_folder_bit_by_bit(seen: npt.NDArray[np.uint8], tmp_path: Path) -> None:
    rig = make_rig("devices", {"camera": emulated_basler(tmp_path / "images", seen)})
    rig.open()
    frames = rig.capture(PATTERNS, NOW)
    rig.close()
    assert np.array_equal(frames.stack, seen)
    assert frames.exposure_ms == pytest.approx(10.0)
    assert frames.remarks == ()
    assert diagnose(frames).verdict != "reject"


class Standing:
    """A projector whose pattern stands until the next is asked for, as a screen's does."""

    again: Again = "frame"

    def open(self) -> None: ...
    def load(self, patterns: PatternSet) -> None: ...
    def show(self, frame: int) -> None: ...
    def close(self) -> None: ...


def test_a_failed_buffer_is_taken_again_and_said(seen: npt.NDArray[np.uint8], tmp_path: Path) -> None:
    twice = np.insert(seen, 7, seen[7], axis=0)  # the failed buffer uses an image up: the pattern still stands
    rig = DevicesRig(camera=emulated_basler(tmp_path / "images", twice))
    rig.projector = Standing()
    rig.open()
    _fail_after(rig, 7)
    frames = rig.capture(PATTERNS, NOW)
    rig.close()
    assert np.array_equal(frames.stack, seen)
    (remark,) = frames.remarks
    assert remark.startswith(f"frame 7 ({PATTERNS.roles[7].name}) was taken again")
    assert "incompletely grabbed" in remark
    # and the visit measures what the same frames measure from a folder, to the bit, and keeps the remark as an event
    write_capture(Frames(seen, NOW, PATTERNS), tmp_path / "folder")
    rig_geometry = known_geometry((240, 180))
    recipe = Recipe(grid=footprint_grid(rig_geometry, 0.1), patterns=PATTERNS, calibration=rig_geometry)
    tick = visit(frames, recipe, None, NOW).tick
    assert tick.scan is not None
    assert tick.scan.coverage > 0.8
    assert np.array_equal(
        tick.scan.height, make_scan(read_capture(tmp_path / "folder"), rig_geometry, recipe).height, equal_nan=True
    )
    assert any(event.kind == "note" and remark in event.text for event in tick.events)


def test_a_frame_that_never_comes_fails_the_capture(seen: npt.NDArray[np.uint8], tmp_path: Path) -> None:
    rig = DevicesRig(camera=emulated_basler(tmp_path / "images", seen))  # what projects goes on: no second try
    rig.open()
    _fail_after(rig, 3)
    with pytest.raises(CaptureError, match=r"frame 3 .*1 try.*incompletely grabbed"):
        rig.capture(PATTERNS, NOW)
    rig.close()


def _fail_after(rig: DevicesRig, frame: int) -> None:
    """Let pylon's emulation spoil the buffer that follows `frame` good ones."""
    camera = rig.camera
    take, taken = camera.take, iter(range(10**6))

    def taking() -> Shot:
        if next(taken) == frame:
            device = camera._camera  # type: ignore[attr-defined]  # the emulation's own fault, by its own setting
            device.ForceFailedBufferCount.Value = 1
            device.ForceFailedBuffer.Execute()
        return take()

    camera.take = taking  # type: ignore[method-assign]


def test_frames_one_late_are_rejected_by_what_they_show(seen: npt.NDArray[np.uint8], tmp_path: Path) -> None:
    rig = DevicesRig(camera=emulated_basler(tmp_path / "images", np.roll(seen, 1, axis=0)))
    rig.open()
    frames = rig.capture(PATTERNS, NOW)
    rig.close()
    with pytest.raises(CaptureError, match="capture rejected"):
        remarks(frames)


class Counting:
    """A camera whose count says that it made frames which never arrived."""

    wraps_at: int | None = 65535
    exposure_ms = 5.0
    awaits_trigger = False

    def __init__(self, numbers: Iterator[int | None]) -> None:
        self._numbers = numbers

    def open(self) -> None: ...
    def start(self) -> None: ...
    def close(self) -> None: ...

    def take(self) -> Shot:
        number = next(self._numbers)
        if number is None:
            raise FrameLost("damaged")
        return Shot(np.zeros((4, 5), np.uint8), number)


FOUR = PatternSet("gray", (64, 48), bits=(1, 0))


def _counted(numbers: list[int | None], projector: Projector) -> tuple[str, ...]:
    rig = DevicesRig(camera={"kind": "basler"})  # made, never opened: its parts are replaced
    rig.camera, rig.projector = Counting(iter(numbers)), projector
    rig.open()
    return rig.capture(FOUR, NOW).remarks


def test_gaps_of_the_count_are_said_and_a_retry_is_no_gap() -> None:
    assert _counted([65534, 65535, 1, 2], Standing()) == ()
    (gap,) = _counted([65534, 2, 3, 4], Standing())
    assert gap == f"2 frames lost before frame 1 ({FOUR.roles[1].name}), by the camera's own count"
    (retry,) = _counted([7, None, 9, 10, 11], Standing())
    assert retry.startswith(f"frame 1 ({FOUR.roles[1].name}) was taken again")


def test_a_frame_that_never_arrived_is_fatal_where_the_patterns_went_on() -> None:
    assert _counted([65534, 65535, 1, 2], ExternalProjector()) == ()
    with pytest.raises(CaptureError, match="1 frame lost before frame 2"):
        _counted([5, 6, 8, 9], ExternalProjector())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"camera": {"kind": "balser"}}, "rig option camera: camera name: no camera 'balser', did you mean 'basler'"),
        ({"camera": "basler"}, "rig option camera: give its kind and options"),
        ({"camera": {"kind": "basler"}, "projector": {"kind": "screan"}}, "did you mean 'screen'"),
        ({"camera": {"kind": "basler"}, "projector": {"kind": "screen", "haed": 1}}, "did you mean 'head'"),
        ({"camera": {"kind": "basler", "pixel_format": "RGB8"}}, "none of Mono8, Mono10, Mono12, Mono16"),
        ({"camera": {"kind": "basler"}, "settle_ms": -1}, "settle_ms must lie in"),
        ({"camera": {"kind": "micromanager"}}, "give either configuration, or adapter and device"),
    ],
)
def test_wrong_options_are_one_clear_line(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_rig("devices", options)


@pytest.mark.parametrize("name", list(PROJECTORS))
def test_every_projector_keeps_the_protocol(name: str) -> None:
    projector = PROJECTORS[name](**({"sets": [[0, 42]]} if name == "dlpc3478" else {}))
    assert isinstance(projector, Projector)
    projector.close()


def test_the_screen_shows_every_pattern_pixel_by_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    need("mss")
    import mss

    images = PATTERNS.images()
    with virtual_screen(*PATTERNS.size, monkeypatch) as display:
        screen = PROJECTORS["screen"](driver="x11")
        with pytest.raises(DeviceUnavailable, match=r"open\(\)"):
            screen.show(0)
        screen.open()
        screen.load(PATTERNS)
        with mss.MSS(display=display) as eye:
            for frame in [*range(len(images)), 3, 0]:
                screen.show(frame)
                shown = np.asarray(eye.grab(eye.monitors[0]))[..., :3]
                assert (shown == images[frame][:, :, None]).all(), PATTERNS.roles[frame].name
        with pytest.raises(InputError, match="320x240 pixels and the projector's screen 608x684"):
            screen.load(PatternSet("gray", (320, 240), bits=(4, 4)))
        screen.show(1)  # the refusal cost nothing
        screen.close()
        with pytest.raises(InputError, match="there is no screen 3; this computer has 1"):
            PROJECTORS["screen"](head=3, driver="x11").open()
    with pytest.raises(DeviceUnavailable, match="no window can be opened"):
        PROJECTORS["screen"](driver="x11").open()


def test_a_window_that_dies_is_a_device_that_went_away(monkeypatch: pytest.MonkeyPatch) -> None:
    with virtual_screen(64, 48, monkeypatch):
        screen = PROJECTORS["screen"](driver="x11")
        screen.open()
        screen._window.kill()  # type: ignore[attr-defined]  # a crash of the process, for real
        screen._window.wait()  # type: ignore[attr-defined]
        with pytest.raises(DeviceUnavailable, match="window was closed"):
            screen.load(FOUR)
        screen.close()
        screen.open()
        screen.load(FOUR)
        screen.close()

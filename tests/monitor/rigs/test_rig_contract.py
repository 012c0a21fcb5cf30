"""What every rig keeps: one suite, run on each member of RIGS."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from configs import CaptureError, InputError
from monitor.rigs import RIGS, Rig, make_rig, rig_options
from pipelines import Frames, PatternSet, parse_instant
from storage import write_capture

from .peers import emulated_basler, virtual_screen

PATTERNS = PatternSet("gray", (608, 684), bits=(3, 2))
NOW = parse_instant("2026-11-22T21:00:00Z")
LATER = parse_instant("2026-11-23T03:00:00Z")


def simulated_options(folder: Path) -> Mapping[str, Any]:
    return {"camera": [160, 120]}


def replay_options(folder: Path) -> Mapping[str, Any]:
    for name, brightness in (("visit_10", 90), ("visit_2", 30)):
        stack = np.full((len(PATTERNS.roles), 24, 32), brightness, np.uint8)
        stack[0] += 100
        write_capture(Frames(stack, parse_instant("2020-01-01T00:00:00Z"), PATTERNS), folder / name)
    return {"folder": str(folder)}


def seen_by_the_devices() -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    stack = np.full((len(PATTERNS.roles), 24, 32), 30, np.uint8)
    stack[0] += 100
    return stack


MEMBERS = {"simulated", "replay", "devices"}


@pytest.fixture(params=list(RIGS))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def options(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Mapping[str, Any]]:
    if name == "devices":  # pylon's emulation of a camera, and a window on a virtual screen
        with virtual_screen(608, 684, monkeypatch):
            camera = emulated_basler(tmp_path / "images", seen_by_the_devices())
            yield {"camera": camera, "projector": {"kind": "screen", "driver": "x11"}}
    else:
        yield simulated_options(tmp_path) if name == "simulated" else replay_options(tmp_path)


@pytest.fixture
def rig(name: str, options: Mapping[str, Any]) -> Rig:
    return make_rig(name, options)


def test_every_rig_is_in_this_suite() -> None:
    assert set(RIGS) == MEMBERS


def test_keeps_the_protocol(rig: Rig) -> None:
    assert isinstance(rig, Rig)


def test_frames_are_those_of_the_pattern_set_at_the_time_of_the_visit(rig: Rig) -> None:
    rig.open()
    frames = rig.capture(PATTERNS, NOW)
    assert frames.patterns == PATTERNS
    assert len(frames.stack) == len(PATTERNS.roles)
    assert frames.stack.flags.c_contiguous
    assert frames.time == NOW
    assert frames.stack[0].mean() > frames.stack[1].mean()  # white is brighter than black
    rig.close()


def test_shape_is_constant(rig: Rig) -> None:
    rig.open()
    first, second = rig.capture(PATTERNS, NOW), rig.capture(PATTERNS, LATER)
    assert first.stack.shape == second.stack.shape
    assert first.stack.dtype == second.stack.dtype
    assert second.time == LATER
    rig.close()


def test_capture_before_open_is_a_clear_error(rig: Rig) -> None:
    with pytest.raises(CaptureError, match=r"open\(\)"):
        rig.capture(PATTERNS, NOW)


def test_capture_after_close_is_a_clear_error(rig: Rig) -> None:
    rig.open()
    rig.close()
    with pytest.raises(CaptureError, match=r"open\(\)"):
        rig.capture(PATTERNS, NOW)


def test_opens_again_and_closes_twice(rig: Rig) -> None:
    rig.close()
    rig.open()
    first = rig.capture(PATTERNS, NOW)
    rig.close()
    rig.close()
    rig.open()
    again = rig.capture(PATTERNS, NOW)
    assert np.array_equal(first.stack, again.stack)
    rig.close()


def test_other_patterns_than_the_rig_can_show_are_refused(rig: Rig) -> None:
    rig.open()
    with pytest.raises((CaptureError, InputError)):
        rig.capture(PatternSet("gray", (320, 240), bits=(4, 4)), NOW)
    rig.close()


def test_unknown_option_names_the_options(name: str, options: Mapping[str, Any]) -> None:
    first = rig_options(name)[0]
    with pytest.raises(InputError, match=f"{first}x.*did you mean '{first}'.*its options are {first}"):
        make_rig(name, {**options, f"{first}x": 1})


def test_unknown_rig_names_the_rigs() -> None:
    with pytest.raises(
        InputError, match=r"no rig 'simulate', did you mean 'simulated'\?; there are simulated, replay, devices"
    ):
        make_rig("simulate", {})

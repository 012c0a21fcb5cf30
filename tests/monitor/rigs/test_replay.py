"""Replay: order, end, loop, time, and folders that are no captures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from configs import CaptureError, InputError
from monitor.rigs import ReplayRig
from pipelines import Frames, PatternSet, parse_instant
from storage import write_capture, write_patterns

PATTERNS = PatternSet("gray", (64, 48), bits=(2, 0))
NOW = parse_instant("2026-11-22T21:00:00Z")
THEN = parse_instant("2020-01-01T00:00:00Z")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in (10, 2, 1):
        write_capture(Frames(_stack(number), THEN, PATTERNS), tmp_path / "captures" / f"visit_{number}")
    return tmp_path / "captures"


def _stack(number: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    stack = np.full((len(PATTERNS.roles), 8, 10), 10 * number, np.uint8)
    stack[0] += 50
    return stack


def _numbers(rig: ReplayRig, count: int) -> list[int]:
    return [int(rig.capture(PATTERNS, NOW).stack[1, 0, 0]) // 10 for _ in range(count)]


@pytest.mark.parametrize("preload", [False, True])
def test_natural_order_then_an_end_that_says_so(folder: Path, preload: bool) -> None:
    rig = ReplayRig(folder=folder, preload=preload)
    rig.open()
    assert _numbers(rig, 3) == [1, 2, 10]
    with pytest.raises(CaptureError, match=r"all 3 captures of .* have been replayed; set loop: true"):
        rig.capture(PATTERNS, NOW)
    rig.close()
    rig.open()
    assert _numbers(rig, 1) == [1]


def test_loop_begins_again(folder: Path) -> None:
    rig = ReplayRig(folder=folder, loop=True, preload=True)
    rig.open()
    assert _numbers(rig, 5) == [1, 2, 10, 1, 2]


def test_own_times_on_request(folder: Path) -> None:
    rig = ReplayRig(folder=folder, keep_time=True)
    rig.open()
    assert rig.capture(PATTERNS, NOW).time == THEN


def test_one_capture_is_a_replay_of_one(folder: Path) -> None:
    rig = ReplayRig(folder=folder / "visit_2")
    rig.open()
    assert _numbers(rig, 1) == [2]


def test_plain_images_show_what_the_pattern_file_or_the_campaign_says(folder: Path, tmp_path: Path) -> None:
    (folder / "visit_1" / "capture.json").unlink()
    write_patterns(PATTERNS, tmp_path / "patterns")
    (file,) = (tmp_path / "patterns").glob("*.yaml")
    for rig in (ReplayRig(folder=folder), ReplayRig(folder=folder, patterns=file)):
        rig.open()
        assert _numbers(rig, 1) == [1]


def test_other_patterns_are_named(folder: Path) -> None:
    rig = ReplayRig(folder=folder)
    rig.open()
    with pytest.raises(CaptureError, match="visit_1 shows other patterns"):
        rig.capture(PatternSet("gray", (64, 48), bits=(0, 2)), NOW)


def test_no_folder_and_no_capture_in_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is no folder"):
        ReplayRig(folder=tmp_path / "nowhere")
    rig = ReplayRig(folder=tmp_path)
    with pytest.raises(InputError, match="holds no capture"):
        rig.open()

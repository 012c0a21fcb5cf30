"""Capture folders: what is read, what is skipped and named, and what is refused in one line."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from configs import InputError
from pipelines import Frames, Instant, PatternSet
from storage import read_capture, read_patterns, write_capture, write_patterns

PATTERNS = PatternSet("gray", (96, 64), bits=(7, 6))
NOON = Instant("2026-01-01T12:00:00", "ns")


def frames(dtype: type = np.uint8, gain: int = 1) -> Frames:
    """What a camera sees that looks at the whole projector, evenly lit."""
    stack: Any = ((PATTERNS.images() // 2 + 20).astype(dtype) * gain).astype(dtype)
    return Frames(np.ascontiguousarray(stack), NOON, PATTERNS, exposure_ms=8.0)


def write_images(folder: Path, stack: Any, name: Callable[[int], str]) -> None:
    folder.mkdir()
    for number, image in enumerate(stack):
        assert cv2.imwrite(str(folder / name(number)), image)


def refusal(folder: Path, patterns: PatternSet | None = PATTERNS) -> str:
    with pytest.raises(InputError) as caught:
        read_capture(folder, patterns)
    message = str(caught.value)
    assert "\n" not in message
    assert str(folder) in message
    return message


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".bmp", ".npy"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_round_trip(tmp_path: Path, suffix: str, dtype: type) -> None:
    written = frames(dtype, gain=1 if dtype is np.uint8 else 5)
    if suffix == ".bmp" and dtype is np.uint16:
        with pytest.raises(InputError, match=r"use \.png"):
            write_capture(written, tmp_path / "c", suffix=suffix)
        return
    write_capture(written, tmp_path / "c", suffix=suffix)
    read = read_capture(tmp_path / "c")
    np.testing.assert_array_equal(read.stack, written.stack)
    assert (read.time, read.patterns, read.exposure_ms) == (written.time, PATTERNS, 8.0)
    assert read.stack.dtype == dtype
    assert read.stack.flags.c_contiguous


def test_natural_order_without_a_capture_file(tmp_path: Path) -> None:
    write_images(tmp_path / "c", frames().stack, lambda number: f"{number}.png")  # 10.png sorts before 2.png by letters
    os.utime(tmp_path / "c" / "0.png", (1_767_268_800, 1_767_268_800))
    read = read_capture(tmp_path / "c", PATTERNS)
    np.testing.assert_array_equal(read.stack, frames().stack)
    assert read.time == NOON
    assert np.isnan(read.exposure_ms)


def test_jpeg_is_near_enough(tmp_path: Path) -> None:
    write_images(tmp_path / "c", frames().stack, lambda number: f"f{number:02d}.jpg")
    read = read_capture(tmp_path / "c", PATTERNS)
    assert np.abs(read.stack.astype(int) - frames().stack).mean() < 5


def test_colour_becomes_grey(tmp_path: Path) -> None:
    colour = np.repeat(frames().stack[..., np.newaxis], 3, axis=-1)
    write_images(tmp_path / "c", colour, lambda number: f"{number}.png")
    np.testing.assert_array_equal(read_capture(tmp_path / "c", PATTERNS).stack, frames().stack)


def test_twelve_bits_in_sixteen_are_scaled_to_the_whole_range(tmp_path: Path) -> None:
    write_images(tmp_path / "c", frames(np.uint16, gain=16).stack, lambda number: f"{number}.tif")
    read = read_capture(tmp_path / "c", PATTERNS)
    np.testing.assert_array_equal(read.stack, frames(np.uint16, gain=256).stack)


def test_other_files_are_named_and_skipped(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_images(tmp_path / "c", frames().stack, lambda number: f"g_{number:02d}.png")
    (tmp_path / "c" / "notes.txt").write_text("dark room")
    cv2.imwrite(str(tmp_path / "c" / "preview.png"), np.zeros((5, 6), np.uint8))
    with caplog.at_level(logging.WARNING):
        read = read_capture(tmp_path / "c", PATTERNS)
    assert len(read.stack) == len(PATTERNS.roles)
    assert "notes.txt" in caplog.text
    assert "preview.png" in caplog.text


def test_a_stray_image_of_another_size_is_skipped_whatever_its_name(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_images(tmp_path / "c", frames().stack, lambda number: f"{number:02d}.png")
    cv2.imwrite(str(tmp_path / "c" / "77.png"), np.zeros((5, 6), np.uint8))
    with caplog.at_level(logging.WARNING):
        np.testing.assert_array_equal(read_capture(tmp_path / "c", PATTERNS).stack, frames().stack)
    assert "77.png" in caplog.text


def test_the_pattern_file_in_or_beside_the_folder_is_found(tmp_path: Path) -> None:
    write_images(tmp_path / "c", frames().stack, lambda number: f"{number}.png")
    assert "--patterns FILE.yaml" in refusal(tmp_path / "c", None)
    write_patterns(PATTERNS, tmp_path / "p")
    (tmp_path / "patterns.yaml").write_text((tmp_path / "p" / "patterns.yaml").read_text())
    assert read_capture(tmp_path / "c").patterns == PATTERNS


def test_projected_images_of_write_patterns_read_back_as_a_capture(tmp_path: Path) -> None:
    write_patterns(PATTERNS, tmp_path / "p")
    np.testing.assert_array_equal(read_capture(tmp_path / "p").stack, PATTERNS.images())
    assert read_patterns(tmp_path / "p" / "patterns.yaml") == PATTERNS


def test_missing_and_empty(tmp_path: Path) -> None:
    assert "no such folder" in refusal(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    assert "no frames in it" in refusal(tmp_path / "empty")
    (tmp_path / "file").write_text("")
    assert "is a file" in refusal(tmp_path / "file")


@pytest.mark.parametrize("count", [27, 29])
def test_a_wrong_count_is_told(tmp_path: Path, count: int) -> None:
    stack = np.concatenate([frames().stack, frames().stack])[:count]
    write_images(tmp_path / "c", stack, lambda number: f"{number}.png")
    assert f"found {count} frames, the pattern set has 28" in refusal(tmp_path / "c")


def test_a_frame_of_another_size_is_named(tmp_path: Path) -> None:
    write_images(tmp_path / "c", frames().stack, lambda number: f"{number}.png")
    cv2.imwrite(str(tmp_path / "c" / "7.png"), np.zeros((10, 20), np.uint8))
    message = refusal(tmp_path / "c")
    assert "7.png: is 20x10, 27 of 28 frames are 96x64" in message


def test_mixed_depth_and_broken_images_are_named(tmp_path: Path) -> None:
    write_images(tmp_path / "c", frames().stack, lambda number: f"{number}.png")
    cv2.imwrite(str(tmp_path / "c" / "3.png"), frames(np.uint16, 256).stack[3])
    assert "3.png: has 16 bits, most frames have 8" in refusal(tmp_path / "c")
    (tmp_path / "c" / "3.png").write_bytes(b"\x89PNG no more")
    assert "3.png: is not a whole image" in refusal(tmp_path / "c")
    (tmp_path / "c" / "3.png").write_bytes(b"")
    assert "3.png: is not a whole image" in refusal(tmp_path / "c")


@pytest.mark.parametrize(
    "order",
    [
        ("white", "black", "rows", "columns"),
        ("black", "white", "columns", "rows"),
        ("columns", "rows", "white", "black"),
    ],
)
def test_a_wrong_order_is_told_with_the_right_one(tmp_path: Path, order: tuple[str, ...]) -> None:
    patterns = replace(PATTERNS, bits=(7, 7))
    stack = replace(patterns, order=order).images() // 2 + 20
    write_images(tmp_path / "c", stack, lambda number: f"{number}.png")
    message = refusal(tmp_path / "c", patterns)
    assert f"[{', '.join(order)}] decodes" in message


def capture_json(folder: Path, **changes: Any) -> Path:
    write_capture(frames(), folder)
    about = json.loads((folder / "capture.json").read_text()) | changes
    (folder / "capture.json").write_text(json.dumps({key: value for key, value in about.items() if value is not None}))
    return folder


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"microrelief_capture": 7}, "not a capture of this version"),
        ({"taken_at": "2026-01-01T12:00:00"}, "taken_at: time 2026-01-01T12:00:00 has no time zone"),
        ({"taken_at": "yesterday"}, "taken_at: 'yesterday' is not a time"),
        ({"patterns": {"kind": "grey", "size": [96, 64]}}, "patterns: kind: 'grey' is unknown"),
        ({"patterns": [1]}, "patterns: a pattern set is a mapping"),
        ({"frames": ["nine.png"]}, "nine.png: missing"),
        ({"frames": "all"}, "frames must be a list"),
        ({"exposure_ms": "long"}, "exposure_ms must be a number"),
    ],
)
def test_mistakes_in_capture_json_are_named(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    assert said in refusal(capture_json(tmp_path / "c", **changes), None)


def test_capture_json_that_is_no_json_says_where(tmp_path: Path) -> None:
    capture_json(tmp_path / "c")
    (tmp_path / "c" / "capture.json").write_text('{"microrelief_capture": 1,\n  frames: []}')
    assert "capture.json:2:3: not JSON" in refusal(tmp_path / "c", None)


def test_a_stack_file_must_be_a_stack(tmp_path: Path) -> None:
    (tmp_path / "c").mkdir()
    np.save(tmp_path / "c" / "frames.npy", np.zeros((3, 4), np.float64))
    assert "must be (frame, row, column)" in refusal(tmp_path / "c")
    (tmp_path / "c" / "frames.npy").write_bytes(b"nothing")
    assert "is no whole array" in refusal(tmp_path / "c")


def test_a_full_folder_is_not_written_into(tmp_path: Path) -> None:
    write_capture(frames(), tmp_path / "c")
    with pytest.raises(InputError, match="holds files already"):
        write_capture(frames(), tmp_path / "c")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("kind: gray\nsize: [96, 64\n", ":3:1: not YAML"),
        ("kind: gray\nsze: [96, 64]\n", ":2:1: sze: unknown key of a pattern set, did you mean 'size'"),
        ("kind: gray\nsize: [96, 64]\noffset: center\n", ":3:1: offset: 'center' is unknown, did you mean 'centred'"),
        ("", ": a pattern set is a mapping"),
    ],
)
def test_mistakes_in_a_pattern_file_have_their_place(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "patterns.yaml"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        read_patterns(file)
    assert str(caught.value).startswith(f"{file}{said}")


def test_a_missing_pattern_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such pattern file"):
        read_patterns(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="is a folder"):
        read_patterns(tmp_path)


@pytest.mark.parametrize("name", ["rendered/t0", "rendered/calib/pose0", "kamino410/capture_0"])
def test_shared_captures(shared_data: Path, name: str) -> None:
    patterns = read_patterns(shared_data / name.split("/")[0] / "patterns.yaml")
    read = read_capture(shared_data / name, patterns)
    assert read.stack.shape[0] == 42
    mean = {role.what: float(image.mean()) for role, image in zip(patterns.roles, read.stack, strict=True)}
    assert mean["white"] > mean["black"]

"""`microrelief patterns`: files written, mistakes told in one line with exit code 2."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from configs import InputError
from monitor.commands.patterns import patterns
from pipelines import PatternSet
from storage import read_patterns


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, PatternSet("gray", (608, 684))),
        ({"size": "100x80", "bits": "7x0", "offset": "centred"}, PatternSet("gray", (100, 80), (7, 0), "centred")),
        ({"kind": "stripes", "size": "960x960"}, PatternSet("stripes", (960, 960))),
        (
            {"kind": "phase", "size": "100x80", "bits": "3x3", "steps": 3},
            PatternSet("phase", (100, 80), (3, 3), steps=3),
        ),
    ],
)
def test_images_and_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: dict[str, Any], expected: PatternSet
) -> None:
    patterns(out=tmp_path / "p", **options)
    assert read_patterns(tmp_path / "p" / "patterns.yaml") == expected
    files = sorted((tmp_path / "p").glob("*.png"))
    drawn = expected.images()
    assert len(files) == len(drawn)
    for number in (0, 2, len(drawn) - 1):
        np.testing.assert_array_equal(cv2.imread(str(files[number]), cv2.IMREAD_UNCHANGED), drawn[number])
    assert f"wrote {len(drawn)} images" in capsys.readouterr().out


def test_narrow_stripes_are_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    patterns(out=tmp_path / "p", kind="stripes")
    assert "1.3 px wide, so they come out uneven" in capsys.readouterr().out


def test_a_full_folder_needs_force(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(InputError, match="holds files already, give a new folder or --force"):
        patterns(out=tmp_path, size="64x64")
    patterns(out=tmp_path, size="64x64", force=True)
    assert (tmp_path / "mine.txt").read_text() == "keep"
    assert (tmp_path / "patterns.yaml").is_file()


def test_a_pattern_file_is_drawn(tmp_path: Path) -> None:
    patterns(out=tmp_path / "a", size="64x48", bits="6x5")
    patterns(out=tmp_path / "b", patterns=tmp_path / "a" / "patterns.yaml")
    assert read_patterns(tmp_path / "b" / "patterns.yaml") == PatternSet("gray", (64, 48), (6, 5))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"size": "608"}, "--size 608: give columns and rows"),
        ({"bits": "ten"}, "--bits ten: give columns and rows"),
        ({"bits": "0x0"}, "nothing would be projected"),
        ({"kind": "stripes", "size": "100x100"}, "480 stripes do not fit on 100 columns"),
        ({"kind": "phase", "bits": "10x10"}, "use at most 9 bits"),
        ({"kind": "phase", "steps": 2}, "3 to 64 steps"),
        ({"patterns": Path("none.yaml")}, "none.yaml: no such pattern file"),
    ],
)
def test_mistakes(tmp_path: Path, options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        patterns(out=tmp_path / "p", **options)
    assert caught.value.exit_code == 2
    assert not (tmp_path / "p").exists()


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        patterns(out=tmp_path / "file" / "p", size="64x64")

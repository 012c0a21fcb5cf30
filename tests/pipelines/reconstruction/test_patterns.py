"""Pattern sets: what is drawn, what is refused, and that every projector pixel can be told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.reconstruction import PAPER_STRIPES, FrameRole, PatternSet
from pipelines.reconstruction.codebook import make_codebook
from storage import read_patterns


def test_gray_is_opencvs_pixel_by_pixel(shared_data: Path) -> None:
    import cv2

    patterns = read_patterns(shared_data / "kamino410" / "patterns.yaml")
    files = sorted((shared_data / "kamino410" / "graycode_pattern").iterdir())
    drawn = patterns.images()
    assert len(files) == len(drawn) == 42
    for file, image in zip(files, drawn, strict=True):
        np.testing.assert_array_equal(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), image, err_msg=file.name)


def test_rendered_roles_are_those_of_its_files(shared_data: Path) -> None:
    import json

    patterns = read_patterns(shared_data / "rendered" / "patterns.yaml")
    named = json.loads((shared_data / "rendered" / "t0" / "frames.json").read_text())["frames"]
    assert len(named) == len(patterns.roles)
    for frame, role in zip(named, patterns.roles, strict=True):
        axis = {"col": "columns", "row": "rows", None: ""}[frame["axis"]]
        assert (role.axis, role.index, role.inverted) == (axis, frame["bit"] or 0, frame["inverted"])


def test_the_papers_set_has_42_frames_and_says_that_its_finest_stripes_are_uneven() -> None:
    patterns = PatternSet("stripes", (608, 684))
    assert len(patterns.roles) == 42
    images = patterns.images()
    for index, count in enumerate(PAPER_STRIPES):
        line = images[2 + 2 * index, 0].astype(int)
        assert line[0] == 0, "black first"
        assert np.count_nonzero(np.diff(line)) + 1 == count
        np.testing.assert_array_equal(255 - line, images[3 + 2 * index, 0])
    assert len(patterns.remarks) == 2
    assert "1.3 px" in patterns.remarks[0]
    assert PatternSet("stripes", (960, 960)).remarks == ()


@pytest.mark.parametrize("width", [480, 608, 684, 960, 1280, 1920])
def test_table_1_codes_are_unique(width: int) -> None:
    book = PatternSet("stripes", (width, width)).codebook("columns")
    assert len(book.first) >= 480
    assert book.first[0] == 0
    assert book.last[-1] == width - 1
    assert np.all(book.first[1:] == book.last[:-1] + 1)


def test_centred_gray_on_960_columns_has_the_counts_that_the_table_rounds() -> None:
    images = PatternSet("gray", (960, 960), offset="centred").images()
    counts = [np.count_nonzero(np.diff(images[2 + 2 * k, 0].astype(int))) + 1 for k in range(10)]
    assert counts == [2, 3, 5, 9, 15, 31, 61, 121, 241, 481]


def test_codes_that_repeat_are_refused_with_the_pixels() -> None:
    with pytest.raises(ValueError, match=r"columns: the patterns do not tell projector pixels 0 and 50 apart"):
        PatternSet("stripes", (100, 100), counts=(4, 8))
    with pytest.raises(ValueError, match="both carry 01"):
        make_codebook(np.array([[False, False, False], [True, False, True]]))


@given(st.integers(2, 300), st.integers(1, 9), st.sampled_from(["none", "centred"]), st.booleans(), st.booleans())
@settings(max_examples=60, deadline=None)
def test_gray_images_carry_the_codebook(length: int, bits: int, offset: Any, pairs: bool, msb_first: bool) -> None:
    patterns = PatternSet("gray", (length, 3), bits=(bits, 0), offset=offset, complementary=pairs, msb_first=msb_first)
    words = np.zeros(length, dtype=np.int64)
    for image, role in zip(patterns.images(), patterns.roles, strict=True):
        if role.what == "bit" and not role.inverted:
            words |= (image[1] > 0).astype(np.int64) << (bits - 1 - role.index)
    book = patterns.codebook("columns")
    cells = book.cell[words]
    assert np.all(cells >= 0)
    x = np.arange(length)
    assert np.all((book.first[cells] <= x) & (x <= book.last[cells]))
    if 2**bits >= length:
        np.testing.assert_array_equal(book.centre[cells], x)
    # neighbouring cells differ in one bit: what makes one uncertain bit harmless
    assert np.all(np.bitwise_count(book.word[1:] ^ book.word[:-1]) == 1)


def test_sinusoids_have_the_period_and_steps_that_they_say() -> None:
    patterns = PatternSet("phase", (608, 684), bits=(5, 0), steps=5)
    assert patterns.period_px("columns") == 38
    images = patterns.images()[[role.what == "phase" for role in patterns.roles]].astype(float)
    assert images.shape == (5, 684, 608)
    x = np.arange(608)
    angles = 2 * np.pi * np.arange(5) / 5
    phase = np.arctan2((images[:, 0].T @ np.sin(angles)), images[:, 0].T @ np.cos(angles))
    expected = 2 * np.pi * (x + 0.5) / 38
    assert np.abs(np.angle(np.exp(1j * (phase - expected)))).max() < 0.01


@pytest.mark.parametrize(
    "patterns",
    [
        PatternSet("gray", (608, 684)),
        PatternSet("gray", (100, 50), bits=(7, 0), offset="centred", complementary=False, msb_first=False),
        PatternSet("stripes", (608, 684)),
        PatternSet("phase", (608, 684), bits=(6, 6), steps=3, order=("columns", "rows", "white", "black")),
    ],
)
def test_mapping_round_trip(patterns: PatternSet) -> None:
    assert PatternSet.from_mapping(patterns.as_mapping()) == patterns


def test_mapping_defaults() -> None:
    assert PatternSet.from_mapping({"kind": "stripes", "size": [608, 684]}).counts == PAPER_STRIPES
    assert PatternSet.from_mapping({"size": [608, 684]}) == PatternSet("gray", (608, 684), bits=(10, 10))
    assert PatternSet.from_mapping({"size": [640, 480]}).bits == (10, 9)
    assert PatternSet.from_mapping({"kind": "phase", "size": [608, 684]}).period_px("rows") == 22


@pytest.mark.parametrize(
    ("mapping", "said"),
    [
        ({"size": [608, 684], "bit": [10, 10]}, "bit: unknown key of a pattern set, did you mean 'bits'"),
        ({"kind": "grey", "size": [608, 684]}, "did you mean 'gray'"),
        ({"kind": "gray"}, "size is missing"),
        ({"size": [608]}, "size must be two whole numbers"),
        ({"size": "608x684"}, "size must be a list"),
        ({"size": [608, 684], "bits": [0, 0]}, "nothing would be projected"),
        ({"size": [608, 684], "counts": [2, 4]}, "counts belong to kind 'stripes'"),
        ({"size": [608, 684], "order": ["white", "columns", "rows"]}, "order must name each of white, black"),
        ({"size": [608, 684], "order": ["white", "black", "column", "rows"]}, "order must name"),
        ({"size": [608, 684], "complementary": "yes"}, "complementary must be true or false"),
        ({"kind": "phase", "size": [608, 684], "steps": 2}, "3 to 64 steps"),
        ({"kind": "phase", "size": [608, 684], "bits": [10, 10]}, "use at most 9 bits"),
        ([1, 2], "a pattern set is a mapping"),
    ],
)
def test_mistakes_are_named(mapping: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        PatternSet.from_mapping(mapping)


def test_names_of_roles() -> None:
    names = [FrameRole("white"), FrameRole("bit", "rows", 3, inverted=True), FrameRole("phase", "columns", 0)]
    assert [role.name for role in names] == ["white", "rows_3_inverted", "columns_phase_0"]

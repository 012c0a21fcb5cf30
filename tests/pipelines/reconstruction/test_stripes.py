"""Table 1's equal-width stripes: no gross errors, whatever the blur leaves of the finest, and an honest sigma."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipelines import LEVEL_NONE, Frames, PatternSet
from pipelines.reconstruction import decode, locate
from pipelines.reconstruction.stripe_model import apart, swing_model

from .rough_view import Rough, judge_both, see
from .synthetic_capture import NOON, View, slanted, take

PAPER = PatternSet("stripes", (608, 684))
LINES = PatternSet("stripes", (608, 40), bits=(10, 0))
WIDE = PatternSet("stripes", (960, 720))


def contrast(patterns: PatternSet, blur_px: float) -> float:
    """Share of its contrast that a Gaussian blur leaves of the finest stripes (their first harmonic)."""
    return float(np.exp(-2 * (np.pi * blur_px / (2 * patterns.narrowest_px("columns"))) ** 2))


SCENES = {
    "sharp, little noise": (PAPER, Rough(blur_px=0.4, noise=1.0, seed=3)),
    "blurred to 10 %, much noise": (PAPER, Rough(blur_px=0.86, camera_blur_px=0.35, noise=4.0, seed=11)),
    "mirrored, 960 columns, 10 %": (WIDE, Rough(blur_px=1.35, noise=3.0, density=1.2, mirrored=True, seed=4)),
    "turned, larger, coarse on the object": (
        PAPER,
        Rough((600, 800), 0.6, density=0.7, noise=2.5, turned=True, seed=6),
    ),
    "without inverses, flicker": (
        replace(PAPER, complementary=False),
        Rough(noise=1.5, flicker=0.04, seed=21),
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_no_gross_errors_where_nine_tenths_are_kept(name: str) -> None:
    patterns, rough = SCENES[name]
    if "10 %" in name:
        width = 1.0 if rough.density == 0.9 else rough.density  # camera blur in projector px, on the level
        assert contrast(patterns, np.hypot(rough.blur_px, width * rough.camera_blur_px)) < 0.13
    frames, column, row, lit = see(rough, patterns)
    for axis, verdict in zip(("columns", "rows"), judge_both(locate(frames), column, row, lit), strict=True):
        print(
            f"stripes, {name}, {axis}: {100 * verdict.kept:.1f} % of the lit kept, {verdict.gross} of {verdict.count} "
            f"more than 4 px off; robust sd {verdict.sd_px:.3f} px, error over sigma {verdict.chi:.2f}"
        )
        assert verdict.kept >= 0.9
        assert verdict.gross <= 1e-5 * verdict.count
        assert verdict.sd_px < 0.2
        assert abs(verdict.mean_px) < 0.01
        assert 0.6 < verdict.chi < 1.25, "sigma says how wrong it is"


@pytest.mark.parametrize("columns", [480, 608, 684, 960])
def test_no_two_far_places_look_alike_until_a_tenth_of_the_contrast_is_left(columns: int) -> None:
    """Why it works: the word may be wrong at a boundary, but all swings together are those of one place only."""
    patterns = PatternSet("stripes", (columns, 64), bits=(1, 0))
    model = swing_model(patterns, "columns")
    for blur, sigma in enumerate(model.blur_px):
        if contrast(patterns, float(sigma)) > 0.1:
            assert apart(patterns, "columns", blur).min() > 0.7, "of 2: a bit that is black for white"


def test_words_list_every_place_that_may_read_as_them() -> None:
    model = swing_model(PAPER, "columns")
    random = np.random.default_rng(0)
    for blur in (0, 8, 16):
        sample = random.integers(0, model.swing.shape[1], 300)
        seen = model.swing[blur, sample, : model.bits] + random.uniform(-0.3, 0.3, (300, model.bits))
        words = ((seen > 0) << np.arange(model.bits - 1, -1, -1)).sum(axis=1)
        for word, place in zip(words, sample // model.per_px, strict=True):
            listed = model.candidate[model.first[blur, word] : model.first[blur, word + 1]]
            assert place in listed


def test_what_noise_hides_is_told_by_level() -> None:
    coarse = PatternSet("stripes", (960, 40), bits=(10, 0))  # stripes of 2 px: even
    blurred = replace(slanted(90, 400, coarse.size), noise=3.0, light=110.0)
    clear = decode(take(replace(blurred, blur_px=0.5), coarse))
    dull = decode(take(replace(blurred, blur_px=2.1), coarse))
    assert np.isfinite(dull.column).mean() > 0.95
    assert np.all(clear.level[np.isfinite(clear.column)] == 0)
    assert np.mean(dull.level[np.isfinite(dull.column)] == 1) > 0.9, "the finest pattern of the ten is lost"
    assert np.nanmedian(dull.sigma_column) > 1.5 * np.nanmedian(clear.sigma_column)


def test_two_surfaces_in_one_pixel_are_refused() -> None:
    """Frames of two places add up, as at the rim of a crack: no place between them, nor far from both."""
    left, right = 200.0, 230.0
    u = np.tile(np.arange(120.0), (40, 1))
    first = View(left + 0.4 * u, np.full(u.shape, 20.0), blur_px=0.5)
    second = replace(first, column=right + 0.4 * u)
    weight = np.where(u < 60, 1.0, 0.0)
    weight[:, 60] = np.linspace(0.1, 0.9, 40)
    mixed = take(first, LINES).stack * weight + take(second, LINES).stack * (1 - weight)
    random = np.random.default_rng(1)
    decoded = decode(
        Frames(np.rint(mixed + random.normal(0, 1, mixed.shape)).clip(0, 255).astype(np.uint8), NOON, LINES)
    )
    nearest = np.minimum(np.abs(decoded.column - first.column), np.abs(decoded.column - second.column))
    assert np.nanmax(nearest) < 1.0
    assert np.isnan(decoded.column[:, 60]).mean() > 0.5
    assert np.isfinite(np.delete(decoded.column, [59, 60, 61], axis=1)).mean() > 0.98, "the edge itself stays sharp"


def test_light_from_elsewhere_and_shadow_are_refused() -> None:
    frames = take(replace(slanted(64, 200, LINES.size), noise=1.5, blur_px=0.4), LINES)
    stack = frames.stack.astype(float)
    for number, role in enumerate(LINES.roles):
        if role.what == "bit" and role.index >= 4:
            stack[number, :, :100] = stack[:2, :, :100].mean(axis=0)
    stack[:, 20:40, 130:170] = 12
    stack += np.random.default_rng(2).normal(0, 1.5, stack.shape)
    decoded = decode(Frames(np.rint(stack).clip(0, 255).astype(np.uint8), NOON, LINES))
    assert np.isfinite(decoded.column[:, :98]).mean() < 0.01, "corners of the patch, where its rim is near"
    assert np.isnan(decoded.column[20:40, 130:170]).all()
    assert np.all(decoded.level[np.isnan(decoded.column)] == LEVEL_NONE)
    assert np.isfinite(decoded.column[42:, 112:]).mean() > 0.98


@pytest.mark.parametrize(
    "change", [{"dtype": np.uint16, "gain": 200.0}, {"order": ("rows", "columns", "black", "white")}]
)
def test_neither_depth_nor_order_of_the_frames_matters(change: dict[str, Any]) -> None:
    view = replace(slanted(60, 200, LINES.size), noise=1.0, blur_px=0.4)
    patterns = replace(LINES, order=change.pop("order", LINES.order))
    decoded = decode(take(view, patterns, **change))
    known = np.isfinite(decoded.column)
    error = (decoded.column - view.column)[known]
    assert known.mean() > 0.97
    assert np.abs(error).max() < 1.0
    assert np.median(np.abs(error) / decoded.sigma_column[known]) < 1.0


def test_white_that_saturates_is_told_by_sigma() -> None:
    view = replace(slanted(60, 300, LINES.size), noise=1.0, blur_px=0.4)
    bright = decode(take(replace(view, light=290.0), LINES))
    known = np.isfinite(bright.column)
    assert known.mean() > 0.8
    error = (bright.column - view.column)[known]
    assert np.abs(error).max() < 2.0
    assert np.median(np.abs(error / bright.sigma_column[known])) < 1.0


@pytest.mark.parametrize("counts", [(2, 3, 5), (2, 3, 5, 9, 15, 30)])
def test_few_wide_stripes_tell_no_more_than_their_cell_and_say_so(counts: tuple[int, ...]) -> None:
    patterns = PatternSet("stripes", (640, 40), bits=(1, 0), counts=counts)
    view = replace(slanted(16, 400, patterns.size, density=1.5), noise=1.5, blur_px=0.5)
    decoded = decode(take(view, patterns))
    known = np.isfinite(decoded.column)
    error = (decoded.column - view.column)[known]
    assert known.mean() > 0.8
    assert np.abs(error).max() < patterns.codebook("columns").width.max()
    assert 0.7 < np.sqrt(np.mean((error / decoded.sigma_column[known]) ** 2)) < 1.3

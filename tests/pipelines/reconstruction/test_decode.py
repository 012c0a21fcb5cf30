"""Decoding against closed forms, rendered truth and real captures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines import LEVEL_NONE, Frames, PatternSet
from pipelines.reconstruction import decode, locate, refine, suggest_order
from pipelines.reconstruction.cells import Cells
from pipelines.reconstruction.light import frame_indices, read_light
from storage import read_capture, read_patterns

from .synthetic_capture import NOON, View, slanted, take

GRAY = PatternSet("gray", (200, 150), bits=(8, 8))
PHASE = PatternSet("phase", (200, 150), bits=(4, 4), steps=4)


def robust_sd(error: Any) -> float:
    return float(1.4826 * np.median(np.abs(error - np.median(error))))


@given(
    kind=st.sampled_from(["gray", "stripes", "phase"]),
    size=st.tuples(st.integers(96, 160), st.integers(96, 160)),
    offset=st.sampled_from(["none", "centred"]),
    pairs=st.booleans(),
    msb_first=st.booleans(),
    order=st.permutations(["white", "black", "columns", "rows"]),
    fewer=st.integers(0, 2),
)
@settings(max_examples=40, deadline=None)
def test_every_projector_pixel_decodes_to_its_own_cell(
    kind: Any, size: Any, offset: Any, pairs: bool, msb_first: bool, order: Any, fewer: int
) -> None:
    mapping = {"kind": kind, "size": size, "complementary": pairs, "msb_first": msb_first, "order": order}
    if kind == "gray":
        mapping |= {"offset": offset, "bits": tuple((length - 1).bit_length() - fewer for length in size)}
    if kind == "stripes":
        mapping["counts"] = (2, 3, 5, 9, 15, 30)
    patterns = PatternSet.from_mapping(mapping)
    decoded = decode(Frames(patterns.images(), NOON, patterns))
    row, column = np.mgrid[: size[1], : size[0]]
    for axis, found, true in (("columns", decoded.column, column), ("rows", decoded.row, row)):
        if kind == "phase":
            inner = np.isfinite(found)  # the brightest of a period saturates and is refused
            assert inner.mean() > 0.3
            assert np.abs(found - true)[inner].max() < 0.1
            continue
        book = patterns.codebook(axis)  # type: ignore[arg-type]  # a literal of the tuple above
        cell = np.searchsorted(book.first, true, side="right") - 1
        if kind == "stripes":  # of images without any blur nothing but the cell can be told, give or take a sample
            known = np.isfinite(found)
            assert known.mean() > 0.97
            assert np.abs(found - book.centre[cell])[known].max() < 0.4
            continue
        np.testing.assert_array_equal(found, book.centre[cell])
        sigma = decoded.sigma_column if axis == "columns" else decoded.sigma_row
        np.testing.assert_allclose(sigma, book.width[cell] / np.sqrt(12), rtol=0.01)
    if kind == "gray":
        assert np.all(decoded.level == 0)


def test_blur_noise_and_flicker_do_not_lose_pixels_or_place_them_wrongly() -> None:
    view = replace(slanted(130, 300, GRAY.size), blur_px=0.6, noise=2.0, flicker=0.01)
    decoded = decode(take(view, GRAY))
    for found, true, sigma in (
        (decoded.column, view.column, decoded.sigma_column),
        (decoded.row, view.row, decoded.sigma_row),
    ):
        good = np.isfinite(found)
        error = (found - true)[good]
        assert good.mean() > 0.98
        assert np.abs(error).max() < 1.5
        assert error.std() < 0.32, "0.289 px is a uniform error within a pixel"
        assert 0.9 < np.sqrt(np.mean((error / sigma[good]) ** 2)) < 1.15, "sigma says how wrong it is"
        assert abs(error.mean()) < 0.01


def test_sixteen_bits_decode_as_eight_do() -> None:
    view = replace(slanted(60, 200, GRAY.size), noise=1.0)
    fine = decode(take(view, GRAY, dtype=np.uint16, gain=256))
    coarse = decode(take(view, GRAY))
    both = np.isfinite(fine.column) & np.isfinite(coarse.column)
    assert both.mean() > 0.95
    np.testing.assert_array_equal(fine.column[both], coarse.column[both])
    assert np.abs(fine.texture.astype(int) - coarse.texture).max() <= 1
    assert np.abs(fine.contrast.astype(int) - coarse.contrast).max() <= 2


@pytest.mark.parametrize("pairs", [True, False])
def test_without_inverses_the_threshold_is_the_mean_of_white_and_black(pairs: bool) -> None:
    view = replace(slanted(80, 200, GRAY.size), blur_px=0.4, noise=1.0)
    decoded = decode(take(view, replace(GRAY, complementary=pairs)))
    good = np.isfinite(decoded.column)
    assert good.mean() > 0.97
    assert np.abs(decoded.column - view.column)[good].max() < 1.6


def test_shadow_is_nan_and_never_zero() -> None:
    view = replace(slanted(64, 200, GRAY.size), noise=2.0)
    frames = take(view, GRAY)
    shadow = np.s_[:, 20:40, 50:90]
    frames.stack[shadow] = np.random.default_rng(1).normal(12, 2, frames.stack[shadow].shape).clip(0).astype(np.uint8)
    decoded = decode(frames)
    inside = np.s_[20:40, 50:90]
    assert np.isnan(decoded.column[inside]).mean() > 0.999
    assert np.isnan(decoded.sigma_row[inside]).mean() > 0.999
    assert np.all(decoded.level[np.isnan(decoded.column) | np.isnan(decoded.row)] == LEVEL_NONE)
    assert np.isfinite(decoded.column[50:]).mean() > 0.98


def test_light_that_comes_from_elsewhere_is_refused() -> None:
    """Interreflection washes the fine patterns out: such pixels must not get a position."""
    view = slanted(64, 200, GRAY.size)
    frames = take(view, GRAY)
    stack = frames.stack.astype(float)
    for number, role in enumerate(GRAY.roles):
        if role.what == "bit" and role.index >= 4:
            stack[number] = stack[:2].mean(axis=0)
    noisy = stack + np.random.default_rng(2).normal(0, 1, stack.shape)
    decoded = decode(Frames(noisy.clip(0, 255).astype(np.uint8), NOON, GRAY))
    assert np.isfinite(decoded.column).mean() < 0.001


def test_one_axis_only() -> None:
    patterns = replace(GRAY, bits=(8, 0))
    view = slanted(40, 120, GRAY.size)
    decoded = decode(take(view, patterns))
    assert np.isfinite(decoded.column).all()
    assert np.isnan(decoded.row).all()
    assert np.isnan(decoded.sigma_row).all()
    assert np.all(decoded.level == 0)


def test_phase_is_sub_pixel_without_bias_and_says_how_sure_it_is() -> None:
    view = replace(slanted(80, 300, PHASE.size), noise=2.0, blur_px=0.8)
    decoded = decode(take(view, PHASE))
    for found, true, sigma in (
        (decoded.column, view.column, decoded.sigma_column),
        (decoded.row, view.row, decoded.sigma_row),
    ):
        good = np.isfinite(found)
        error = (found - true)[good]
        assert good.mean() > 0.97
        assert np.abs(error).max() < 1, "no jump by a period"
        assert abs(error.mean()) < 0.01
        assert 0.8 < np.sqrt(np.mean((error / sigma[good]) ** 2)) < 1.3


@pytest.mark.parametrize(("blur_px", "level"), [(0.6, 0), (1.6, 1), (3.0, 2)])
@pytest.mark.parametrize("pairs", [True, False])
def test_where_the_finest_stripes_are_not_resolved_the_next_coarser_are_used(
    blur_px: float, level: int, pairs: bool
) -> None:
    """A period of 4 px keeps exp(-2 (pi blur / 4)^2) of its contrast: 0.64, 0.04 and nothing."""
    patterns = replace(GRAY, complementary=pairs)
    view = replace(slanted(70, 210, GRAY.size), blur_px=blur_px, noise=1.0)
    frames = take(view, patterns)
    whole = decode(frames)
    assert (whole.level == level).mean() > 0.97
    fine = refine(frames, whole)
    for axis in ("column", "row"):
        true, sigma = getattr(view, axis), getattr(whole, f"sigma_{axis}")
        known = np.isfinite(getattr(whole, axis))
        error = (getattr(whole, axis) - true)[known]
        assert known.mean() > 0.98
        assert np.abs(error).max() < 0.75 * 2**level
        assert 0.9 < np.sqrt(np.mean((error / sigma[known]) ** 2)) < 1.15, "sigma says how wide the cells are"
        finer = (getattr(fine, axis) - true)[known]
        assert robust_sd(finer) < 0.35 * robust_sd(error), "edges of the coarser stripes place pixels within"
        assert np.abs(finer).max() < 0.75 * 2**level


@pytest.mark.parametrize("flicker", [0.01, 0.03, 0.05])
def test_light_that_flickers_from_frame_to_frame_does_not_move_edges(flicker: float) -> None:
    """Sub-pixel columns are as right as in steady light, within a tenth."""

    def rms(flicker: float) -> float:
        errors = []
        for seed in range(2):
            view = replace(slanted(90, 240, GRAY.size), blur_px=0.6, noise=2.0, flicker=flicker)
            error = locate(take(view, GRAY, seed=seed)).column - view.column
            errors.append(error[3:-3, 3:-3])
        return float(np.sqrt(np.nanmean(np.square(errors))))

    assert rms(flicker) < 1.1 * rms(0.0)


@pytest.mark.parametrize("which", ["t0", "calib/pose0"])
def test_the_light_of_pairs_is_read_off_the_frames(shared_data: Path, which: str) -> None:
    frames = read_capture(shared_data / "rendered" / which, read_patterns(shared_data / "rendered" / "patterns.yaml"))
    told = json.loads((shared_data / "rendered" / which / "frames.json").read_text())["frames"]
    light = np.array([frame["light_factor"] for frame in told])
    bits, plus, minus = frame_indices(frames.patterns)
    p, n = plus[:, : bits[0]], minus[:, : bits[0]]
    true = (light[p] - light[n]) / (light[p] + light[n])
    error = read_light(frames, 64).tilt[:, : bits[0]] - true
    assert robust_sd(error) < 0.15 * true.std()


def test_noise_is_found_in_the_frames() -> None:
    for noise in (1.0, 3.0):
        frames = take(replace(slanted(100, 300, GRAY.size), noise=noise, flicker=0.02), GRAY)
        assert read_light(frames).noise == pytest.approx(np.hypot(noise, 0.29), rel=0.1)
    alone = take(replace(slanted(100, 300, GRAY.size), noise=3.0), replace(GRAY, complementary=False))
    assert read_light(alone).noise == pytest.approx(3, rel=0.1)


def test_arrays_of_an_earlier_result_are_used_again() -> None:
    frames = take(slanted(40, 90, GRAY.size), GRAY)
    first = decode(frames)
    assert isinstance(first, Cells)
    kept = first.column.copy()
    first.steps[0][:] = 0
    again = decode(frames, into=first)
    assert isinstance(again, Cells)
    assert again.steps[0] is first.steps[0]
    assert again.contrast is first.contrast
    np.testing.assert_array_equal(again.column, kept)
    with pytest.raises(ValueError, match="frames are 90x30"):
        decode(Frames(frames.stack[:, :30], NOON, GRAY), into=first)


@pytest.mark.parametrize(("options", "said"), [({"relative": 1.5}, "relative"), ({"noise": -1.0}, "noise")])
def test_impossible_options_are_refused(options: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        decode(take(slanted(8, 8, GRAY.size), GRAY), **options)


@pytest.mark.parametrize("which", ["t0", "t1"])
def test_rendered_against_truth(shared_data: Path, which: str) -> None:
    decoded = decode(read_capture(shared_data / "rendered" / which))
    with np.load(shared_data / "rendered" / which / "truth_camera.npz") as truth:
        lit = truth["lit"].astype(bool)
        position = {"column": truth["proj_col"], "row": truth["proj_row"]}
    both = np.isfinite(decoded.column) & np.isfinite(decoded.row) & lit
    assert both.sum() >= 0.99 * lit.sum()
    for axis, true in position.items():
        error = (getattr(decoded, axis) - true)[both]
        assert abs(np.median(error)) < 0.01
        assert error.std() < 0.32
        # 100 um in depth are 2 px here
        assert np.mean(np.abs(error) > 2) < 0.0001


@pytest.mark.parametrize("pose", [0, 1, 2])
def test_kamino_board_is_decoded_smoothly(shared_data: Path, pose: int) -> None:
    decoded = decode(read_capture(shared_data / "kamino410" / f"capture_{pose}"))
    good = np.isfinite(decoded.column) & np.isfinite(decoded.row)
    assert good.mean() > 0.55
    step = np.abs(np.diff(decoded.column, axis=1))
    step = step[np.isfinite(step)]
    assert np.mean(step > 3) < 0.01


def orders(patterns: PatternSet) -> list[PatternSet]:
    return [
        replace(patterns, order=("white", "black", "rows", "columns")),
        replace(patterns, order=("black", "white", "columns", "rows")),
        replace(patterns, order=("rows", "columns", "white", "black")),
        replace(patterns, msb_first=False),
    ]


@pytest.mark.parametrize("capture", ["rendered/t0", "rendered/calib/pose4", "kamino410/capture_1"])
def test_a_wrong_order_is_seen_in_the_frames_and_the_right_one_named(shared_data: Path, capture: str) -> None:
    frames = read_capture(shared_data / capture, read_patterns(shared_data / capture.split("/")[0] / "patterns.yaml"))
    right = f"[{', '.join(frames.patterns.order)}] decodes"
    assert suggest_order(frames) == ""
    for wrong in orders(frames.patterns):
        assert right in suggest_order(replace(frames, patterns=wrong))


def test_dark_frames_say_nothing_of_their_order() -> None:
    frames = Frames(np.full((len(GRAY.roles), 20, 30), 9, np.uint8), NOON, GRAY)
    assert suggest_order(frames) == ""
    assert np.isnan(decode(frames).column).all()


def test_a_view_of_a_single_pixel_row() -> None:
    view = View(np.arange(5.0, 100)[np.newaxis], np.full((1, 95), 7.0))
    decoded = decode(take(view, GRAY))
    np.testing.assert_array_equal(decoded.column, view.column)

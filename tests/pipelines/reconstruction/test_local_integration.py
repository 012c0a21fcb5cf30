"""Local integration: faint pixels are read from sums, close to the closed form; nothing else changes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import gaussian_filter

from pipelines import Decoded, Frames, PatternSet
from pipelines.reconstruction import locate

from .synthetic_capture import NOON, View, slanted, take

GRAY = PatternSet("gray", (128, 96))
SHAPE = (120, 180)


@cache
def both(light: float) -> tuple[View, Decoded, Decoded]:
    """The view, what is decoded without integration, and with it."""
    view = replace(slanted(*SHAPE, GRAY.size), light=light, noise=1.0, blur_px=0.3)
    frames = take(view, GRAY, seed=3)
    return view, locate(frames), locate(frames, local_integration=True)


def added(before: Decoded, after: Decoded) -> npt.NDArray[np.bool_]:
    """Pixels that both axes know of only after integration."""
    known = np.isfinite(after.column) & np.isfinite(after.row)
    return known & ~(np.isfinite(before.column) & np.isfinite(before.row))


@pytest.mark.parametrize("light", [5.0, 8.0])
def test_faint_pixels_are_read_where_the_closed_form_has_them(light: float) -> None:
    view, before, after = both(light)
    new = added(before, after)
    inside = new & (view.column < GRAY.size[0] - 4) & (view.row < GRAY.size[1] - 4)
    column, row = after.column - view.column, after.row - view.row
    share = np.mean(np.isfinite(before.column)), np.mean(np.isfinite(after.column))
    spread = [1.4826 * np.median(np.abs(error[inside])) for error in (column, row)]
    pulls = [
        1.4826 * np.median(np.abs(error[inside] / sigma[inside]))
        for error, sigma in ((column, after.sigma_column), (row, after.sigma_row))
    ]
    gross = np.abs(column[inside]) + np.abs(row[inside]) > 6
    print(f"light {light}: kept {share}, sd {spread} px, over sigma {pulls}, gross {gross.sum()} of {inside.sum()}")
    assert share[1] > share[0] + 0.25
    assert max(spread) < 0.6
    assert all(0.8 < pull < 1.2 for pull in pulls)
    assert gross.sum() <= 1e-4 * inside.sum()
    assert set(np.unique(after.level[new])) <= {1, 2, 3}


def test_what_was_decoded_before_stays_to_the_bit() -> None:
    _, before, after = both(8.0)
    for axis in ("column", "row"):
        old = np.isfinite(getattr(before, axis)) & np.isfinite(before.column) & np.isfinite(before.row)
        assert old.any()
        for name in (axis, f"sigma_{axis}"):
            assert np.array_equal(getattr(before, name)[old], getattr(after, name)[old])


@pytest.mark.parametrize("shadow", [True, False])
def test_shadow_and_saturation_stay_rejected(shadow: bool) -> None:
    view, _, _ = both(8.0)
    frames = take(view, GRAY, seed=3)
    stack = frames.stack.copy()
    dark = np.random.default_rng(5).normal(12, 1.0, stack[:, 40:80, 60:120].shape)
    stack[:, 40:80, 60:120] = np.rint(dark) if shadow else 255
    after = locate(Frames(stack, frames.time, GRAY), local_integration=True)
    assert not np.isfinite(after.column[42:78, 62:118]).any()
    assert np.isfinite(after.column[10:30, 10:50]).mean() > 0.5


def test_a_window_that_spans_a_step_is_refused() -> None:
    flat = slanted(*SHAPE, GRAY.size)
    step = flat.column.copy()
    step[:, 90:] += 8
    view = replace(flat, column=np.clip(step, 0, GRAY.size[0] - 1), light=6.0, noise=1.0, blur_px=0.3)
    frames = take(view, GRAY, seed=4)
    before, after = locate(frames), locate(frames, local_integration=True)
    new = added(before, after)[:, 80:100]
    error = (after.column - view.column)[:, 80:100]
    assert new.any()
    between = new & (np.abs(error) > 2.5) & (np.abs(error) < 7)
    print(f"between the two surfaces: {between.sum()} of {new.sum()}")
    assert between.sum() <= 0.01 * new.sum()


def test_bright_captures_are_left_alone() -> None:
    frames = take(replace(slanted(*SHAPE, GRAY.size), noise=1.0, blur_px=0.3), GRAY, seed=3)
    before, after = locate(frames), locate(frames, local_integration=True)
    for name in ("column", "row", "sigma_column", "sigma_row", "level"):
        assert np.array_equal(getattr(before, name), getattr(after, name), equal_nan=True)


def test_light_that_the_lens_spills_into_a_shadow_is_not_read() -> None:
    view = replace(slanted(*SHAPE, GRAY.size), blur_px=0.3)
    stack = take(view, GRAY, seed=3).stack.astype(np.float64)
    stack[:, 40:80, 60:120] = view.dark
    noise = np.random.default_rng(6).normal(0, 1.0, stack.shape)
    seen = np.rint(gaussian_filter(stack, (0, 1.2, 1.2)) + noise).clip(0, 255).astype(np.uint8)
    frames = Frames(seen, NOON, GRAY)
    assert not added(locate(frames), locate(frames, local_integration=True))[40:80, 60:120].any()

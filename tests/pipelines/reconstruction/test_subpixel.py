"""Zero crossings place pixels within their cell, along rows or down columns of the image."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt
import pytest

from pipelines import Frames, PatternSet, parse_instant
from pipelines.reconstruction import decode, refine

Floats = npt.NDArray[np.float64]
NOON = parse_instant("2026-11-22T12:00:00Z")
SLOPE = 0.52  # projector px per camera px


def capture(patterns: PatternSet, turned: bool, noise: float = 0.0) -> tuple[Frames, Floats, Floats]:
    """What a camera with a blur of one projector pixel sees: frames and true column, row."""
    rows, columns = 90, 110
    v, u = np.mgrid[0:rows, 0:columns].astype(np.float64)
    column, row = 3.3 + SLOPE * (v if turned else u), 2.2 + SLOPE * (u if turned else v)
    images = patterns.images().astype(np.float64)
    lit = np.empty((len(images), rows, columns))
    for n, image in enumerate(images):
        total = np.zeros((rows, columns))
        for a in np.linspace(-0.75, 0.75, 7):  # a box of 1.5 px: edges are straight lines where they cross
            for b in np.linspace(-0.75, 0.75, 7):
                i = np.clip(np.floor(row + a + 0.5), 0, image.shape[0] - 1).astype(int)
                j = np.clip(np.floor(column + b + 0.5), 0, image.shape[1] - 1).astype(int)
                total += image[i, j]
        lit[n] = 20 + 180 * total / 49 / 255
    random = np.random.default_rng(0)
    lit += random.normal(0, 1, lit.shape) * noise
    return Frames(np.clip(np.rint(lit), 0, 255).astype(np.uint8), NOON, patterns), column, row


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("complementary", [True, False])
@pytest.mark.parametrize("offset", ["none", "centred"])
def test_error_falls_from_a_third_of_a_pixel(
    turned: bool, complementary: bool, offset: Literal["none", "centred"]
) -> None:
    frames, column, row = capture(PatternSet("gray", (72, 80), (7, 7), offset, complementary=complementary), turned)
    whole = decode(frames)
    fine = refine(frames, whole)
    for before, after, truth in ((whole.column, fine.column, column), (whole.row, fine.row, row)):
        known = np.isfinite(before)
        assert known.mean() > 0.9
        assert (np.isfinite(after) == known).all()
        assert (before - truth)[known].std() > 0.25
        assert np.abs(after - truth)[known & (np.abs(after - before) > 0)].mean() < 0.06
        assert np.abs(after - before)[known].max() <= 0.5 + 1e-5


def test_sigma_grows_with_noise_and_stays_where_no_edge_is() -> None:
    patterns = PatternSet("gray", (72, 80), (7, 7))
    quiet, loud = (capture(patterns, turned=False, noise=noise) for noise in (0.0, 6.0))
    a, b = (refine(frames, decode(frames)) for frames, _, _ in (quiet, loud))
    assert np.nanmedian(b.sigma_column) > 1.3 * np.nanmedian(a.sigma_column)
    assert a.sigma_column[:, 0] == pytest.approx(decode(quiet[0]).sigma_column[:, 0])


def test_phase_is_left_alone() -> None:
    patterns = PatternSet("phase", (72, 80), (3, 3), steps=4)
    frames = Frames(np.full((len(patterns.roles), 8, 9), 40, np.uint8), NOON, patterns)
    decoded = decode(frames)
    assert refine(frames, decoded) is decoded

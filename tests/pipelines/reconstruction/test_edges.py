"""Where one blurred edge lies between two pixels, and how sure: against its closed form and against drawn noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from pipelines.reconstruction.edge_formula import edge_between

FULL = 0.8, 0.6  # swings of the two pixels under even light: a dark one beside a bright one
NOISE = 0.01


def edge(width: float, at: float, noise: float = 0.0, seed: int = 0) -> tuple[float, float]:
    """Place and variance of an edge `at` px behind the first pixel, blurred by a Gaussian of `width` px."""
    a, b = FULL[0] * erf(at / width / np.sqrt(2)), -FULL[1] * erf((1 - at) / width / np.sqrt(2))
    drawn = np.array([a, b, *FULL]) + noise * np.random.default_rng(seed).standard_normal(4)
    part, variance = edge_between(*drawn.astype(np.float32), np.float32(noise**2), np.float32(0), np.float32(0))
    return float(part), float(variance)


@pytest.mark.parametrize("width", [0.5, 0.8, 1.5, 3.0])
@pytest.mark.parametrize("at", [0.1, 0.3, 0.5, 0.9])
def test_a_gaussian_edge_is_where_it_is(width: float, at: float) -> None:
    assert edge(width, at)[0] == pytest.approx(at, abs=0.01)


@pytest.mark.parametrize("width", [0.5, 0.8, 1.5, 3.0])
@pytest.mark.parametrize("at", [0.1, 0.3, 0.5, 0.9])
def test_noise_moves_an_edge_as_its_variance_says(width: float, at: float) -> None:
    drawn = [edge(width, at, NOISE, seed) for seed in range(1000)]
    profile = edge(width, at)[1]  # without noise: what straight line and error function differ by
    said = np.sqrt(np.mean([variance for _, variance in drawn]) - profile)
    print(f"blur {width} px, edge at {at} px: sd {np.std([part for part, _ in drawn]):.4f} px, said {said:.4f} px")
    assert np.std([part for part, _ in drawn]) == pytest.approx(said, rel=0.1)


@pytest.mark.parametrize("at", [0.1, 0.3, 0.7])
def test_what_the_profile_leaves_open_covers_a_straight_ramp(at: float) -> None:
    """The straight line is one end of what may be, d away: uniform from here to there has a mean square of d2 / 3."""
    width = 0.5
    a, b = erf(at / width / np.sqrt(2)), erf((1 - at) / width / np.sqrt(2))
    part, variance = edge_between(*np.array([a, -b, 1, 1], np.float32), *np.zeros(3, np.float32))
    assert variance == pytest.approx((part - a / (a + b)) ** 2 / 3, rel=1e-3)


def wave(
    share: float, stripe: float, at: float, noise: float = 0.0, seed: int = 0, off: float = 1.0
) -> tuple[float, float]:
    """As `edge`, among stripes of a width, blurred by a share of it; `off` times that width is what is said."""
    places, signs = np.arange(-8, 9), np.array([(-1) ** n for n in range(-8, 9)])
    a, b = (
        side * full * float(np.sum(signs * erf((x - places * stripe) / (share * stripe * np.sqrt(2)))))
        for side, full, x in ((1, FULL[0], at), (-1, FULL[1], 1 - at))
    )
    drawn = np.array([a, b, *FULL]) + noise * np.random.default_rng(seed).standard_normal(4)
    turn = np.float32(np.pi / (off * stripe))
    part, variance = edge_between(*drawn.astype(np.float32), np.float32(noise**2), 1 / turn, np.tan(turn / 2))
    return float(part), float(variance)


@pytest.mark.parametrize("stripe", [1.5, 1.8, 2.2, 3.0, 5.0])
@pytest.mark.parametrize("share", [0.25, 0.3, 0.4, 0.5])
def test_an_edge_among_narrow_stripes_is_where_it_is(stripe: float, share: float) -> None:
    """A single edge's formula misses it by up to 0.09 px."""
    places = np.linspace(0.02, 0.98, 25)
    found = [wave(share, stripe, at) for at in places]
    assert np.abs([part for part, _ in found] - places).max() < 0.008
    wrong = [wave(share, stripe, at, off=1.08) for at in places]
    assert np.sqrt(np.mean(([part for part, _ in wrong] - places) ** 2)) < 0.015


@pytest.mark.parametrize("share", [0.25, 0.4])
@pytest.mark.parametrize("at", [0.1, 0.5, 0.7])
def test_noise_moves_an_edge_among_narrow_stripes_as_its_variance_says(share: float, at: float) -> None:
    drawn = [wave(share, 2.2, at, NOISE, seed) for seed in range(1000)]
    said = np.sqrt(np.mean([variance for _, variance in drawn]) - wave(share, 2.2, at)[1])
    print(
        f"blur {share} of a stripe, edge at {at}: sd {np.std([part for part, _ in drawn]):.4f} px, said {said:.4f} px"
    )
    assert np.std([part for part, _ in drawn]) == pytest.approx(said, rel=0.12)

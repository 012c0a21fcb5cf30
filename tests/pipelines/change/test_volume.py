"""Volumes against closed forms, and their uncertainty against repeated noise."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from pipelines.change import Change, Motion, compare, difference, volumes
from pipelines.change.gaussian_mixture import _by_distance, _rings, _taken, gaussian_mixture
from pipelines.change.volume import error_covariance, volume_sigma
from tests.pipelines.change.scans import sampled, scan_of

PITCH = 0.02


def change_of(dz: npt.NDArray[np.floating], sigma: float = 0.002) -> Change:
    still = scan_of(np.zeros(dz.shape), PITCH, sigma=sigma / np.sqrt(2))
    return difference(scan_of(dz, PITCH, sigma=sigma / np.sqrt(2), hour=1), still, Motion.none())


def correlated(
    random: np.random.Generator, shape: tuple[int, int], cells: float, sigma: float
) -> npt.NDArray[np.float64]:
    noise = ndimage.gaussian_filter(random.normal(size=shape), cells, mode="wrap")
    # a Gaussian of s cells leaves 1 / (2 sqrt(pi) s) of white noise
    scaled: npt.NDArray[np.float64] = noise * (sigma * 2 * np.sqrt(np.pi) * cells)
    return scaled


def test_a_cone_and_a_pit() -> None:
    dz = sampled(
        lambda x, y: (
            np.maximum(0, 0.2 * (1 - np.hypot(x - 1, y - 1.5) / 0.8))
            - np.maximum(0, 0.1 * (1 - np.hypot(x - 3, y - 1.5) / 0.6))
        )
    )
    everywhere = np.ones(dz.shape, dtype=np.bool_)
    found = volumes(change_of(dz), everywhere, dz == 0)
    up, down = np.pi / 3 * 0.8**2 * 0.2, np.pi / 3 * 0.6**2 * 0.1
    assert found.gained.value == pytest.approx(up, rel=2e-3)
    assert found.lost.value == pytest.approx(down, rel=2e-3)
    assert found.net.value == pytest.approx(up - down, rel=2e-3)
    assert found.covered == 1.0


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 29))
def test_volumes_add_up(seed: int, cut: int) -> None:
    random = np.random.default_rng(seed)
    dz = random.normal(0, 0.05, (24, 30))
    dz[random.random(dz.shape) < 0.2] = np.nan
    change = change_of(dz)
    left = np.zeros(dz.shape, dtype=np.bool_)
    left[:, :cut] = True
    nowhere = np.zeros(dz.shape, dtype=np.bool_)
    whole, one, two = (volumes(change, part, nowhere) for part in (left | ~left, left, ~left))
    assert whole.net.value == pytest.approx(one.net.value + two.net.value, abs=1e-9)
    for part in (whole, one, two):
        assert part.gained.value - part.lost.value == pytest.approx(part.net.value, abs=1e-12)
        assert part.gained.value >= 0


def test_cells_not_measured_add_nothing_and_are_told() -> None:
    dz = np.full((50, 50), 0.1)
    dz[:, :10] = np.nan
    found = volumes(change_of(dz), np.ones(dz.shape, dtype=np.bool_), np.zeros(dz.shape, dtype=np.bool_))
    assert found.covered == pytest.approx(0.8)
    assert found.net.value == pytest.approx(0.1 * 50 * 40 * PITCH**2)
    empty = volumes(change_of(dz * np.nan), np.ones(dz.shape, dtype=np.bool_), np.zeros(dz.shape, dtype=np.bool_))
    assert np.isnan(empty.net.value)
    assert empty.covered == 0


def test_white_noise_gives_the_textbook_value() -> None:
    # 682,640 cells of 0.25 m with a standard deviation of 0.11584754 m: 11.7252 m3 at 95 %
    mask = np.ones((784, 871), dtype=np.bool_)
    mask.ravel()[682_640:] = False
    assert mask.sum() == 682_640
    assert 1.96 * volume_sigma(mask, np.array([0.11584754**2]), 0.25) == pytest.approx(11.725159819775277)


def test_correlated_errors_are_counted() -> None:
    sums, predicted = [], []
    shape = (200, 300)
    ground, region = np.zeros((2, *shape), dtype=np.bool_)
    ground[:, :180] = True
    region[40:160, 190:290] = True
    for seed in range(150):
        dz = correlated(np.random.default_rng(seed), shape, 4.0, 0.01)
        sums.append(dz[region].sum() * PITCH**2)
        if seed < 10:
            covariance = error_covariance(dz.astype(np.float32), ground)
            assert covariance is not None
            assert covariance.by_lag[0] == pytest.approx(1e-4, rel=0.15)
            predicted.append(volume_sigma(region, covariance.by_lag, PITCH))
    assert np.mean(predicted) == pytest.approx(np.std(sums), rel=0.25)
    white = volume_sigma(region, np.array([1e-4]), PITCH)
    assert np.std(sums) > 8 * white  # what taking the cells for independent would hide


def test_the_uncertainty_of_the_net_volume_is_honest() -> None:
    shape = (160, 240)
    ground = np.zeros(shape, dtype=np.bool_)
    ground[:, :140] = True
    truth = 0.02 * 160 * 100 * PITCH**2
    scores, gained = [], []
    for seed in range(40):
        dz = correlated(np.random.default_rng(seed), shape, 3.0, 0.01)
        dz[:, 140:] += 0.02
        found = volumes(change_of(dz, 0.01), ~ground, ground)
        scores.append((found.net.value - truth) / found.net.sigma)
        gained.append((found.gained.value - truth) / found.gained.sigma)
    assert 0.6 < np.std(scores) < 1.5
    assert np.sqrt(np.mean(np.square(gained))) < 1.7


def registered_volume(seed: int, reach: float) -> tuple[float, float, float]:
    """Net volume of a change, its sigma and the truth: white and correlated noise, levelled on the ground beside."""
    shape = (140, 180)
    ground = np.ones(shape, dtype=np.bool_)
    ground[30:110, 50:130] = False
    random = np.random.default_rng(seed)
    truth = np.where(ground, 0.0, 0.01)
    noise = random.normal(0, 0.002, shape) + correlated(random, shape, reach, 0.002)
    tilt = 0.03 + 0.004 * np.arange(shape[1]) * PITCH - 0.002 * np.arange(shape[0])[:, None] * PITCH
    still = scan_of(np.zeros(shape), PITCH, sigma=0.002)
    scan = scan_of(truth + noise + tilt, PITCH, sigma=0.002, hour=1)
    net = volumes(compare(scan, still, ground).change, ~ground, ground).net
    return net.value, net.sigma, float(truth.sum()) * PITCH**2


def check_coverage(runs: int, reach: float, spread: float, covered: tuple[float, float]) -> None:
    values, sigmas, truths = np.array([registered_volume(seed, reach) for seed in range(runs)]).T
    off = values - truths
    ratio = float(np.sqrt((sigmas**2).mean() / (off**2).mean()))
    inside = float((np.abs(off) < 1.96 * sigmas).mean())
    print(f"reach {reach}: sigma over Monte Carlo {ratio:.3f}, coverage of 95 % intervals {100 * inside:.1f} %")
    assert abs(ratio - 1) < spread
    assert covered[0] <= inside <= covered[1]


def test_sigma_is_that_of_monte_carlo_registration_included() -> None:
    check_coverage(60, 3.0, 0.2, (0.88, 1.0))  # 60 runs know a spread to 9 %


@pytest.mark.soak
@pytest.mark.parametrize("reach", [2.0, 3.0, 5.0])
def test_sigma_is_that_of_monte_carlo_in_500_runs(reach: float) -> None:
    check_coverage(500, reach, 0.1, (0.92, 0.98))


@pytest.mark.soak
@pytest.mark.parametrize("reach", [10.0, 17.5])
def test_errors_that_reach_across_the_map_widen_sigma(reach: float) -> None:
    """A correlation length (to 1/e) of a seventh and a quarter of the shorter side: ten independent values at most.

    So few do not tell sigma to a tenth; the interval holds nearly as often as it says all the same.
    """
    check_coverage(250, reach, 0.4, (0.88, 0.99))


def test_what_a_plane_takes_from_each_covariance_is_known() -> None:
    """Against the residuals' covariance, cell by cell: ``M C M``, M the projection off a plane."""
    use = np.ones((14, 11), dtype=np.bool_)
    use[4:9, 3:7] = False
    at = np.argwhere(use).astype(np.float64)
    away = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1))
    plane = np.linalg.qr(np.column_stack([np.ones(len(at)), at]))[0]
    off = np.eye(len(at)) - plane @ plane.T
    ring = np.rint(away).astype(np.intp)
    pairs = np.bincount(ring.ravel())[:6]
    scales = np.array([1.5, 4.0])
    taken = _taken(use.astype(np.float64), 1, scales, 6)
    for k, covariance in enumerate([np.eye(len(at)), *(np.exp(-(away**2) / (2 * a**2)) for a in scales)]):
        lost = np.bincount(ring.ravel(), weights=(covariance - off @ covariance @ off).ravel())[:6] / pairs
        np.testing.assert_allclose(taken[:, k], lost, atol=1e-12)


def test_a_mixture_finds_the_covariance_behind_the_residuals() -> None:
    """Given the products that errors of 0.3 white and 0.7 with a standard deviation of 8 cells have on average."""
    counts = np.ones((72, 96))
    distance = np.arange(36, dtype=np.float64)
    scale = 0.7 * 2**3.5  # one of the mixture's own
    rings = _by_distance(counts, counts, 35)
    known = 0.3 * (distance == 0) + 0.7 * _rings(scale, 1, 36)
    taken = _taken(counts, 1, np.array([scale]), 36)
    products = rings * (known - taken @ [0.3, 0.7])
    found, freedom = gaussian_mixture(rings, products, counts, 1)
    np.testing.assert_allclose(np.pad(found, (0, 36))[:36], known, atol=0.002)
    assert freedom == pytest.approx(72 * 96 / (np.pi * scale**2) - 3, rel=0.35)  # more at the border


def test_too_little_ground_falls_back_on_the_sigmas() -> None:
    dz = np.random.default_rng(0).normal(0, 0.01, (60, 60))
    region = np.ones(dz.shape, dtype=np.bool_)
    found = volumes(change_of(dz, 0.01), region, np.zeros(dz.shape, dtype=np.bool_))
    assert error_covariance(dz.astype(np.float32), np.zeros(dz.shape, dtype=np.bool_)) is None
    assert abs(found.net.value) < 3 * found.net.sigma
    assert np.isfinite(found.gained.sigma)

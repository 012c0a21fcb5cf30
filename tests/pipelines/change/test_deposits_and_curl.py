"""Deposits and edge lift against closed forms, the soils and the rendered surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from pipelines.change import compare, crack_mask, edge_lift, find_deposits, polygon_mask
from tests.pipelines.change.scans import bumps, sampled, scan_of, soil_scan

PITCH = 0.02


def bell(
    x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], at: tuple[float, float], radius: float
) -> npt.NDArray[np.float64]:
    return np.maximum(0.0, 1 - ((x - at[0]) ** 2 + (y - at[1]) ** 2) / radius**2) ** 2


def test_smooth_rims_do_not_shorten_a_volume() -> None:
    # V = pi h R^2 / 3; the heights are 5 and 4 times the noise of one cell's difference, so most of the rim is below it
    up, down = np.pi * 0.14 * 1.0**2 / 3, np.pi * 0.11 * 0.9**2 / 3
    errors = []
    for seed in range(6):
        noise = np.random.default_rng(seed).normal(0, 0.02, (2, 240, 300))
        before = sampled(bumps(), 240, 300)
        now = before + sampled(
            lambda x, y: 0.14 * bell(x, y, (1.6, 2.4), 1.0) - 0.11 * bell(x, y, (4.3, 2.2), 0.9), 240, 300
        )
        ground = np.zeros(before.shape, dtype=np.bool_)
        ground[:20] = ground[-20:] = True
        change = compare(
            scan_of(now + noise[0], sigma=0.02, hour=1), scan_of(before + noise[1], sigma=0.02), ground
        ).change
        found = find_deposits(change, stable=ground)
        assert len(found) == 2
        first, second = found
        assert (first.x_mm, first.y_mm) == pytest.approx((1.6, 2.4), abs=0.03)
        assert (second.x_mm, second.y_mm) == pytest.approx((4.3, 2.2), abs=0.03)
        assert first.height_mm == pytest.approx(0.14, abs=0.02)
        assert second.height_mm == pytest.approx(-0.11, abs=0.02)
        errors += [(first.volume.value - up) / first.volume.sigma, (second.volume.value + down) / second.volume.sigma]
        assert first.volume.value == pytest.approx(up, rel=0.05)
        assert second.volume.value == pytest.approx(-down, rel=0.05)
    assert np.sqrt(np.mean(np.square(errors))) < 2


def test_holes_in_the_footprint_are_filled_with_its_mean() -> None:
    dz = sampled(lambda x, y: 0.2 * bell(x, y, (2, 1.6), 1.0))
    random = np.random.default_rng(0)
    dz += random.normal(0, 0.005, dz.shape)
    dz[random.random(dz.shape) < 0.2] = np.nan
    change = compare(scan_of(dz, sigma=0.005, hour=1), scan_of(random.normal(0, 0.005, dz.shape), sigma=0.005)).change
    (deposit,) = find_deposits(change)
    assert deposit.covered == pytest.approx(0.8, abs=0.03)
    assert deposit.volume.value == pytest.approx(np.pi * 0.2 / 3, rel=0.05)


def test_noise_has_no_deposit() -> None:
    noise = np.random.default_rng(1).normal(0, 0.01, (2, 200, 200))
    change = compare(scan_of(noise[0], sigma=0.01, hour=1), scan_of(noise[1], sigma=0.01)).change
    assert find_deposits(change) == ()
    assert find_deposits(change, np.zeros(noise[0].shape, dtype=np.bool_)) == ()


def test_rendered_truth_with_noise(shared_data: Path) -> None:
    scans = []
    for epoch in (0, 1):
        with np.load(shared_data / "rendered" / f"t{epoch}" / "truth_dem.npz") as kept:
            noise = np.random.default_rng(epoch).normal(0, 0.02, kept["z"].shape)
            origin = float(kept["x"][0]), float(kept["y"][0])
            scans.append(scan_of(kept["z"] + noise, PITCH, sigma=0.02, hour=epoch, origin=origin))
    grid = scans[0].grid
    plate = polygon_mask([[(2.7, -4.3), (7.9, -4.3), (7.9, 4.3), (2.7, 4.3)]], grid)
    ground = polygon_mask([[(7.2, -4.3), (9.4, -4.3), (9.4, 4.3), (7.2, 4.3)]], grid)
    found = find_deposits(compare(scans[1], scans[0], ground).change, plate, ground)
    assert len(found) == 2
    for deposit, (volume, x, y) in zip(found, ((0.6434, 5.2, 1.6), (-0.3186, 5.4, -2.3)), strict=True):
        assert deposit.volume.value == pytest.approx(volume, rel=0.05)
        assert (deposit.x_mm, deposit.y_mm) == pytest.approx((x, y), abs=0.05)


def plates(
    lift: float, settled: float = 0.0, tilt: float = 0.0
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """dz and crack of two plates with a crack between, edges lifted by lift * exp(-d / 0.4 mm)."""
    x = np.arange(400) * PITCH
    distance = np.broadcast_to(np.maximum(0, np.abs(x - 4) - 0.1), (300, 400))
    dz = lift * np.exp(-distance / 0.4) - settled + tilt * (np.arange(300)[:, None] * PITCH - 3)
    return dz, np.broadcast_to(np.abs(x - 4) < 0.1, (300, 400)).copy()


@pytest.mark.parametrize(("settled", "tilt"), [(0.0, 0.0), (0.05, 0.0), (0.02, 0.01)])
def test_lift_of_a_closed_form_edge(settled: float, tilt: float) -> None:
    dz, crack = plates(0.12, settled, tilt)
    found = edge_lift(dz.astype(np.float32), crack, np.ones(dz.shape, dtype=np.bool_), PITCH)
    expected = (
        0.12 * 0.4 / 0.2 * (np.exp(-0.05 / 0.4) - np.exp(-0.25 / 0.4))
    )  # mean over the band; nothing is left inside
    assert found.value == pytest.approx(expected, abs=0.004)


def test_lift_keeps_its_uncertainty_under_noise() -> None:
    dz, crack = plates(0.12)
    everywhere = np.ones(dz.shape, dtype=np.bool_)
    truth = edge_lift(dz.astype(np.float32), crack, everywhere, PITCH).value
    scores = []
    for seed in range(20):
        noisy = dz + np.random.default_rng(seed).normal(0, 0.02, dz.shape)
        found = edge_lift(noisy.astype(np.float32), crack, everywhere, PITCH)
        scores.append((found.value - truth) / found.sigma)
    assert np.sqrt(np.mean(np.square(scores))) < 1.5


def test_without_a_crack_there_is_no_edge() -> None:
    dz, crack = plates(0.1)
    everywhere = np.ones(dz.shape, dtype=np.bool_)
    assert np.isnan(edge_lift(dz.astype(np.float32), ~everywhere, everywhere, PITCH).value)
    assert np.isnan(edge_lift((dz * np.nan).astype(np.float32), crack, everywhere, PITCH).value)


@pytest.mark.parametrize("name", ["a", "b"])
def test_soils_lift(shared_data: Path, name: str) -> None:
    before, _, truth = soil_scan(shared_data, name, 0)
    after, crack, _ = soil_scan(shared_data, name, 1)
    known = [
        truth["curl_lift_mm"][t] * np.exp(-np.maximum(0, truth["edge_distance"] - truth["width_mm"][t] / 2) / 0.8)
        - truth["settlement_mm"][t]
        for t in (0, 1)
    ]
    everywhere = np.ones(crack.shape, dtype=np.bool_)
    expected = edge_lift((known[1] - known[0]).astype(np.float32), crack, everywhere, 0.01).value
    # the definition's own answer is most of the lift at the very edge, less what reaches the interior
    at_edge = truth["curl_lift_mm"][1] - truth["curl_lift_mm"][0]
    assert 0.5 * at_edge < expected < at_edge
    change = compare(after, before).change
    found = edge_lift(change.dz, crack_mask(after) | crack_mask(before), everywhere, 0.01)
    assert found.value == pytest.approx(expected, abs=0.006)

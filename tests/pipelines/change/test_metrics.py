"""METRICS: named, with units, documented, and as sure as they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from pipelines import Scan
from pipelines.change import METRICS, compare, measure
from tests.pipelines.change.scans import bumps, sampled, scan_of

ROOT = Path(__file__).resolve().parents[3]
SHAPE = 240, 300
PITCH = 0.02


def surface(width: float, lift: float) -> npt.NDArray[np.float64]:
    def height(x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        across = (x - 3) * np.cos(0.3) + (y - 2.4) * np.sin(0.3)
        half = width / 2
        plate = 0.5 * bumps(3)(x, y) + lift * np.exp(-np.maximum(0, np.abs(across) - half) / 0.3)
        depth = np.where(np.abs(across) < half, 0.5 * (1 - (across / half) ** 2), 0.0)
        return np.asarray(plate - depth, dtype=np.float64)

    return sampled(height, *SHAPE)


def noisy(height: npt.NDArray[np.float64], seed: int, hour: int) -> Scan:
    return scan_of(height + np.random.default_rng(seed).normal(0, 0.005, SHAPE), PITCH, sigma=0.005, hour=hour)


def test_names_units_and_words() -> None:
    assert {"net_volume", "gained_volume", "lost_volume", "crack_area", "crack_length", "crack_opening"} <= set(METRICS)
    assert {"edge_lift", "covered", "coverage", "registration_residual"} <= set(METRICS)
    for name, metric in METRICS.items():
        assert name == metric.name
        assert name.isidentifier()
        assert metric.unit in {"mm", "mm2", "mm3", "1", "degree", "mm-1"}
        assert metric.title
        assert metric.definition.endswith(".")
        assert metric.uncertainty.endswith(".")


def test_an_unknown_name_is_told_what_there_is() -> None:
    scan = noisy(surface(0.2, 0), 0, 0)
    with pytest.raises(KeyError, match="net_volume"):
        measure(compare(scan, scan), ["net_volum"])


def test_a_scan_against_itself() -> None:
    scan = noisy(surface(0.2, 0), 0, 0)
    found = measure(compare(scan, scan), METRICS)
    assert list(found) == list(METRICS)
    for name in ("net_volume", "gained_volume", "lost_volume", "edge_lift", "registration_residual"):
        assert found[name].value == pytest.approx(0, abs=1e-6)
    assert found["covered"].value == 1
    assert found["crack_opening"].value == pytest.approx(0.2, abs=0.02)


def test_no_crack_seen_is_nothing_and_not_unmeasured() -> None:
    flat = noisy(sampled(bumps(3), *SHAPE), 0, 0)
    found = measure(compare(flat, flat), METRICS)
    assert found["crack_area"].value == 0
    assert found["crack_length"].value == 0
    for name in ("crack_opening", "crack_depth", "crack_volume"):
        assert found[name].value == 0, name
        assert 0 < found[name].sigma <= PITCH, name
    assert np.isnan(found["edge_lift"].value)
    hidden = scan_of(np.where(np.arange(SHAPE[1]) < 160, np.nan, flat.height), PITCH, hour=1)
    assert np.isnan(measure(compare(hidden, flat), ["crack_opening"])["crack_opening"].value)


def test_roughness_is_that_of_the_region_and_as_sure_as_it_says() -> None:
    """A wave of known amplitude under noise, beside a holder that is much rougher."""
    row, column = np.indices(SHAPE)
    wave = 0.02 * np.cos(2 * np.pi * (column + 0.5) / 60)  # even in the region: no plane in it
    holder = np.broadcast_to(column < 60, SHAPE)
    rough = np.where(holder, np.random.default_rng(1).normal(0, 1, SHAPE), wave + 0.002 * row)
    comparison = compare(noisy(rough, 2, 1), noisy(rough, 3, 0), holder)
    found = measure(comparison, ["roughness_sa", "roughness_sq", "roughness_sku", "roughness_sz"])
    passed = float(np.exp(-np.pi * np.log(2) / np.pi * (3 / 60) ** 2))  # the Gaussian's transfer at 60 cells
    truth = {"sa": 0.02 * 2 / np.pi * passed, "sq": 0.02 / np.sqrt(2) * passed, "sku": 1.5}
    for name, value in truth.items():
        one = found[f"roughness_{name}"]
        assert abs(one.value - value) < 2 * one.sigma, name
        assert one.sigma < 0.08 * value
    assert 0.04 < found["roughness_sz"].value < 0.04 + 10 * 0.005  # noise of 5 um, five of it at each end


def test_nothing_measured_is_nan_everywhere_but_in_the_shares() -> None:
    scan = noisy(surface(0.2, 0), 0, 0)
    blind = scan_of(np.full(SHAPE, np.nan), PITCH, hour=1)
    found = measure(compare(blind, scan), METRICS)
    assert found["coverage"].value == 0
    assert found["covered"].value == 0
    for name in set(METRICS) - {"coverage", "covered"}:
        assert np.isnan(found[name].value), name


def test_every_value_is_as_sure_as_it_says() -> None:
    before, after = surface(0.2, 0.0), surface(0.3, 0.08)
    ground = np.zeros(SHAPE, dtype=np.bool_)
    ground[:, :25] = ground[:, -25:] = True
    region = ~ground
    region[:, :30] = region[:, -30:] = False
    exact = compare(scan_of(after, PITCH, sigma=1e-4, hour=1), scan_of(before, PITCH, sigma=1e-4), ground, region)
    length = 240 * PITCH / np.cos(0.3)
    truth = {
        "net_volume": float((after - before)[region].sum()) * PITCH**2,
        "crack_opening": 0.3,
        "crack_length": length,
        "crack_area": 0.3 * length,
        "edge_lift": measure(exact, ["edge_lift"])["edge_lift"].value,
    }
    scores: dict[str, list[float]] = {name: [] for name in truth}
    for seed in range(6):
        comparison = compare(noisy(after, 2 * seed, 1), noisy(before, 2 * seed + 1, 0), ground, region)
        for name, found in measure(comparison, truth).items():
            scores[name].append((found.value - truth[name]) / found.sigma)
    for name, z in scores.items():
        assert np.sqrt(np.mean(np.square(z))) < 2, (name, z)

"""M3C2 on rasters: closed forms, py4dgeo on the same points, brute force where py4dgeo is not exact."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.change import Distances, m3c2

Floats = npt.NDArray[np.float64]

PITCH = 0.1
RADII: dict[str, Any] = {"normal_radii_mm": (0.53,), "radius_mm": 0.31, "max_distance_mm": 0.9}
"""No whole cells, and three segments: where py4dgeo 1.2 takes an even number it loses points."""


def relief(seed: int = 0, rows: int = 60, columns: int = 70) -> tuple[Floats, Floats]:
    """Waves with a wall, noise, holes, a lone cell; and the same changed."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:rows, :columns] * PITCH
    one = 0.4 * np.sin(x) * np.cos(1.3 * y) + random.normal(0, 0.01, x.shape)
    one[:, columns // 2 :] += 1.5
    two = one + 0.05 * np.sin(3 * x) + random.normal(0, 0.01, x.shape)
    one[10:20, 10:22] = np.nan
    two[15:30, 20:40] = np.nan
    one[40:58, 50:68] = np.nan
    return one, two


def test_a_tilted_plane_that_moved_along_its_normal() -> None:
    y, x = np.mgrid[:50, :60] * PITCH
    normal = np.array([-0.3, 0.2, 1.0]) / np.sqrt(1.13)
    plane = 0.3 * x - 0.2 * y
    found = m3c2(plane, plane + 0.11 / normal[2], PITCH, **RADII, registration_error_mm=0.01)
    np.testing.assert_allclose(found.normal.reshape(-1, 3), np.broadcast_to(normal, (3000, 3)), atol=1e-12)
    inner = (slice(12, -12), slice(12, -12))
    np.testing.assert_allclose(found.distance[inner], 0.11, atol=1e-12)
    np.testing.assert_allclose(found.spread1[inner], 0, atol=1e-7)
    np.testing.assert_allclose(found.lod[inner], 1.96 * 0.01, atol=1e-7)
    assert found.significant[inner].all()
    back = m3c2(plane + 0.11 / normal[2], plane, PITCH, **RADII)
    np.testing.assert_allclose(back.distance[inner], -0.11, atol=1e-12)


def test_white_noise_is_significant_one_time_in_twenty() -> None:
    random = np.random.default_rng(3)
    one, two = random.normal(0, 0.005, (2, 150, 150))
    found = m3c2(one, two, PITCH, normal_radii_mm=(1.53,), radius_mm=0.31, max_distance_mm=0.9)
    assert found.significant[20:-20, 20:-20].mean() == pytest.approx(0.05, abs=0.02)
    assert np.median(found.spread1) == pytest.approx(0.005, rel=0.05)
    assert np.median(found.n1) == 29  # cells within 3.1 cells of one


def brute(one: Floats, two: Floats, at: tuple[int, int], radii: tuple[float, ...]) -> tuple[Floats, float, int, int]:
    """Normal, distance and counts of one core from its definition."""
    clouds = []
    for z in (one, two):
        row, column = np.nonzero(np.isfinite(z))
        clouds.append(np.stack([column * PITCH, row * PITCH, z[row, column]], axis=1))
    core = np.array([at[1] * PITCH, at[0] * PITCH, one[at]])
    best, normal = -1.0, np.full(3, np.nan)
    for radius in radii:
        near = clouds[0][((clouds[0] - core) ** 2).sum(axis=1) < radius**2]
        values, vectors = np.linalg.eigh(np.cov(near.T))
        flat = (values[1] - values[0]) / values[2]
        if flat > best:
            best, normal = flat, vectors[:, 0] * np.sign(vectors[2, 0])
    means, counts = [], []
    for cloud in clouds:
        off = cloud - core
        along = off @ normal
        inside = ((off**2).sum(axis=1) - along**2 < RADII["radius_mm"] ** 2) & (np.abs(along) <= 0.9)
        means.append(along[inside].mean() if inside.any() else np.nan)
        counts.append(int(inside.sum()))
    return normal, float(means[1] - means[0]), counts[0], counts[1]


def test_the_most_planar_of_several_balls_counts() -> None:
    one, two = relief()
    radii = (0.33, 0.53, 0.83)
    found = m3c2(one, two, PITCH, normal_radii_mm=radii, radius_mm=0.31, max_distance_mm=0.9)
    cores = np.argwhere(np.isfinite(one))
    for row, column in cores[:: len(cores) // 150]:
        normal, distance, n1, n2 = brute(one, two, (row, column), radii)
        np.testing.assert_allclose(found.normal[row, column], normal, atol=1e-10)
        np.testing.assert_allclose(found.distance[row, column], distance, atol=1e-12)
        assert (found.n1[row, column], found.n2[row, column]) == (n1, n2)


def test_where_nothing_is_known_nothing_is_said() -> None:
    one, two = relief()
    one[49, 59] = 0.3  # a lone point has no normal
    found = m3c2(one, two, PITCH, **RADII)
    unknown = ~np.isfinite(one)
    unknown[49, 59] = True
    assert np.isnan(found.distance[unknown]).all()
    assert (found.n1[unknown] == 0).all()
    nothing = found.n2 == 0
    assert nothing.sum() > unknown.sum()
    assert np.isnan(found.distance[nothing]).all()
    assert np.isnan(found.lod[nothing]).all()
    assert not found.significant[nothing].any()


@settings(max_examples=10, deadline=None)
@given(st.integers(-25, 25), st.integers(-25, 25), st.floats(-0.04, 0.04), st.floats(-0.04, 0.04))
def test_it_does_not_matter_where_the_second_raster_begins(row: int, column: int, fx: float, fy: float) -> None:
    """The same points given from another first cell are the same points; a few borders are all that may differ."""
    one, two = relief(1, 40, 50)
    whole = m3c2(one, two, PITCH, **RADII, offset_mm=(fx, fy))
    wide = np.full((100, 110), np.nan)
    wide[30 + row : 70 + row, 30 + column : 80 + column] = two
    offset = (fx - (30 + column) * PITCH, fy - (30 + row) * PITCH)
    other = m3c2(one, wide, PITCH, **RADII, offset_mm=offset)
    np.testing.assert_array_equal(whole.n2, other.n2)
    np.testing.assert_allclose(whole.distance, other.distance, atol=1e-10)


def test_only_the_cores_that_are_asked_for() -> None:
    one, two = relief()
    some = np.zeros(one.shape, dtype=np.bool_)
    some[5:9, 20:50] = True
    part, whole = m3c2(one, two, PITCH, **RADII, core=some), m3c2(one, two, PITCH, **RADII)
    np.testing.assert_array_equal(part.distance[some], whole.distance[some])
    assert np.isnan(part.distance[~some]).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"radius_mm": 0.0}, "radius must be above 0"),
        ({"max_distance_mm": -1.0}, "max distance must be above 0"),
        ({"normal_radii_mm": ()}, "at least one normal radius"),
        ({"normal_radii_mm": (0.5, float("nan"))}, "normal radius nan must be above 0"),
        ({"registration_error_mm": -0.1}, "must not be below 0"),
        ({"core": np.ones((2, 2), dtype=np.bool_)}, "core has shape"),
    ],
)
def test_what_cannot_be_is_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        m3c2(np.zeros((5, 5)), np.zeros((5, 5)), PITCH, **{**RADII, **change})


@pytest.fixture(scope="module")
def py4dgeo(tmp_path_factory: pytest.TempPathFactory) -> dict[str, npt.NDArray[Any]]:
    """What py4dgeo says of the relief's points."""
    folder = tmp_path_factory.mktemp("oracle")
    one, two = relief()
    lengths: dict[str, Any] = {
        "pitch": PITCH,
        "radius": 0.31,
        "max_distance": 0.9,
        "registration_error": 0.01,
        "normal_radius": 0.53,
    }
    np.savez(folder / "in.npz", z1=one, z2=two, variants=["mean", "median"], **lengths)
    script = Path(__file__).with_name("oracle_py4dgeo.py")
    subprocess.run([sys.executable, str(script), "in.npz", "out.npz"], cwd=folder, check=True, capture_output=True)
    with np.load(folder / "out.npz") as said:
        return {name: said[name] for name in said.files}


def check(found: Distances, at: npt.NDArray[np.bool_], said: dict[str, npt.NDArray[Any]]) -> None:
    """The bars: median and p99 of the difference, counts, significance."""
    distance = found.distance[at]
    both = np.isfinite(distance) & np.isfinite(said["distance"])
    np.testing.assert_array_equal(np.isfinite(distance), np.isfinite(said["distance"]))
    off = np.abs(distance - said["distance"])[both]
    assert np.median(off) <= 1e-6
    assert np.quantile(off, 0.99) <= 1e-5
    for name in ("n1", "n2"):
        assert (getattr(found, name)[at] == said[name]).mean() >= 0.999
    several = np.minimum(said["n1"], said["n2"]) > 1  # py4dgeo's median variant finds a single point's spread to be 0
    for name in ("spread1", "spread2", "lod"):
        assert np.quantile(np.abs(getattr(found, name)[at] - said[name])[both & several], 0.99) <= 1e-5
    sure = several & (np.abs(said["distance"]) > said["lod"])
    assert (found.significant[at] == sure).mean() >= 0.999


@pytest.mark.parametrize("variant", ["mean", "median"])
def test_as_py4dgeo_on_the_same_points(
    py4dgeo: dict[str, npt.NDArray[Any]], variant: Literal["mean", "median"]
) -> None:
    one, two = relief()
    found = m3c2(one, two, PITCH, **RADII, registration_error_mm=0.01, statistic=variant)
    said = {name.removeprefix(f"{variant}_"): each for name, each in py4dgeo.items() if name.startswith(variant)}
    check(found, np.isfinite(one), said)
    assert np.abs(found.normal[np.isfinite(one)] - said["normals"]).max() < 1e-9


def test_the_published_surface_with_a_known_warp(shared_data: Path) -> None:
    with np.load(shared_data / "change" / "tmd1_warp.npz") as kept:
        said = {name: kept[name] for name in kept.files}
    normal_radius, radius, most, error = said["params"]
    found = m3c2(
        said["z1"],
        said["z2"],
        float(said["px"]),
        normal_radii_mm=(normal_radius,),
        radius_mm=radius,
        max_distance_mm=most,
        registration_error_mm=error,
    )
    check(found, np.isfinite(said["z1"]), said)
    off = np.abs(found.distance.ravel() - said["distance"])
    print(f"tmd1: distance off by {np.median(off):.1e} mm (median), {np.quantile(off, 0.99):.1e} mm (p99)")

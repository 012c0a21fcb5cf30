"""The compiled passes of a comparison against scipy's and numpy's on the same input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from pipelines.change.covariance import covariance_by_lag
from pipelines.change.crack_profiles import crack_profiles
from pipelines.change.distance import inner_distance
from pipelines.change.extremes import greatest, least
from pipelines.change.plate_sums import band_sums

shapes = st.tuples(st.integers(1, 40), st.integers(1, 40))


@settings(max_examples=60, deadline=None)
@given(arrays(np.bool_, shapes))
def test_distances_are_those_of_scipy(mask: np.ndarray) -> None:
    if mask.all():
        assert (inner_distance(mask) == sum(mask.shape)).all()
    else:
        np.testing.assert_array_equal(inner_distance(mask), ndimage.distance_transform_edt(mask))


@pytest.mark.parametrize("share", [0.5, 0.99, 0.9999])
def test_distances_of_a_map_in_several_slabs(share: float) -> None:
    mask = np.random.default_rng(1).random((300, 410)) < share
    mask[7, 9] = False
    np.testing.assert_array_equal(inner_distance(mask), ndimage.distance_transform_edt(mask))


@settings(max_examples=60, deadline=None)
@given(shapes, st.integers(0, 30), st.integers(0, 2**32 - 1))
def test_extremes_are_those_of_scipy(shape: tuple[int, int], reach: int, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=shape).astype(np.float32)
    cells = 2 * reach + 1
    np.testing.assert_array_equal(greatest(values, cells), ndimage.maximum_filter(values, cells, mode="nearest"))
    np.testing.assert_array_equal(least(values, cells), ndimage.minimum_filter(values, cells, mode="nearest"))


def test_extremes_of_a_map_in_several_slabs_pass_over_missing_cells() -> None:
    random = np.random.default_rng(2)
    values = random.normal(size=(200, 333)).astype(np.float32)
    values[random.random(values.shape) < 0.4] = -np.inf
    for cells in (3, 11, 133):
        np.testing.assert_array_equal(greatest(values, cells), ndimage.maximum_filter(values, cells, mode="nearest"))


def test_profiles_are_bilinear_and_end_at_the_border() -> None:
    rows, columns = np.mgrid[:60, :70]
    height = (0.3 * rows - 0.2 * columns + 0.01 * rows * columns).astype(np.float32)
    height[30, 40] = np.nan
    mask = columns > 35
    row, column = np.array([20.3, 30.2, 2.0]), np.array([30.1, 38.0, 3.0])
    normal = np.array([[0.6, 0.8], [1.0, 0.0], [-1.0, 0.0]])
    distance = np.arange(0.0, 8.5, 0.5)
    z, inside = crack_profiles(height, mask, row, column, normal, distance)
    y, x = row[:, None] + normal[:, 1:] * distance, column[:, None] + normal[:, :1] * distance
    exact = 0.3 * y - 0.2 * x + 0.01 * y * x  # bilinear, so that interpolation is exact
    np.testing.assert_allclose(z[0], exact[0], rtol=1e-6)
    np.testing.assert_array_equal(inside[:2], np.rint(x[:2]) > 35)
    # the missing cell is NaN where it is the nearest, and only there
    np.testing.assert_array_equal(np.isnan(z[1]), np.rint(x[1]) == 40)
    beyond = np.rint(x[2]) < 0
    assert np.isnan(z[2][beyond]).all()
    assert np.isfinite(z[2][~beyond]).all()


def test_a_band_gives_the_line_and_the_parabola_of_least_squares() -> None:
    random = np.random.default_rng(3)
    d = random.uniform(0, 1, 4000)
    dz = 0.02 - 0.1 * d + 0.3 * d**2 + random.normal(0, 0.01, d.size)
    then = 0.5 * d + random.normal(0, 0.1, d.size)
    dz[::7] = np.nan
    use = np.isfinite(dz) & (d > 0.05) & (d < 0.65)
    found = band_sums(d, dz, then, 0.05, 0.65)
    assert found.slope_now == pytest.approx(np.polyfit(d[use], dz[use], 1)[0], rel=1e-9)
    assert found.slope_then == pytest.approx(np.polyfit(d[use], then[use], 1)[0], rel=1e-9)
    assert found.bend == pytest.approx(np.polyfit(d[use], dz[use], 2)[0], rel=1e-9)
    rest = d[use] ** 2 - np.polyval(np.polyfit(d[use], d[use] ** 2, 1), d[use])
    assert found.bend_lever == pytest.approx(float(rest @ rest), rel=1e-9)


def test_a_covariance_counts_every_pair() -> None:
    random = np.random.default_rng(4)
    use = random.random((13, 17)) < 0.8
    values = np.where(use, random.normal(size=use.shape), 0.0)
    row, column = np.nonzero(use)
    lag = np.rint(np.hypot(row[:, None] - row, column[:, None] - column)).astype(int)
    product = values[use][:, None] * values[use]
    exact = [product[lag == h].mean() for h in range(6)]
    np.testing.assert_allclose(covariance_by_lag([(values, use)], 5), exact, atol=1e-12)

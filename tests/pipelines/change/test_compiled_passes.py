"""The compiled passes of a comparison against scipy's and numpy's on the same input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from pipelines.change.bands import band_passed
from pipelines.change.covariance import covariance_by_lag, covariance_of_sums, error_covariance
from pipelines.change.crack_profiles import crack_profiles
from pipelines.change.distance import inner_distance, nearest_outside
from pipelines.change.extremes import greatest, least
from pipelines.change.plate_sums import band_sums
from pipelines.change.ranks import median, robust_sigma
from pipelines.change.roughness_kernels import gaussian_mean
from pipelines.change.smoothing import local_mean, local_median
from pipelines.change.squares import grown, shrunk
from tests.pipelines.change.scans import scan_of

shapes = st.tuples(st.integers(1, 40), st.integers(1, 40))


@settings(max_examples=60, deadline=None)
@given(arrays(np.bool_, shapes))
def test_distances_are_those_of_scipy(mask: np.ndarray) -> None:
    if mask.all():
        assert (inner_distance(mask) == sum(mask.shape)).all()
    else:
        np.testing.assert_array_equal(inner_distance(mask), ndimage.distance_transform_edt(mask))


@settings(max_examples=60, deadline=None)
@given(arrays(np.bool_, shapes))
def test_the_nearest_cell_outside_is_that_of_scipy(mask: np.ndarray) -> None:
    mask[0, 0] = False
    at = ndimage.distance_transform_edt(mask, return_distances=False, return_indices=True)
    for found, expected in zip(nearest_outside(mask), at, strict=True):
        np.testing.assert_array_equal(found[mask], expected[mask])


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
    missing = random.random(values.shape) < 0.4
    missing[20:60, 30:80] = True
    values[missing] = np.nan
    for cells in (3, 11, 133):
        for ours, peer, none in ((greatest, ndimage.maximum_filter, -np.inf), (least, ndimage.minimum_filter, np.inf)):
            filled = np.where(missing, np.float32(none), values)
            np.testing.assert_array_equal(ours(values, cells), peer(filled, cells, mode="nearest"))


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


@settings(max_examples=40, deadline=None)
@given(arrays(np.bool_, shapes), st.integers(1, 3))
def test_masks_grow_and_shrink_as_those_of_scipy(mask: np.ndarray, times: int) -> None:
    square = np.ones((3, 3), dtype=np.bool_)
    np.testing.assert_array_equal(grown(mask, times), ndimage.binary_dilation(mask, square, iterations=times))
    np.testing.assert_array_equal(shrunk(mask, times), ndimage.binary_erosion(mask, square, iterations=times))


@pytest.mark.parametrize("kind", ["normal", "steps", "one value", "two lumps"])
@pytest.mark.parametrize("count", [2, 7, 250_001, 300_000])
def test_medians_are_those_of_numpy(kind: str, count: int) -> None:
    random = np.random.default_rng(count)
    values = random.normal(size=count).astype(np.float32)
    if kind == "steps":
        values = np.round(values)
    elif kind == "one value":
        values[:] = 3
    elif kind == "two lumps":  # the median lies where a sample has nothing
        values = np.where(np.arange(count) < count // 2, values - 100, values + 100)
    values[1::9] = np.nan
    use = random.random(count) < 0.7
    use[0] = True
    assert median(values) == np.nanmedian(values)
    assert median(values, use) == np.nanmedian(values[use])
    middle = np.nanmedian(values)
    assert robust_sigma(values) == pytest.approx(1.4826 * np.nanmedian(np.abs(values - middle)), rel=1e-6)


@pytest.mark.parametrize("cells", [3, 5, 7])
def test_local_means_are_those_of_scipy(cells: int) -> None:
    random = np.random.default_rng(cells)
    values = random.normal(5, 1, (300, 65)).astype(np.float32)
    values[random.random(values.shape) < 0.6] = np.nan
    use = random.random(values.shape) < 0.8
    good = np.isfinite(values) & use
    count = np.rint(ndimage.uniform_filter(good.astype(np.float64), cells, mode="constant") * cells**2)
    total = ndimage.uniform_filter(np.where(good, values, 0.0), cells, mode="constant") * cells**2
    expected = np.where(count >= 0.25 * cells**2, total / np.maximum(count, 1), np.nan)
    np.testing.assert_allclose(local_mean(values, cells, use=use), expected, rtol=1e-6)


@pytest.mark.parametrize("cells", [5, 60])
def test_wide_medians_are_those_of_blocks(cells: int) -> None:
    random = np.random.default_rng(cells)
    values = random.normal(size=(331, 200)).astype(np.float32)
    values[random.random(values.shape) < 0.2] = np.nan
    values[70:84, 56:70] = np.nan
    block = max(1, cells // 8)
    rows, columns = (-(-n // block) for n in values.shape)
    of_blocks = np.empty((rows, columns), dtype=np.float32)
    for r, c in np.ndindex(rows, columns):
        known = values[r * block : (r + 1) * block, c * block : (c + 1) * block].ravel()
        known = np.sort(known[np.isfinite(known)])
        of_blocks[r, c] = known[(known.size - 1) // 2] if known.size else np.nanmedian(values)
    of_blocks = ndimage.median_filter(of_blocks, 9, mode="nearest")
    at = np.meshgrid(*((np.arange(n) + 0.5) / block - 0.5 for n in values.shape), indexing="ij")
    expected = ndimage.map_coordinates(of_blocks, at, order=1, mode="nearest")
    np.testing.assert_allclose(local_median(values, cells), expected, atol=1e-6)


def test_a_gaussian_mean_is_that_of_scipy() -> None:
    random = np.random.default_rng(9)
    values = random.normal(size=(150, 70))
    values[random.random(values.shape) < 0.3] = np.nan
    known = np.isfinite(values)
    for sigma in (0.56, 3.3):
        total, weight = (
            ndimage.gaussian_filter(each, sigma, mode="constant", truncate=5)
            for each in (np.where(known, values, 0.0), known.astype(np.float64))
        )
        np.testing.assert_allclose(gaussian_mean(values, sigma), np.where(known, total / weight, np.nan), rtol=1e-9)


def test_bands_are_those_of_scipy() -> None:
    random = np.random.default_rng(6)
    height = 40 + ndimage.gaussian_filter(random.normal(size=(150, 90)), 2)
    height[random.random(height.shape) < 0.1] = np.nan
    scan = scan_of(height, texture=random.uniform(0, 255, height.shape))
    good = np.isfinite(scan.height)

    def smooth(values: np.ndarray, sigma: float) -> np.ndarray:
        over = [ndimage.gaussian_filter(np.where(good, v, 0.0), sigma, truncate=3.0) for v in (values, np.ones(1))]
        return np.asarray(over[0] / np.maximum(over[1], 1e-3))

    channels = scan.height.astype(np.float64), scan.texture.astype(np.float64)
    for found, values in zip(band_passed(scan), channels, strict=True):
        expected = np.where(good, smooth(values, 1.0) - smooth(values, 8.0), np.nan)
        np.testing.assert_allclose(found, expected, atol=2e-6 * float(np.nanmax(values)))
    for part, whole in zip(band_passed(scan, 40, 77), band_passed(scan), strict=True):
        np.testing.assert_allclose(part, whole[40:77], atol=1e-4)


def test_blocks_tell_the_variance_of_a_volume_as_cells_do() -> None:
    random = np.random.default_rng(7)
    shape = (360, 400)
    error = ndimage.gaussian_filter(random.normal(size=shape), 4.0) + random.normal(0, 0.02, shape)
    ground, region = np.zeros((2, *shape), dtype=np.bool_)
    ground[:, :250] = region[60:300, 260:390] = True
    ground[random.random(shape) < 0.2] = False
    sigmas = []
    for side in (1, 2, 4):
        found = error_covariance(error.astype(np.float32), ground, side)
        assert found is not None
        blocks = region.reshape(shape[0] // side, side, shape[1] // side, side).sum(axis=(1, 3)).astype(np.float64)
        sigmas.append(float(np.sqrt(covariance_of_sums([blocks], found.by_lag)[0, 0])))
        assert found.variance == pytest.approx(error[ground].var(), rel=0.02)
    assert sigmas[1] == pytest.approx(sigmas[0], rel=0.03)
    assert sigmas[2] == pytest.approx(sigmas[0], rel=0.03)

"""Parts of a mask, and a mask that spreads within another, against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from pipelines.change.parts import by_part, part_greatest, part_sums, parts, spread

SQUARE = np.ones((3, 3), dtype=np.bool_)
shapes = st.tuples(st.integers(1, 30), st.integers(1, 30))


def same(mask: np.ndarray, *, diagonal: bool) -> None:
    labels, count = parts(mask, diagonal=diagonal)
    expected, expected_count = ndimage.label(mask, structure=SQUARE if diagonal else None)
    assert count == expected_count
    np.testing.assert_array_equal(labels, expected)


@settings(max_examples=60, deadline=None)
@given(arrays(np.bool_, shapes), st.booleans())
def test_parts_are_those_of_scipy(mask: np.ndarray, diagonal: bool) -> None:
    same(mask, diagonal=diagonal)


@pytest.mark.parametrize("diagonal", [True, False])
@pytest.mark.parametrize("share", [0.4, 0.6, 0.95])
def test_parts_of_a_map_in_several_slabs(share: float, diagonal: bool) -> None:
    same(np.random.default_rng(1).random((600, 130)) < share, diagonal=diagonal)


@settings(max_examples=60, deadline=None)
@given(arrays(np.bool_, (17, 23)), arrays(np.bool_, (17, 23)), st.integers(1, 9))
def test_a_mask_spreads_as_scipys_does(seeds: np.ndarray, within: np.ndarray, steps: int) -> None:
    expected = ndimage.binary_dilation(seeds, SQUARE, iterations=steps, mask=within | seeds)
    np.testing.assert_array_equal(spread(seeds, within, steps), expected)
    np.testing.assert_array_equal(spread(seeds, within), ndimage.binary_propagation(seeds, SQUARE, within | seeds))


def test_sums_and_greatest_values_by_part() -> None:
    random = np.random.default_rng(2)
    mask, where = random.random((2, 600, 90)) < 0.5
    values = random.normal(size=mask.shape).astype(np.float32)
    labels, count = parts(mask, diagonal=False)
    names = np.arange(count + 1)
    expected = ndimage.sum_labels(values, labels, names) * (names > 0)
    np.testing.assert_allclose(part_sums(labels, count, values), expected, atol=1e-9)
    expected = ndimage.sum_labels(where, labels, names) * (names > 0)
    np.testing.assert_array_equal(part_sums(labels, count, where), expected)
    np.testing.assert_array_equal(part_sums(labels, count, mask, where), expected)
    most = part_greatest(labels, count, values)
    np.testing.assert_array_equal(most[1:], np.maximum(ndimage.maximum(values, labels, names[1:]), 0))
    np.testing.assert_array_equal(by_part(labels, most), most[labels])

"""Slabs: all rows once and in order, whoever works on them; errors come out when nothing goes on any more."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import numba
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines.slabs import in_slabs, side_by_side


@given(st.integers(0, 500), st.integers(0, 70), st.integers(1, 100))
def test_stretches_are_all_rows_in_order(rows: int, step: int, least: int) -> None:
    stretches = in_slabs(rows, lambda first, last: (first, last), step=step, least=least)
    assert [row for first, last in stretches for row in range(first, last)] == list(range(rows))


@pytest.mark.usefixtures("two_cores")
def test_jobs_that_share_out_jobs_wait_for_nobody() -> None:
    """Many ask at once, and each of their jobs asks again, far more than there are threads."""

    def nested(depth: int) -> int:
        return 1 if depth == 0 else sum(side_by_side(*(lambda: nested(depth - 1) for _ in range(3))))

    with ThreadPoolExecutor(6) as people:
        assert list(people.map(nested, [4] * 12, timeout=60)) == [3**4] * 12


@pytest.fixture
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine of two cores, whatever this one has and other tests have left."""
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 2)


@pytest.mark.usefixtures("two_cores")
def test_the_first_error_is_raised_once_the_others_have_ended() -> None:
    ended: list[int] = []
    under_way = threading.Event()

    def fails() -> None:
        under_way.wait(10)
        raise ValueError("the first")

    def ends() -> None:
        under_way.set()
        ended.append(1)
        raise KeyError("a later one")

    with pytest.raises(ValueError, match="the first"):
        side_by_side(fails, ends)
    assert ended == [1]


@pytest.mark.usefixtures("two_cores")
def test_two_work_at_the_same_time() -> None:
    both = threading.Barrier(2, timeout=10)
    assert sorted(side_by_side(both.wait, both.wait)) == [0, 1]

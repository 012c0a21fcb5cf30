"""Raw frames come back to the bit, are let go when they are old, and cost few files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipelines import Frames, PatternSet, Tick
from storage import Store, create_store, open_store

from .ticks import GRID, METRICS, at, surface, tick

Depth = type[np.uint8] | type[np.uint16]
PATTERNS = PatternSet("phase", (64, 32), bits=(4, 0), steps=3)
DEPTHS: tuple[Depth, ...] = (np.uint8, np.uint16, np.uint8)


def capture(number: int, depth: Depth = np.uint8, size: tuple[int, int] = (6, 8)) -> Frames:
    rng = np.random.default_rng(number)
    stack: Any = rng.integers(0, np.iinfo(depth).max + 1, (len(PATTERNS.roles), *size)).astype(depth)
    return Frames(stack, surface(number).time, PATTERNS, 8.0)


def with_frames(number: int, depth: Depth = np.uint8, days: int | None = None) -> Tick:
    frames = capture(number, depth)
    since = frames.time - np.timedelta64(days, "D") if days is not None else None
    return replace(tick(number), frames=frames, frames_since=since)


@pytest.fixture(params=["icechunk", "memory"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    return create_store(tmp_path / "s", site="x", grid=GRID, metrics=METRICS, kind=request.param)


def same(found: Frames | None, truth: Frames) -> None:
    assert found is not None
    assert found.stack.dtype == truth.stack.dtype
    np.testing.assert_array_equal(found.stack, truth.stack)
    assert (found.time, found.patterns, found.exposure_ms) == (truth.time, truth.patterns, truth.exposure_ms)


def test_frames_come_back_to_the_bit_by_the_number_of_their_scan(store: Store) -> None:
    for number, depth in enumerate(DEPTHS):
        store.append(with_frames(number, depth))
    store.append(tick(3))
    for number, depth in enumerate(DEPTHS):
        same(store.frames(number), capture(number, depth))
    same(store.frames(-2), capture(2))
    assert store.frames(3) is None
    with pytest.raises(IndexError, match="there is no scan 4: it holds 4"):
        store.frames(4)


def test_old_frames_are_let_go_with_the_tick_that_is_n_days_later(store: Store) -> None:
    for number in range(9):  # four scans a day
        store.append(with_frames(number, days=1))
    kept = [number for number in range(9) if store.frames(number) is not None]
    assert kept == [4, 5, 6, 7, 8]
    for number in kept:
        same(store.frames(number), capture(number))
    assert len(store) == 9
    np.testing.assert_allclose(store[0].scan.height, surface(0).height, atol=0.000251)


def test_an_older_snapshot_still_holds_what_was_let_go(tmp_path: Path) -> None:
    store = create_store(tmp_path / "s", site="x", grid=GRID, metrics=METRICS)
    store.append(with_frames(0))
    before = open_store(tmp_path / "s")
    store.append(with_frames(8, days=1))
    assert store.frames(0) is None
    same(before.frames(0), capture(0))


def test_a_capture_costs_few_files(tmp_path: Path) -> None:
    def files() -> int:
        return sum(path.is_file() for path in (tmp_path / "s").rglob("*"))

    plain = create_store(tmp_path / "s", site="x", grid=GRID, metrics=METRICS)
    plain.append(tick(0))
    before = files()
    plain.append(tick(1))
    without = files() - before
    for number in (2, 3):
        plain.append(replace(tick(number), frames=capture(number, size=(480, 640))))
    before = files()
    plain.append(replace(tick(4), frames=capture(4, size=(480, 640))))
    assert files() - before <= without + 6


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.integers(0, 2**32 - 1), st.sampled_from([np.uint8, np.uint16]), st.tuples(st.integers(1, 9), st.integers(1, 9))
)
def test_nothing_is_lost_whatever_the_frames_hold(
    tmp_path_factory: pytest.TempPathFactory, seed: int, depth: Depth, size: tuple[int, int]
) -> None:
    store = create_store(tmp_path_factory.mktemp("raw") / "s", site="x", grid=GRID, metrics=METRICS)
    frames = replace(capture(seed, depth, size), time=at(0))
    store.append(replace(tick(0), frames=frames))
    same(store.frames(0), frames)
    store.close()

"""The line: order, the bound, waiting, and what becomes of it all when a stage raises. Nothing here sleeps."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from threading import Event

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.line import InlineLine, Line, Stage, ThreadedLine

WAIT_S = 30.0
"""Far more than anything here takes: only a hang is cut off by it."""


def stages(log: list[tuple[str, int]], **ready: Callable[[], bool]) -> list[Stage[int]]:
    def stage(name: str) -> Stage[int]:
        return Stage(name, lambda item: log.append((name, item)), ready.get(name, lambda: True))

    return [stage("a"), stage("b"), stage("c")]


@given(st.lists(st.one_of(st.just(-1), st.integers(0, 2)), max_size=60))
def test_each_stage_sees_every_item_once_and_in_order_whatever_steps_first(story: list[int]) -> None:
    """-1 puts the next item, other numbers let that stage step."""
    log: list[tuple[str, int]] = []
    line = Line(stages(log), limit=3)
    put = 0
    for what in story:
        if what >= 0:
            line.step(what)
        elif not line.full:
            line.put(put)
            put += 1
        assert line.under_way <= 3
    line.finish()
    assert line.under_way == 0
    for name in "abc":
        assert [item for stage, item in log if stage == name] == list(range(put))
    for item in range(put):
        assert [stage for stage, each in log if each == item] == ["a", "b", "c"]


def test_inline_brings_each_item_to_its_end_at_once() -> None:
    log: list[tuple[str, int]] = []
    line = InlineLine(stages(log))
    with line:
        line.put(1)
        assert log == [("a", 1), ("b", 1), ("c", 1)]
        assert not line.full


def test_a_stage_that_is_not_ready_holds_up_what_comes_behind_and_not_what_is_ahead() -> None:
    log: list[tuple[str, int]] = []
    line = Line(stages(log, b=lambda: ("c", 0) in log or not any(stage == "b" for stage, _ in log)), limit=9)
    line.put(0)
    line.put(1)
    assert [line.step(0), line.step(0)] == [True, True]
    assert line.step(1)
    assert not line.step(1), "0 is not through c yet"
    assert line.step(2)
    assert line.step(1)


def test_what_does_not_count_takes_no_room() -> None:
    line = Line(stages([]), limit=1, counts=lambda item: item > 0)
    seen = []
    for item in (0, 1):
        line.put(item)
        seen.append(line.full)
    line.finish()
    assert [*seen, line.full] == [False, True, False]


def test_threads_work_side_by_side_and_keep_the_order() -> None:
    log: list[tuple[str, int]] = []
    meet = threading.Barrier(2)

    def first(item: int) -> None:
        if item == 1:
            meet.wait(WAIT_S)  # while the second stage has item 0 in hand
        log.append(("a", item))

    def second(item: int) -> None:
        if item == 0:
            meet.wait(WAIT_S)
        log.append(("b", item))

    before = sys.getswitchinterval()
    with ThreadedLine([Stage("a", first), Stage("b", second)], limit=2) as line:
        for item in range(50):
            line.wait_for_room(Event())
            line.put(item)
            assert line.under_way <= 2
    assert sys.getswitchinterval() == before
    assert [item for stage, item in log if stage == "b"] == list(range(50))
    assert not any(each.name.startswith("microrelief-") for each in threading.enumerate())


def test_waiting_for_room_ends_when_asked_to_stop() -> None:
    go_on, stop = Event(), Event()
    stop.set()

    def wait(item: int) -> None:
        go_on.wait(WAIT_S)

    with ThreadedLine([Stage("a", wait)], limit=1) as line:
        line.put(0)
        assert line.full
        line.wait_for_room(stop)
        assert line.full
        go_on.set()


class Bug(BaseException):
    """Not even an Exception."""


def test_what_a_stage_raises_ends_all_of_them_and_is_raised_once() -> None:
    log: list[tuple[str, int]] = []
    broke = Event()

    def bad(item: int) -> None:
        log.append(("b", item))
        if item == 1:
            raise Bug("oops")

    def use() -> None:
        with ThreadedLine([Stage("a", lambda item: None), Stage("b", bad)], limit=9, broke=broke.set) as line:
            line.put(0)
            line.put(1)
            assert broke.wait(WAIT_S), "whoever waits for a slot is woken"
            line.put(2)
            raise AssertionError("must not be reached")

    with pytest.raises(Bug, match="oops"):
        use()
    assert [item for stage, item in log if stage == "b"] == [0, 1]
    assert not any(each.name.startswith("microrelief-") for each in threading.enumerate())


def test_a_late_error_is_raised_when_the_line_is_left() -> None:
    def bad(item: int) -> None:
        raise Bug

    with pytest.raises(Bug), ThreadedLine([Stage("a", bad)]) as line:
        line.put(0)


def test_an_exception_of_the_user_of_the_line_breaks_it_off() -> None:
    done: list[int] = []
    in_hand, go_on = Event(), Event()

    def slow(item: int) -> None:
        in_hand.set()
        go_on.wait(WAIT_S)
        done.append(item)

    def use() -> None:
        with ThreadedLine([Stage("a", slow), Stage("b", done.append, lambda: False)]) as line:
            line.put(0)
            assert in_hand.wait(WAIT_S)
            go_on.set()
            raise Bug

    with pytest.raises(Bug):
        use()
    assert done == [0], "what a stage has in hand it ends; the rest is left, though the second was never ready"

"""A viewer that is slower than the scans gets the newest; one that is closed or fails costs nothing. Nothing sleeps."""

from __future__ import annotations

from threading import Event

import pytest

from monitor.newest import showing

WAIT_S = 30.0
"""Far more than anything here takes: only a hang is cut off by it."""


def test_who_is_slower_gets_the_newest_and_nobody_waits() -> None:
    shown: list[int] = []
    looking, go_on = Event(), Event()

    def show(thing: int) -> bool:
        shown.append(thing)
        looking.set()
        return go_on.wait(WAIT_S)

    with showing(show) as newest:
        newest.offer(0)
        assert looking.wait(WAIT_S)
        for thing in range(1, 6):
            newest.offer(thing)
        go_on.set()
    assert shown == [0, 5]


def test_a_viewer_that_was_closed_is_asked_no_more() -> None:
    shown: list[int] = []
    asked = Event()

    def show(thing: int) -> bool:
        shown.append(thing)
        asked.set()
        return False

    with showing(show) as newest:
        newest.offer(0)
        assert asked.wait(WAIT_S)
        newest.offer(1)
    assert shown == [0]


def test_what_a_viewer_raises_is_logged_and_ends_there(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    asked = Event()

    def show(thing: int) -> bool:
        asked.set()
        raise ZeroDivisionError("oops")

    with showing(show) as newest:
        newest.offer(0)
        assert asked.wait(WAIT_S)
        newest.offer(1)
    told = capsys.readouterr()
    assert "oops" in told.out + told.err + caplog.text

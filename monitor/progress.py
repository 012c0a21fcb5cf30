"""How far long work has come: a bar on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["Progress", "progress"]

Progress = Callable[[int, int], None]
"""Called with (steps done, steps in all)."""

_LINES = 5


@contextmanager
def progress(what: str) -> Iterator[Progress]:
    """Show progress on stderr, so that stdout stays for results.

    Parameters
    ----------
    what : str
        What is going on, such as ``reading scans``.
    """
    if not sys.stderr.isatty():
        yield _plain(what)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Bar(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _plain(what: str) -> Progress:
    shown = 0

    def show(done: int, total: int) -> None:
        nonlocal shown
        part = _LINES * done // max(total, 1)
        if part > shown:  # at most five lines in a log, however long the work
            shown = part
            print(f"{what}: {done} of {total}", file=sys.stderr)

    return show

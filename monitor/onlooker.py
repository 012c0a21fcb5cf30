"""Onlooker: a review that goes along with a running campaign, in a process of its own, so that no visit waits."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import structlog

from .settled import Settled

__all__ = ["OURSELVES", "Onlooker"]

OURSELVES = (sys.executable, "-P", "-c", "from monitor.cli import main; main()")
"""Our own command line. ``-P``: what lies in the current folder must not stand in for us."""

LEAVE_S = 5.0
_log = structlog.get_logger("microrelief.onlooker")


class Onlooker:
    """Starts ``microrelief review STORE --follow`` once there is a scan to look at, and ends it with the run.

    It reads the store as anybody may, with less right to the processor than the run has. Where it ends before, because
    somebody closed the window or it failed, that is logged, and the run goes on without.

    Parameters
    ----------
    store : str or Path
    options : sequence of str
        More options of `microrelief review`.
    program : sequence of str
        What answers to ``review``.
    """

    def __init__(self, store: str | Path, options: Sequence[str] = (), program: Sequence[str] = OURSELVES) -> None:
        nice = ("nice", "-n", "10") if shutil.which("nice") else ()
        self._command = [*nice, *program, "review", str(store), "--follow", *options]
        self._process: subprocess.Popen[bytes] | None = None
        self._ended = False

    def settled(self, settled: Settled) -> Sequence[str]:
        """Begin with the first scan that is durable; notes nothing."""
        if self._process is None:
            if settled.number is not None:
                # a session of its own: Ctrl-C ends the run, and the run ends this
                self._process = subprocess.Popen(self._command, stdin=subprocess.DEVNULL, start_new_session=True)
        elif not self._ended and (code := self._process.poll()) is not None:
            self._ended = True
            _log.warning("the live review ended", code=code)
        return ()

    def close(self) -> None:
        """End it: politely, then not."""
        if self._process is None or self._process.poll() is not None:
            return
        self._process.terminate()
        try:
            self._process.wait(LEAVE_S)
        except subprocess.TimeoutExpired:
            os.killpg(self._process.pid, signal.SIGKILL)  # its viewer is of its group
            self._process.wait()

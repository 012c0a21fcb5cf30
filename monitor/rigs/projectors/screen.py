"""ScreenProjector: a projector that the computer sees as a screen; a process of its own holds the window."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from configs import DeviceUnavailable, InputError
from pipelines import PatternSet

from .base import Again

__all__ = ["ScreenProjector"]

WINDOW = Path(__file__).with_name("screen_window.py")


class ScreenProjector:
    """Patterns full screen, pixel by pixel, on a head of this computer.

    A process of its own holds the window: a window belongs to the thread that made it, which a capture's need not be,
    and between captures it must go on answering the desktop.

    Parameters
    ----------
    head : int
        Which screen, 0 for the first. Set it to its own resolution, without scaling, mirroring, night light or saver.
    driver : str, optional
        SDL's video driver, such as ``x11``, ``wayland`` or ``kmsdrm``; without it SDL chooses.

    Notes
    -----
    When the call returns the image has been handed to the graphics card. Screen and projector add delays of their own,
    often 20 to 100 ms, which `microrelief doctor CAMPAIGN` measures: give them as ``settle_ms``.
    """

    again: Again = "frame"

    def __init__(self, *, head: int = 0, driver: str | None = None) -> None:
        if head < 0:
            raise ValueError(f"head must be 0 or above, not {head}")
        self._head = head
        self._driver = driver
        self._window: subprocess.Popen[bytes] | None = None
        self._loaded: PatternSet | None = None

    def open(self) -> None:
        """Start the process; it opens the window, which is black."""
        if self._window is not None:
            return
        environment = dict(os.environ)
        if self._driver is not None:
            environment["SDL_VIDEODRIVER"] = self._driver
        self._window = subprocess.Popen(
            [sys.executable, str(WINDOW), str(self._head)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
        )
        try:
            self._answer()
        except BaseException:
            self.close()
            raise

    def load(self, patterns: PatternSet) -> None:
        """Give the window the images, which must have its size."""
        if patterns == self._loaded:
            return
        images = np.ascontiguousarray(patterns.images())
        self._ask({"verb": "load", "shape": list(images.shape)}, images.tobytes())
        self._loaded = patterns

    def show(self, frame: int) -> None:
        """Show one image; returns when the graphics card has it."""
        self._ask({"verb": "show", "frame": frame})

    def close(self) -> None:
        """Close the window."""
        window, self._window = self._window, None
        self._loaded = None
        if window is None:
            return
        try:
            window.communicate(timeout=5)  # the process ends when its line does
        except subprocess.TimeoutExpired:
            window.kill()
            window.communicate()

    def _ask(self, ask: dict[str, object], data: bytes = b"") -> None:
        if self._window is None or self._window.stdin is None:
            raise DeviceUnavailable("screen projector: not open; call open() before show()")
        try:
            self._window.stdin.write(json.dumps(ask).encode() + b"\n" + data)
            self._window.stdin.flush()
        except OSError:
            raise DeviceUnavailable(GONE) from None
        self._answer()

    def _answer(self) -> None:
        assert self._window is not None
        assert self._window.stdout is not None
        line = self._window.stdout.readline()
        if not line:
            raise DeviceUnavailable(GONE)
        answer = json.loads(line)
        if answer["is"] == "input":
            raise InputError(answer["text"])
        if answer["is"] != "ok":
            raise DeviceUnavailable(answer["text"])


GONE = "the projector's window was closed"

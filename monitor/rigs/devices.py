"""DevicesRig: a real camera and a real projector, in step, each frame proved to have come."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from configs import CaptureError, InputError
from pipelines import Frames, Instant, PatternSet

from .cameras import CAMERAS, Camera, FrameLost, Image, Shot, lost_between
from .parts import make_from_kind
from .projectors import PROJECTORS, Projector

__all__ = ["DevicesRig"]


class DevicesRig:
    """One camera and one projector: for each pattern it shows it, waits until it is lit, and takes one frame.

    A frame that came damaged or not at all is taken again while its pattern still stands; where the projector plays by
    itself, the whole capture is. The capture says so. Frames that the device made and that never arrived are seen by
    its own count. That pattern k is in frame k is proved from the frames themselves, by what `diagnose` looks at.

    Parameters
    ----------
    camera : mapping
        ``kind`` (a key of `CAMERAS`) and that camera's options.
    projector : mapping, optional
        ``kind`` (a key of `PROJECTORS`) and that projector's options; without it something else projects.
    settle_ms : float
        Wait between showing a pattern and triggering: the delay of screen and projector. `doctor` measures it.
    retries : int
        How often one frame, or the capture, may be taken again before the capture fails.

    Raises
    ------
    InputError
        No such camera or projector, or an impossible option.
    """

    def __init__(
        self,
        *,
        camera: Mapping[str, Any],
        projector: Mapping[str, Any] | None = None,
        settle_ms: float = 0.0,
        retries: int = 2,
    ) -> None:
        if not 0 <= settle_ms <= 60_000:
            raise ValueError(f"settle_ms must lie in 0 to 60000, not {settle_ms}")
        if not 0 <= retries <= 100:
            raise ValueError(f"retries must lie in 0 to 100, not {retries}")
        self.camera: Camera = make_from_kind("camera", CAMERAS, camera)
        self.projector: Projector = make_from_kind("projector", PROJECTORS, projector or {"kind": "external"})
        self.settle_s = settle_ms / 1000.0
        self._retries = retries
        self.make_stack: Callable[..., npt.NDArray[Any]] = np.empty
        self._open = False
        if self.projector.again == "capture" and not self.camera.awaits_trigger:
            raise InputError(
                "rig option camera: the projector plays its patterns by itself and pulls a line at each: wire that to "
                "the camera's trigger input, and name it, such as trigger: Line1"
            )

    def open(self) -> None:
        """Take hold of both devices.

        Raises
        ------
        DeviceUnavailable
            One is not there, or held by another program.
        """
        if self._open:
            return
        self.projector.open()
        try:
            self.camera.open()
        except BaseException:
            self.projector.close()
            raise
        self._open = True

    def capture(self, patterns: PatternSet, at: Instant) -> Frames:
        """Show each pattern and take its frame.

        Raises
        ------
        CaptureError
            A frame did not come whole in all its tries, or the rig is not open.
        DeviceUnavailable
            A device went away.
        """
        if not self._open:
            raise CaptureError("devices rig: not open; call open() before capture()")
        self.projector.load(patterns)
        remarks: list[str] = []
        rounds = self._retries if self.projector.again == "capture" else 0
        for attempt in range(rounds + 1):
            try:
                stack = self._take_all(patterns, remarks)
            except FrameLost as lost:
                if attempt == rounds:
                    raise CaptureError(f"devices rig: {lost}") from None
                remarks.append(f"the capture was taken again: {lost}")
            else:
                return Frames(stack, at, patterns, self.camera.exposure_ms, tuple(remarks))
        raise AssertionError("unreachable: the last round returns or raises")

    def _take_all(self, patterns: PatternSet, remarks: list[str]) -> Image:
        """All frames in their order, shape (frame, row, column); `remarks` is added to. Raises FrameLost."""
        self.camera.start()
        stack: Image | None = None
        count: int | None = None
        for frame, role in enumerate(patterns.roles):
            self.projector.show(frame)
            if self.settle_s:
                time.sleep(self.settle_s)
            shot = self._take(f"frame {frame} ({role.name})", count, remarks)
            count = shot.number
            if stack is None:
                stack = self.make_stack((len(patterns.roles), *shot.image.shape), shot.image.dtype)
            elif shot.image.shape != stack.shape[1:] or shot.image.dtype != stack.dtype:
                raise CaptureError(f"devices rig: frame {frame} has another size or depth than those before it")
            stack[frame] = shot.image
        assert stack is not None  # a pattern set has at least one frame
        return stack

    def close(self) -> None:
        """Let both devices go; harmless if not open."""
        self._open = False
        self.camera.close()
        self.projector.close()

    def _take(self, what: str, before: int | None, remarks: list[str]) -> Shot:
        """One frame, taken again where it was lost and its pattern still stands; `remarks` is added to."""
        tries = self._retries if self.projector.again == "frame" else 0
        for attempt in range(tries + 1):
            try:
                shot = self.camera.take()
            except FrameLost as lost:
                if attempt == tries:
                    raise FrameLost(f"{what}, {_times(attempt + 1)}: {lost}") from None
                remarks.append(f"{what} was taken again: {lost}")
                continue
            missing = lost_between(before, shot.number, self.camera.wraps_at)
            if missing > attempt:  # those that this frame's own tries lost are said already
                told = f"{_times(missing - attempt, 'frame')} lost before {what}, by the camera's own count"
                if self.projector.again != "frame":  # the patterns went on: this frame shows a later one
                    raise FrameLost(told)
                remarks.append(told)
            return shot
        raise AssertionError("unreachable: the last try returns or raises")


def _times(count: int, noun: str = "try") -> str:
    plural = {"try": "tries", "frame": "frames"}[noun]
    return f"{count} {noun if count == 1 else plural}"

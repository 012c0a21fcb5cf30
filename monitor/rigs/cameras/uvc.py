"""UvcCamera: USB microscopes and webcams that need no driver of their own, through Linux' video devices (linuxpy)."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from configs import DeviceUnavailable, InputError

from ...extras import load_extra
from .base import FrameLost, Shot, check_timeout

__all__ = ["UvcCamera", "grey"]

FORMATS = ("GREY", "YUYV", "MJPG")
BUFFERS = 4
SETTLED_FRAMES = 10
"""After its stream begins a camera's first frames are dark, blurred or of the old exposure."""

MANUAL = 1
AUTOMATIC = {
    "auto_exposure": MANUAL,
    "exposure_auto": MANUAL,  # the same, as kernels before 5.16 name it
    "exposure_dynamic_framerate": False,
    "exposure_auto_priority": False,
    "white_balance_automatic": False,
    "white_balance_temperature_auto": False,
    "focus_automatic_continuous": False,
    "focus_auto": False,
    "gain_automatic": False,
}
"""What a camera changes by itself, and the value at which it does not; those that it has are locked."""

EXPOSURE = ("exposure_time_absolute", "exposure_absolute")
EXPOSURE_UNIT_MS = 0.1


class UvcCamera:
    """A camera that runs freely: of its frames the first is taken whose exposure began after it was asked for.

    What it changes by itself (exposure, white balance, focus) is locked when it is opened.

    Parameters
    ----------
    device : str
        Such as ``/dev/video0``; better the name under ``/dev/v4l/by-id``, which stays.
    size : (int, int), optional
        Columns, rows; without it as the camera is set.
    pixel_format : str
        ``GREY``, ``YUYV`` or ``MJPG``: brightness is taken, colour is not. JPEG blurs fine stripes.
    exposure_ms : float, optional
        Without it as the camera is set. Take a multiple of the projector's frame time, 16.67 ms.
    timeout_ms : float
        How long to wait for a frame.
    controls : mapping of str to anything, optional
        Other controls by name, as ``v4l2-ctl --list-ctrls`` shows them.

    Notes
    -----
    Its own count tells frames that it made before from those after; it makes more than are taken, so that gaps in
    it are none of the capture.
    """

    wraps_at: int | None = None
    awaits_trigger = False

    def __init__(
        self,
        *,
        device: str = "/dev/video0",
        size: Sequence[int] | None = None,
        pixel_format: str = "YUYV",
        exposure_ms: float | None = None,
        timeout_ms: float = 2000.0,
        controls: Mapping[str, Any] | None = None,
    ) -> None:
        check_timeout(timeout_ms)
        if pixel_format not in FORMATS:
            raise ValueError(f"pixel_format {pixel_format!r} is none of {', '.join(FORMATS)}")
        if size is not None and (len(size) != 2 or not all(isinstance(part, int) and part > 0 for part in size)):
            raise ValueError(f"size must be two whole numbers, columns and rows, not {size}")
        self._path, self._size, self._format = device, size, pixel_format
        self._exposure_ms = exposure_ms
        self._timeout_s = timeout_ms / 1000.0
        self._controls = dict(controls or {})
        self._device: Any = None
        self._capture: Any = None
        self._period_s = 0.0
        self._last = -1

    @property
    def exposure_ms(self) -> float:
        """Exposure that the open camera says; NaN while it is closed or where it does not say."""
        if self._device is None:
            return float("nan")
        with contextlib.suppress(KeyError, OSError):
            return float(self._device.controls[self._exposure_name()].value) * EXPOSURE_UNIT_MS
        return float("nan")

    def open(self) -> None:
        """Open the device, choose its format and lock what it changes by itself."""
        if self._device is not None:
            return
        video = load_extra("linuxpy.video.device", "uvc", "a UVC camera")
        device = video.Device(self._path)
        try:
            device.open()
        except OSError as error:
            raise DeviceUnavailable(
                f"no camera can be opened at {self._path}: look at its cable, and whether another program holds it or "
                f"this user may not use it ({error.strerror})"
            ) from None
        self._video, self._device = video, device
        try:
            self._set_up()
        except OSError as error:
            self.close()
            raise DeviceUnavailable(f"the camera at {self._path} cannot be set up: {error.strerror}") from None
        except BaseException:
            self.close()
            raise

    def _set_up(self) -> None:
        capture = self._video.VideoCapture(self._device, size=BUFFERS)
        now = capture.get_format()
        columns, rows = self._size or (now.width, now.height)
        capture.set_format(columns, rows, self._format)
        got = capture.get_format()
        if (got.width, got.height, got.pixel_format.name) != (columns, rows, _name(self._format)):
            raise InputError(
                f"camera option size: the camera at {self._path} gives no {columns}x{rows} in {self._format}, the next "
                f"is {got.width}x{got.height} in {got.pixel_format.name}"
            )
        for name, value in AUTOMATIC.items():
            if name in self._names():
                self._set(name, value)
        if self._exposure_ms is not None:
            self._set(self._exposure_name(), round(self._exposure_ms / EXPOSURE_UNIT_MS))
        for name, value in self._controls.items():
            self._set(name, value)
        self._period_s = 1.0 / float(capture.get_fps())
        capture.open()
        self._capture = capture
        for _ in range(SETTLED_FRAMES):
            self._next()

    def start(self) -> None:
        """The stream runs already; each frame is chosen by its own time."""
        self._held()

    def take(self) -> Shot:
        """Give the first frame that began after this call."""
        self._held()
        asked = time.monotonic()
        while True:
            frame = self._next()
            # a stamp may tell a frame's end: it began up to one period before; where it tells the begin, we wait longer
            if frame.timestamp >= asked + self._period_s:
                break
            if time.monotonic() - asked > self._timeout_s:
                raise FrameLost(f"the camera at {self._path} gave no new frame within {self._timeout_s:g} s")
        if self._video.BufferFlag.ERROR in frame.flags:
            raise FrameLost(f"the camera's frame {frame.frame_nb} is damaged")
        return Shot(grey(frame.data, frame.width, frame.height, self._format))

    def close(self) -> None:
        """Let the camera go."""
        device, self._device = self._device, None
        capture, self._capture = self._capture, None
        self._last = -1
        with contextlib.suppress(OSError):  # it may be gone
            if capture is not None:
                capture.close()
        if device is not None:
            device.close()

    def _next(self) -> Any:
        """Take the next frame from the driver's queue."""
        try:
            frame = self._capture.buffer.frame_reader.read(self._timeout_s)
        except OSError as error:
            raise DeviceUnavailable(
                f"the camera at {self._path} went away: look at its cable ({error.strerror})"
            ) from None
        if frame is None:
            raise FrameLost(f"no frame came from the camera at {self._path} within {self._timeout_s:g} s")
        if frame.frame_nb <= self._last:
            raise FrameLost(f"the camera at {self._path} gave its frame {frame.frame_nb} again")
        self._last = frame.frame_nb
        return frame

    def _held(self) -> Any:
        if self._device is None:
            raise DeviceUnavailable("UVC camera: not open; call open() before take()")
        return self._device

    def _names(self) -> set[str]:
        return {control.config_name for control in self._device.controls.values()}

    def _exposure_name(self) -> str:
        names = self._names()
        return next((name for name in EXPOSURE if name in names), EXPOSURE[0])

    def _set(self, name: str, value: object) -> None:
        if name not in self._names():
            raise InputError(f"camera option controls: the camera at {self._path} has no control {name!r}")
        control = self._device.controls[name]
        try:
            control.value = value
            got = control.value
        except (OSError, ValueError, AttributeError) as error:
            raise InputError(f"the camera's {name} does not take {value!r}: {error}") from None
        if got != value:
            raise InputError(f"the camera's {name} does not take {value!r}, it is {got!r}")


def _name(pixel_format: str) -> str:
    """What linuxpy calls a format."""
    return {"MJPG": "MJPEG"}.get(pixel_format, pixel_format)


def grey(data: bytes, columns: int, rows: int, pixel_format: str) -> npt.NDArray[np.uint8]:
    """Give a frame's brightness, shape (row, column).

    Raises
    ------
    FrameLost
        The data are not a whole frame.
    """
    if pixel_format == "MJPG":
        import cv2

        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        if image is None or image.shape != (rows, columns):
            raise FrameLost("a frame is no whole JPEG")
        return np.ascontiguousarray(image, dtype=np.uint8)
    width = {"GREY": 1, "YUYV": 2}[pixel_format]
    if len(data) < rows * columns * width:
        raise FrameLost(f"a frame has {len(data)} bytes and not {rows * columns * width}")
    flat = np.frombuffer(data, np.uint8, rows * columns * width)
    return flat.reshape(rows, columns * width)[:, ::width].copy()

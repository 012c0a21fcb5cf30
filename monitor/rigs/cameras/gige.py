"""GigECamera: any GigE Vision or USB3 Vision camera through Aravis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from configs import DeviceUnavailable, InputError

from ...extras import load_extra
from .base import FrameLost, Image, Shot, bits_of, check_timeout, to_full_range

__all__ = ["GigECamera"]


class GigECamera:
    """A camera that Aravis finds.

    Parameters
    ----------
    address : str, optional
        Its IP address or Aravis' name for it (``arv-tool-0.8`` lists them); without it the first one found.
    exposure_ms : float, optional
        Without it as the camera is set.
    gain : float, optional
        In the camera's own unit.
    pixel_format : str
        ``Mono8``, ``Mono10``, ``Mono12`` or ``Mono16``.
    region : sequence of int, optional
        First column, first row, columns, rows of the part of the sensor to read.
    trigger : str
        ``software``: we trigger each frame. Else the line that the projector pulls, such as ``Line1``.
    timeout_ms : float
        How long to wait for a frame.
    features : mapping of str to anything, optional
        Any other setting of the camera by its GenICam name.
    """

    wraps_at: int | None = 65535  # GigE Vision 1.x: 16 bits, and 0 is not used

    def __init__(
        self,
        *,
        address: str | None = None,
        exposure_ms: float | None = None,
        gain: float | None = None,
        pixel_format: str = "Mono8",
        region: tuple[int, int, int, int] | None = None,
        trigger: str = "software",
        timeout_ms: float = 2000.0,
        features: Mapping[str, Any] | None = None,
    ) -> None:
        check_timeout(timeout_ms)
        if region is not None and (len(region) != 4 or not all(isinstance(part, int) for part in region)):
            raise ValueError(f"region must be four whole numbers: first column, first row, columns, rows; not {region}")
        self._address = address
        self._exposure_ms = exposure_ms
        self._gain = gain
        self._format = pixel_format
        self._bits = bits_of(pixel_format)
        self._region = region
        self._trigger = trigger
        self._timeout_us = round(timeout_ms * 1000)
        self._features = dict(features or {})
        self._camera: Any = None
        self._stream: Any = None
        self._is_gone = False

    @property
    def awaits_trigger(self) -> bool:
        """Whether the projector's line triggers, not we."""
        return self._trigger != "software"

    @property
    def exposure_ms(self) -> float:
        """Exposure that the open camera says; NaN while it is closed or where it does not say."""
        if self._camera is None:
            return float("nan")
        try:
            return float(self._camera.get_exposure_time()) / 1000.0
        except self._error:
            return float("nan")

    def open(self) -> None:
        """Find the camera, open it and set it up."""
        if self._camera is not None:
            return
        gi = load_extra("gi", "gige", "a GigE Vision camera")
        try:
            gi.require_version("Aravis", "0.8")
        except ValueError:
            raise InputError("a GigE Vision camera needs Aravis: `apt-get install gir1.2-aravis-0.8`") from None
        self._aravis = load_extra("gi.repository.Aravis", "gige", "a GigE Vision camera")
        self._error = load_extra("gi.repository.GLib", "gige", "a GigE Vision camera").Error
        self._is_gone = False
        try:
            self._camera = self._aravis.Camera.new(self._address)
        except self._error as error:
            named = "no camera" if self._address is None else f"no camera at {self._address}"
            raise DeviceUnavailable(
                f"{named} answers: look at its cable, power and address, and whether another program holds it "
                f"({_short(error)})"
            ) from None
        try:
            self._set_up()
        except BaseException:
            self.close()
            raise

    def _set_up(self) -> None:
        camera = self._camera
        self._try("pixel_format", self._format, lambda: camera.set_pixel_format_from_string(self._format))
        if self._region is not None:
            region = self._region
            self._try("region", list(region), lambda: camera.set_region(*region))
        for name, value in self._features.items():
            self._try(name, value, lambda name=name, value=value: _set_feature(camera, name, value))
        if self._exposure_ms is not None:
            exposure_us = self._exposure_ms * 1000.0
            self._try("exposure_ms", self._exposure_ms, lambda: camera.set_exposure_time(exposure_us))
        if self._gain is not None:
            self._try("gain", self._gain, lambda: camera.set_gain(self._gain))
        source = "Software" if self._trigger == "software" else self._trigger
        self._try("trigger", self._trigger, lambda: camera.set_trigger(source))

    def start(self) -> None:
        """Begin the acquisition with a new stream: nothing waits in it."""
        camera = self._held()
        self._stop()
        try:
            self._stream = camera.create_stream(None, None)
            size = camera.get_payload()
            for _ in range(BUFFERS):
                self._stream.push_buffer(self._aravis.Buffer.new_allocate(size))
            camera.start_acquisition()
        except self._error as error:
            raise self._gone(error) from None

    def take(self) -> Shot:
        """Trigger and take one frame."""
        camera = self._held()
        if self._stream is None:
            raise FrameLost("the camera does not acquire; call start() before take()")
        try:
            if self._trigger == "software":
                camera.software_trigger()
        except self._error as error:
            raise self._gone(error) from None
        buffer = self._stream.timeout_pop_buffer(self._timeout_us)
        if buffer is None:
            if not self._answers():
                raise self._gone(None)
            raise FrameLost(f"no frame came from the camera within {self._timeout_us // 1000} ms of its trigger")
        try:
            status = buffer.get_status()
            if status != self._aravis.BufferStatus.SUCCESS:
                raise FrameLost(f"the camera's frame {buffer.get_frame_id()} is damaged: {status.value_nick}")
            rows, columns = buffer.get_image_height(), buffer.get_image_width()
            data = buffer.get_data()
            flat: Image
            if self._bits == 8:
                flat = np.frombuffer(data, np.uint8, rows * columns)
            else:
                flat = np.frombuffer(data, "<u2", rows * columns).astype(np.uint16)
            image: Image = flat.reshape(rows, columns).copy()
            return Shot(to_full_range(image, self._bits), int(buffer.get_frame_id()))
        finally:
            self._stream.push_buffer(buffer)

    def close(self) -> None:
        """Let the camera go."""
        if self._camera is None:
            return
        self._stop()
        self._camera = None

    def _stop(self) -> None:
        stream, self._stream = self._stream, None
        if stream is None or self._is_gone:  # each word to a camera that is gone waits seconds for its answer
            return
        try:
            self._camera.stop_acquisition()
        except self._error:  # it went away: nothing is left to stop
            return

    def _held(self) -> Any:
        if self._camera is None:
            raise DeviceUnavailable("GigE Vision camera: not open; call open() before take()")
        return self._camera

    def _answers(self) -> bool:
        try:
            self._camera.get_payload()
        except self._error:
            return False
        return True

    def _gone(self, error: Exception | None) -> DeviceUnavailable:
        self._is_gone = True
        why = "" if error is None else f" ({_short(error)})"
        return DeviceUnavailable(f"the camera went away: look at its cable and power{why}")

    def _try(self, name: str, value: object, do: Any) -> None:
        try:
            do()
        except self._error as error:
            raise InputError(f"camera option {name}: the camera does not take {value!r} ({_short(error)})") from None


BUFFERS = 8


def _set_feature(camera: Any, name: str, value: object) -> None:
    device = camera.get_device()
    if isinstance(value, bool):
        device.set_boolean_feature_value(name, value)
    elif isinstance(value, int):
        device.set_integer_feature_value(name, value)
    elif isinstance(value, float):
        device.set_float_feature_value(name, value)
    else:
        device.set_string_feature_value(name, str(value))


def _short(error: Exception) -> str:
    return str(getattr(error, "message", error)).strip().rstrip(".")

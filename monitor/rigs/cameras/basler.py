"""BaslerCamera: Basler's cameras through pylon (pypylon), and pylon's own emulation of one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from configs import DeviceUnavailable, InputError

from ...extras import load_extra
from .base import FrameLost, Shot, bits_of, check_timeout, to_full_range

__all__ = ["BaslerCamera"]


class BaslerCamera:
    """A camera that pylon finds: USB3 Vision, GigE Vision or, with ``PYLON_CAMEMU=1``, pylon's emulation.

    Parameters
    ----------
    serial : str, optional
        Serial number; without it the first camera found.
    exposure_ms : float, optional
        Without it as the camera is set. Choose a multiple of 10 ms (50 Hz mains) or 8.33 ms (60 Hz).
    gain : float, optional
        dB. Least is best: projected light is better than gain.
    pixel_format : str
        ``Mono8``, ``Mono10``, ``Mono12`` or ``Mono16``.
    trigger : str
        ``software``: we trigger each frame. Else the name of the line that the projector pulls, such as ``Line1``.
    timeout_ms : float
        How long to wait for a frame.
    features : mapping of str to anything, optional
        Any other setting of the camera by its GenICam name, in the order given.
    """

    wraps_at: int | None = None

    def __init__(
        self,
        *,
        serial: str | None = None,
        exposure_ms: float | None = None,
        gain: float | None = None,
        pixel_format: str = "Mono8",
        trigger: str = "software",
        timeout_ms: float = 2000.0,
        features: Mapping[str, Any] | None = None,
    ) -> None:
        check_timeout(timeout_ms)
        self._serial = serial
        self._exposure_ms = exposure_ms
        self._gain = gain
        self._format = pixel_format
        self._bits = bits_of(pixel_format)
        self._trigger = trigger
        self._timeout_ms = round(timeout_ms)
        self._features = dict(features or {})
        self._pylon: Any = None
        self._camera: Any = None

    @property
    def awaits_trigger(self) -> bool:
        """Whether the projector's line triggers, not we."""
        return self._trigger != "software"

    @property
    def exposure_ms(self) -> float:
        """Exposure that the open camera says; NaN while it is closed."""
        if self._camera is None:
            return float("nan")
        node = self._node("ExposureTime") or self._node("ExposureTimeAbs")
        return float("nan") if node is None else float(node.Value) / 1000.0

    def open(self) -> None:
        """Find the camera, open it and set it up."""
        if self._camera is not None:
            return
        pylon = load_extra("pypylon.pylon", "basler", "a Basler camera")
        genicam = load_extra("pypylon.genicam", "basler", "a Basler camera")
        wanted = pylon.DeviceInfo()
        if self._serial is not None:
            wanted.SetSerialNumber(self._serial)
        try:
            camera = pylon.InstantCamera(pylon.TlFactory.GetInstance().CreateFirstDevice(wanted))
            camera.Open()
        except genicam.GenericException as error:
            named = "no Basler camera" if self._serial is None else f"no Basler camera of serial {self._serial}"
            raise DeviceUnavailable(
                f"{named} can be opened: look at its cable and power, and whether another program holds it "
                f"({_short(error)})"
            ) from None
        self._pylon, self._genicam, self._camera = pylon, genicam, camera
        try:
            self._set_up()
        except BaseException:
            self.close()
            raise

    def _set_up(self) -> None:
        # formats and whatever decides the image's size come before the rest, as the user ordered them
        for name, value in (("PixelFormat", self._format), *self._features.items()):
            self._set(name, value)
        if self._exposure_ms is not None:
            self._set("ExposureTime" if self._node("ExposureTime") else "ExposureTimeAbs", self._exposure_ms * 1000.0)
        if self._gain is not None:
            self._set("Gain", self._gain)
        self._set("TriggerSelector", "FrameStart")
        self._set("TriggerMode", "On")
        self._set("TriggerSource", "Software" if self._trigger == "software" else self._trigger)

    def start(self) -> None:
        """Begin to grab, frame by frame in order; what was grabbed before is gone."""
        camera = self._held()
        try:
            if camera.IsGrabbing():
                camera.StopGrabbing()
            camera.StartGrabbing(self._pylon.GrabStrategy_OneByOne)
        except self._genicam.GenericException as error:
            raise self._gone(error) from None

    def take(self) -> Shot:
        """Trigger and take one frame."""
        camera = self._held()
        wait = self._pylon.TimeoutHandling_Return
        try:
            if self._trigger == "software":
                # without this wait the first trigger is lost
                if not camera.WaitForFrameTriggerReady(self._timeout_ms, wait):
                    raise FrameLost(f"the Basler camera was not ready for a trigger within {self._timeout_ms} ms")
                camera.TriggerSoftware.Execute()
            result = camera.RetrieveResult(self._timeout_ms, wait)
        except self._genicam.GenericException as error:
            raise self._gone(error) from None
        if not result.IsValid():
            if camera.IsCameraDeviceRemoved():
                raise self._gone(None)
            raise FrameLost(f"no frame came from the Basler camera within {self._timeout_ms} ms of its trigger")
        with result:
            if not result.GrabSucceeded():
                raise FrameLost(f"the Basler camera says: {result.ErrorDescription.strip().rstrip('.')}")
            image = np.array(result.Array, copy=True)
            return Shot(to_full_range(image, self._bits), int(result.BlockID))

    def close(self) -> None:
        """Let the camera go."""
        camera, self._camera = self._camera, None
        if camera is not None:
            camera.Close()

    def _held(self) -> Any:
        if self._camera is None:
            raise DeviceUnavailable("Basler camera: not open; call open() before take()")
        return self._camera

    def _gone(self, error: Exception | None) -> DeviceUnavailable:
        why = "" if error is None else f" ({_short(error)})"
        return DeviceUnavailable(f"the Basler camera went away: look at its cable and power{why}")

    def _node(self, name: str) -> Any:
        node = self._camera.GetNodeMap().GetNode(name)
        return node if node is not None and self._genicam.IsAvailable(node) else None

    def _set(self, name: str, value: object) -> None:
        node = self._camera.GetNodeMap().GetNode(name)
        if node is None:
            raise InputError(f"camera option features: this Basler camera has no setting {name!r}")
        try:
            node.FromString("1" if value is True else "0" if value is False else f"{value}")
        except self._genicam.GenericException as error:
            raise InputError(f"the Basler camera's {name} does not take {value!r}: {_short(error)}") from None


def _short(error: Exception) -> str:
    """Pylon's message without the place in pylon's source."""
    return str(error).partition(" : ")[0].strip().rstrip(".")

"""MicroManagerCamera: every camera that Micro-Manager supports, through its core (pymmcore)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from configs import DeviceUnavailable, InputError

from ..micromanager_core import MicroManagerDevice, short
from .base import FrameLost, Shot, to_full_range

__all__ = ["MicroManagerCamera"]


class MicroManagerCamera:
    """A camera of a Micro-Manager configuration, or one named by adapter and device.

    Parameters
    ----------
    configuration : str or Path, optional
        A configuration file that Micro-Manager's wizard wrote; its camera is used.
    adapter, device : str, optional
        Without a configuration: the adapter's and the device's name, such as ``DemoCamera`` and ``DCam``.
    adapter_folder : str or Path, optional
        Micro-Manager's own folder, where its device adapters are; it must be of the interface that our pymmcore has
        (its third number: 12.5.1.75 asks for interface 75).
    exposure_ms : float
    properties : mapping of str to anything, optional
        Properties of the camera as Micro-Manager names them.

    Notes
    -----
    Micro-Manager's snap gives no frame count, so that lost frames are seen only by what the frames show.
    """

    wraps_at: int | None = None
    awaits_trigger = False

    def __init__(
        self,
        *,
        configuration: str | Path | None = None,
        adapter: str | None = None,
        device: str | None = None,
        adapter_folder: str | Path | None = None,
        exposure_ms: float = 10.0,
        properties: Mapping[str, Any] | None = None,
    ) -> None:
        self._device = MicroManagerDevice("camera", configuration, adapter, device, adapter_folder)
        self._exposure_ms = float(exposure_ms)
        self._properties = dict(properties or {})

    @property
    def exposure_ms(self) -> float:
        """Exposure that the open camera says; NaN while it is closed."""
        core = self._device.core
        return float("nan") if core is None else float(core.getExposure())

    def open(self) -> None:
        """Load the adapters, open the camera and set it up."""
        if self._device.is_open:
            return
        label = self._device.open()
        core = self._device.core
        if label:
            core.setCameraDevice(label)
        label = core.getCameraDevice()
        if not label:
            self.close()
            raise InputError("camera option configuration: it names no camera")
        try:
            for name, value in self._properties.items():
                core.setProperty(label, name, value)
            core.setExposure(self._exposure_ms)
        except RuntimeError as error:
            self.close()
            raise InputError(f"camera option properties: {short(error)}") from None

    def start(self) -> None:
        """Nothing waits in a camera that is snapped."""
        self._held()

    def take(self) -> Shot:
        """Snap one frame."""
        core = self._held()
        try:
            core.snapImage()
            image = np.array(core.getImage(), copy=True)
        except RuntimeError as error:
            raise FrameLost(f"the Micro-Manager camera gave no frame: {short(error)}") from None
        if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
            raise InputError(
                f"the Micro-Manager camera gives {image.dtype} of shape {image.shape}; set its pixel type to grey "
                "of 8 or 16 bits under properties"
            )
        return Shot(to_full_range(image, int(core.getImageBitDepth())))

    def close(self) -> None:
        """Let the camera and its adapters go."""
        self._device.close()

    def _held(self) -> Any:
        if self._device.core is None:
            raise DeviceUnavailable("Micro-Manager camera: not open; call open() before take()")
        return self._device.core

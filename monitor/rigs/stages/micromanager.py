"""MicroManagerStage: every XY stage that Micro-Manager supports, through its core (pymmcore)."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from configs import DeviceUnavailable, InputError

from ..micromanager_core import MicroManagerDevice, short
from .base import check_arrived

__all__ = ["MicroManagerStage"]


class MicroManagerStage:
    """The XY stage of a Micro-Manager configuration, or one named by adapter and device.

    Parameters
    ----------
    configuration : str or Path, optional
        A configuration file that Micro-Manager's wizard wrote; its XY stage is used. Give the camera the same file.
    adapter, device : str, optional
        Without a configuration: the adapter's and the device's name, such as ``DemoCamera`` and ``DXYStage``.
    adapter_folder : str or Path, optional
        Micro-Manager's own folder, where its device adapters are.
    slowest_s : float
        A move that takes longer has failed.
    """

    def __init__(
        self,
        *,
        configuration: str | Path | None = None,
        adapter: str | None = None,
        device: str | None = None,
        adapter_folder: str | Path | None = None,
        slowest_s: float = 120.0,
    ) -> None:
        if slowest_s <= 0:
            raise ValueError(f"slowest_s must be above 0, not {slowest_s}")
        self._device = MicroManagerDevice("stage", configuration, adapter, device, adapter_folder)
        self._slowest_ms = round(slowest_s * 1000)
        self._label = ""

    def open(self) -> None:
        """Load the adapters and start the stage."""
        if self._device.is_open:
            return
        label = self._device.open()
        core = self._device.core
        self._label = label or core.getXYStageDevice()
        if not self._label:
            self.close()
            raise InputError("stage option configuration: it names no XY stage")
        core.setTimeoutMs(self._slowest_ms)

    def home(self) -> None:
        """Find both zeros by the device's switches."""
        self._ask(lambda core: core.home(self._label))
        self._ask(lambda core: core.waitForDevice(self._label))

    def move_to(self, x_mm: float, y_mm: float) -> None:
        """Go there and wait."""
        self._ask(lambda core: core.setXYPosition(self._label, x_mm * 1000.0, y_mm * 1000.0))
        self._ask(lambda core: core.waitForDevice(self._label))
        check_arrived("the Micro-Manager stage", (x_mm, y_mm), self.where())

    def where(self) -> tuple[float, float]:
        """As the device says."""
        x, y = self._ask(lambda core: (core.getXPosition(self._label), core.getYPosition(self._label)))
        return float(x) / 1000.0, float(y) / 1000.0

    def close(self) -> None:
        """Stop and let the stage go."""
        core = self._device.core
        if core is not None and self._label:
            with contextlib.suppress(RuntimeError):  # many stages know no stop; this one stands
                core.stop(self._label)
        self._device.close()

    def _ask(self, do: Callable[[Any], Any]) -> Any:
        core = self._device.core
        if core is None:
            raise DeviceUnavailable("Micro-Manager stage: not open; call open() before it moves")
        try:
            return do(core)
        except RuntimeError as error:
            raise DeviceUnavailable(f"the Micro-Manager stage does not obey: {short(error)}") from None

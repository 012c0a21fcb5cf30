"""Micro-Manager's core: one for each configuration file, whoever of camera and stage asks for it first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from configs import DeviceUnavailable, InputError

from ..extras import load_extra

__all__ = ["MicroManagerDevice", "short"]

_held: dict[Path, tuple[Any, int]] = {}
"""The cores of configuration files, and by how many devices each is held: a serial line can be opened only once."""


class MicroManagerDevice:
    """A device by adapter and name on a core of its own, or one of a configuration file on the core that all share.

    Parameters
    ----------
    what : str
        As messages name it: "camera", "stage".
    configuration : str or Path or None
        A configuration file that Micro-Manager's wizard wrote.
    adapter, device : str or None
        Without a configuration: the adapter's and the device's name, such as ``DemoCamera`` and ``DCam``.
    folder : str or Path or None
        Micro-Manager's own folder, where its device adapters are.
    """

    def __init__(
        self,
        what: str,
        configuration: str | Path | None,
        adapter: str | None,
        device: str | None,
        folder: str | Path | None,
    ) -> None:
        if (configuration is None) == (adapter is None or device is None):
            raise ValueError("give either configuration, or adapter and device")
        if configuration is not None and not Path(configuration).is_file():
            raise InputError(f"{what} option configuration: {configuration} is no file")
        self._what = what
        self._file = None if configuration is None else Path(configuration).resolve()
        self._adapter, self._device, self._folder = adapter, device, folder
        self.core: Any = None

    @property
    def is_open(self) -> bool:
        """Whether it holds a core."""
        return self.core is not None

    def open(self) -> str:
        """Load the adapters and start the device; give its label, empty where the configuration leaves it to its roles.

        Raises
        ------
        InputError
            The adapters or the configuration cannot be loaded.
        DeviceUnavailable
            The device does not start.
        """
        if self._file is not None and self._file in _held:
            self.core, count = _held[self._file]
            _held[self._file] = (self.core, count + 1)
            return ""
        core = load_extra("pymmcore", "micromanager", f"a Micro-Manager {self._what}").CMMCore()
        if self._folder is not None:
            core.setDeviceAdapterSearchPaths([str(self._folder)])
        label = self._what.capitalize()
        try:
            if self._file is not None:
                core.loadSystemConfiguration(str(self._file))
            else:
                core.loadDevice(label, self._adapter, self._device)
        except RuntimeError as error:
            raise InputError(f"Micro-Manager cannot load the {self._what}: {short(error)}") from None
        if self._file is not None:
            _held[self._file] = (core, 1)
            self.core = core
            return ""
        try:
            core.initializeDevice(label)
        except RuntimeError as error:
            raise DeviceUnavailable(f"the Micro-Manager {self._what} does not start: {short(error)}") from None
        self.core = core
        return label

    def close(self) -> None:
        """Let the device go, and the core where nobody else holds it."""
        core, self.core = self.core, None
        if core is None:
            return
        if self._file is not None:
            count = _held[self._file][1] - 1
            if count:
                _held[self._file] = (core, count)
                return
            del _held[self._file]
        core.unloadAllDevices()


def short(error: Exception) -> str:
    """The core's message, without its last stop."""
    return str(error).strip().rstrip(".")

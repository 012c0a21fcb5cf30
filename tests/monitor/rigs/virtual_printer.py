"""OctoPrint's virtual printer (AGPL, in a folder of its own) behind a pseudo terminal; a process that peers.py starts.

Run by its path with that folder on PYTHONPATH; it says the terminal's name. Of OctoPrint only the printer's simulation
is loaded: its web server (plugins, network) is left out, so that its hundred dependencies need not be there.
"""

from __future__ import annotations

import os
import pty
import sys
import tempfile
import threading
import tty
import types
from collections.abc import Mapping, Sequence
from typing import Any


class _Nothing(types.ModuleType):
    """Stands for a module of the web server, whatever is taken from it."""

    def __getattr__(self, name: str) -> Any:
        return object


def _load() -> tuple[Any, Mapping[str, Any]]:
    import octoprint

    for name in ("octoprint.util.net", "octoprint.plugin"):
        sys.modules[name] = _Nothing(name)
    octoprint.plugin = plugin = sys.modules["octoprint.plugin"]
    plugin.SettingsPlugin, plugin.TemplatePlugin = type("S", (), {}), type("T", (), {})  # type: ignore[attr-defined]
    plugin.plugin_manager = lambda: types.SimpleNamespace(get_hooks=lambda name: {})  # type: ignore[attr-defined]
    from octoprint.plugins.virtual_printer import VirtualPrinterPlugin
    from octoprint.plugins.virtual_printer.virtual import VirtualPrinter

    return VirtualPrinter, VirtualPrinterPlugin().get_settings_defaults()


class _Settings:
    """OctoPrint's settings, as the printer asks for them: its plugin's own defaults."""

    def __init__(self, values: Mapping[str, Any], folder: str) -> None:
        self._values, self._folder = values, folder

    def get(self, path: Sequence[str], **_: object) -> Any:
        value: Any = self._values
        for key in path:
            value = value[key]
        return value

    get_int = get_float = get_boolean = get

    def global_get_basefolder(self, name: str) -> str:
        return self._folder


def main() -> None:
    """Serve the terminal until the process is ended."""
    make, defaults = _load()
    with tempfile.TemporaryDirectory() as folder:
        settings = _Settings({**defaults, "simulated_errors": [], "throttle": 0.0, "sendWait": False}, folder)
        profile = {"extruder": {"count": 1}, "axes": {}, "volume": {"width": 200, "depth": 200, "height": 200}}
        printer = make(settings, types.SimpleNamespace(get_current_or_default=lambda: profile), folder)
        master, slave = pty.openpty()
        tty.setraw(slave)
        print(os.ttyname(slave), flush=True)

        def answer() -> None:
            while line := printer.readline() or b" ":
                if line.strip():
                    os.write(master, line)

        threading.Thread(target=answer, daemon=True).start()
        while data := os.read(master, 256):
            for line in data.splitlines(keepends=True):
                printer.write(line)


if __name__ == "__main__":
    main()

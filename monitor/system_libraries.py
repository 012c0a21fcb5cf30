"""System libraries that compiled packages and the Rerun viewer need: which is missing, and what installs it."""

from __future__ import annotations

import re

__all__ = ["PACKAGES", "missing_library"]

PACKAGES = {
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
    "libvulkan.so.1": "libvulkan1",
    "libstdc++.so.6": "libstdc++6",
    "libgthread-2.0.so.0": "libglib2.0-0",
}
"""Debian's package of each shared library."""


def missing_library(error: ImportError) -> str:
    """Say what could not be loaded, and how to get it.

    Parameters
    ----------
    error : ImportError

    Returns
    -------
    str
        One line for people.
    """
    shared = re.match(r"(lib[^\s:]+\.so[.\d]*): cannot open shared object", str(error))
    if shared is not None:
        package = PACKAGES.get(shared[1])
        how = f"`apt-get install {package}`" if package else "install the package that has it (`apt-file search` tells)"
        return f"the system library {shared[1]} is not there: {how}"
    name = (error.name or "").partition(".")[0]
    if isinstance(error, ModuleNotFoundError) and name and name not in _OURS:
        return f"the Python package {name!r} is not installed: `pip install microrelief` brings all it needs"
    return f"cannot be loaded: {error} (`microrelief doctor` looks further)"


_OURS = ("configs", "pipelines", "storage", "dashboards", "monitor")

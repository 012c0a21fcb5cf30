"""Libraries that are extras: imported where they are used, and a missing one told with the command that brings it."""

from __future__ import annotations

import importlib
import warnings
from types import ModuleType

from configs import InputError

__all__ = ["load_extra"]


def load_extra(module: str, extra: str, what: str) -> ModuleType:
    """Import `module`.

    Parameters
    ----------
    module : str
        Its full name, such as ``pypylon.pylon``.
    extra : str
        Our extra that brings it.
    what : str
        What needs it, as the message begins: "a Basler camera".

    Raises
    ------
    InputError
        It is not installed, or a library that it needs is not.
    """
    try:
        with warnings.catch_warnings():
            # modules made by SWIG warn while they load, and crash the process where warnings are errors
            warnings.simplefilter("ignore", DeprecationWarning)
            return importlib.import_module(module)
    except ImportError as error:
        raise InputError(f"{what} needs `pip install 'microrelief[{extra}]'` ({error})") from None

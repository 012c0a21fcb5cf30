"""Loads a camera's library, which is an extra, or says how to get it."""

from __future__ import annotations

import importlib
import warnings
from types import ModuleType

from configs import InputError

__all__ = ["load_extra"]


def load_extra(module: str, extra: str, what: str) -> ModuleType:
    """Import `module`.

    Raises
    ------
    InputError
        It is not installed, or a library that it needs is not.
    """
    try:
        with warnings.catch_warnings():
            # compiled modules made by SWIG warn while they load, and crash the process where warnings are errors
            warnings.simplefilter("ignore", DeprecationWarning)
            return importlib.import_module(module)
    except ImportError as error:
        raise InputError(f"{what} needs `pip install 'microrelief[{extra}]'` ({error})") from None

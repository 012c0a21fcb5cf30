"""The errors that microrelief raises on purpose.

    MicroreliefError          exit code 1: it went wrong; the message says what, where and what to do
    +-- InputError            exit code 2: a file, an option or a campaign is wrong (also a ValueError)
    |   +-- ConfigError       exit code 2: a campaign file is wrong: one line FILE:LINE:COLUMN per problem
    +-- CaptureError          exit code 1: these frames cannot become a height map (also a ValueError)
    +-- StoreError            exit code 1: the store is not there, not whole, or held by another (also an OSError)
    +-- DeviceUnavailable     exit code 75: the device is temporarily not there; a later try may work

Pure functions raise plain ValueError for arguments that a caller could have checked.
"""

from __future__ import annotations

__all__ = ["CaptureError", "ConfigError", "DeviceUnavailable", "InputError", "MicroreliefError", "StoreError"]


class MicroreliefError(Exception):
    """Base of all errors that a user is meant to read: one line, what, where and what to do."""

    exit_code: int = 1


class InputError(MicroreliefError, ValueError):
    """What the user gave is wrong: a file, an option, a campaign."""

    exit_code = 2


class ConfigError(InputError):
    """A campaign file is wrong: its message is one line ``FILE:LINE:COLUMN: KEY: what`` per problem."""


class CaptureError(MicroreliefError, ValueError):
    """These frames cannot become a height map."""


class StoreError(MicroreliefError, OSError):
    """The store is not there, not whole, or held by another writer."""


class DeviceUnavailable(MicroreliefError):  # noqa: N818 - a state of the world, not a fault of the program
    """The device is temporarily not there; a later try may work."""

    exit_code = 75

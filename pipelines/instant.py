"""Instants: UTC, nanoseconds, as numpy's ``datetime64[ns]``; a time without a zone is refused."""

from __future__ import annotations

import re
from datetime import UTC, datetime, tzinfo
from zoneinfo import ZoneInfo

import numpy as np

__all__ = ["Instant", "as_datetime", "check_instant", "format_instant", "instant", "parse_instant"]

type_of_instant = np.dtype("datetime64[ns]")

Instant = np.datetime64
"""A UTC time in nanoseconds: ``numpy.datetime64`` whose dtype is ``datetime64[ns]``."""


def instant(moment: datetime) -> Instant:
    """Turn an aware datetime into an instant.

    Parameters
    ----------
    moment : datetime
        Aware: a datetime without a zone could mean any of 38 hours and is refused.

    Raises
    ------
    ValueError
        If `moment` has no time zone.
    """
    if moment.tzinfo is None:
        raise ValueError(f"time {moment.isoformat()} has no time zone: add Z or an offset such as +01:00")
    return np.datetime64(moment.astimezone(UTC).replace(tzinfo=None), "ns")


def parse_instant(text: str, zone: tzinfo | str | None = None) -> Instant:
    """Read an ISO 8601 time.

    Parameters
    ----------
    text : str
        Such as ``2026-11-22T21:00:00Z`` or ``2026-11-22 22:00+01:00``.
    zone : tzinfo or str, optional
        The zone of a text that names none (a campaign's zone); without it such a text is refused.

    Raises
    ------
    ValueError
        If the text is no time, or names no zone and `zone` is None.
    """
    try:
        moment = datetime.fromisoformat(text.strip())
    except ValueError:
        raise ValueError(f"{text!r} is not a time: write it like 2026-11-22T21:00:00Z") from None
    if not 1678 <= moment.year <= 2261:  # 64 bits of nanoseconds would wrap around without a word
        raise ValueError(f"{text!r} is not a time of ours: its year must lie from 1678 to 2261")
    if moment.tzinfo is None and zone is not None:
        moment = moment.replace(tzinfo=ZoneInfo(zone) if isinstance(zone, str) else zone)
    # datetime stops at microseconds: the digits after the sixth are ours to add
    beyond = re.search(r"[.,]\d{6}(\d{1,3})", text)
    return instant(moment) + np.timedelta64(int(beyond[1].ljust(3, "0")) if beyond else 0, "ns")


def as_datetime(moment: Instant) -> datetime:
    """Turn an instant into an aware UTC datetime; nanoseconds are cut to microseconds."""
    plain: datetime = moment.astype("datetime64[us]").item()
    return plain.replace(tzinfo=UTC)


def format_instant(moment: Instant) -> str:
    """Write an instant as ``2026-11-22T21:00:00Z``, with a fraction only where there is one."""
    text = np.datetime_as_string(moment.astype("datetime64[ns]"), unit="ns")
    whole, _, fraction = text.partition(".")
    fraction = fraction.rstrip("0")
    return f"{whole}.{fraction}Z" if fraction else f"{whole}Z"


def check_instant(moment: object, what: str) -> None:
    """Refuse anything but a ``datetime64[ns]`` that is a time (once, in ``__post_init__``)."""
    if not isinstance(moment, np.datetime64) or moment.dtype != type_of_instant or np.isnat(moment):
        raise ValueError(f"{what} must be a datetime64[ns] in UTC, not {moment!r}: use pipelines.instant()")

"""Lengths of time as people write them: ``6 h``, ``90 s``, ``1 h 30 min``, ``2 days``."""

from __future__ import annotations

import re
from datetime import timedelta
from typing import Annotated, Any

from pydantic import BeforeValidator, PlainSerializer, WithJsonSchema

__all__ = ["DURATION", "Duration", "format_duration", "parse_duration"]

_SECONDS = {"ms": 0.001, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0, "weeks": 604800.0}
_NAMES = {
    "ms": "ms", "s": "s", "sec": "s", "second": "s", "seconds": "s", "min": "min", "minute": "min", "minutes": "min",
    "h": "h", "hour": "h", "hours": "h", "d": "d", "day": "d", "days": "d", "week": "weeks", "weeks": "weeks",
}  # fmt: skip
_PART = r"\d+(?:\.\d+)?\s*[a-z]+"
DURATION = rf"{_PART}(\s+{_PART})*"
"""What a length of time looks like, as a regular expression."""


def parse_duration(text: Any) -> timedelta:
    """Read a length of time.

    Raises
    ------
    ValueError
        If there is no unit, an unknown one, or the time is not positive.
    """
    if isinstance(text, timedelta):
        return text
    if isinstance(text, bool) or not isinstance(text, str):
        raise ValueError(f"needs a unit, such as {text} s, {text} min or {text} h" if _number(text) else _HOW)
    if not re.fullmatch(rf"{_PART}(?:\s+{_PART})*", text.strip(), re.IGNORECASE):
        raise ValueError(f"{text!r} is not a length of time: {_HOW}")
    seconds = 0.0
    for amount, unit in re.findall(r"(\d+(?:\.\d+)?)\s*([a-z]+)", text, re.IGNORECASE):
        if unit.lower() not in _NAMES:
            raise ValueError(f"unknown unit {unit!r}: {_HOW}")
        seconds += float(amount) * _SECONDS[_NAMES[unit.lower()]]
    if seconds <= 0:
        raise ValueError("must be longer than nothing")
    return timedelta(seconds=seconds)


def format_duration(length: timedelta) -> str:
    """Write a length of time so that `parse_duration` reads it back: ``1 d 6 h``, ``1.5 s``."""
    rest, parts = round(length.total_seconds() * 1000), []
    for unit, size in (("d", 86_400_000), ("h", 3_600_000), ("min", 60_000)):
        count, rest = divmod(rest, size)
        if count:
            parts.append(f"{count} {unit}")
    if rest or not parts:
        parts.append(f"{rest / 1000:g} s")
    return " ".join(parts)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


_HOW = "write a number and s, min, h, days or weeks, such as 6 h"

Duration = Annotated[
    timedelta,
    BeforeValidator(parse_duration),
    PlainSerializer(format_duration, return_type=str),
    WithJsonSchema({"type": "string", "pattern": f"^{DURATION}$", "examples": ["6 h", "90 s", "30 days"]}),
]
"""A positive length of time, written with its unit."""

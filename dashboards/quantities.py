"""Numbers as people read them: rounded to their uncertainty, with a unit; times and spans in words."""

from __future__ import annotations

import math

import numpy as np

from pipelines import Instant, Measurement

__all__ = ["MINUS", "NOT_MEASURED_TEXT", "day_and_time", "plain", "span", "unit_text", "with_uncertainty"]

NOT_MEASURED_TEXT = "not measured"

_UNITS = {"mm3": "mm³", "mm2": "mm²", "um": "µm", "um2": "µm²", "um3": "µm³", "1": "", "degree": "°", "percent": "%"}
MINUS = "\N{MINUS SIGN}"


def unit_text(unit: str) -> str:
    """Write a UDUNITS unit for people: ``mm3`` becomes ``mm³``, ``1`` nothing."""
    return _UNITS.get(unit, unit)


def with_uncertainty(measurement: Measurement, unit: str = "1") -> str:
    """Round a value to its standard uncertainty: ``−1.234 ± 0.012 mm³``.

    The uncertainty keeps two significant digits and the value as many decimals. Without a usable uncertainty the
    value keeps four digits and stands alone.
    """
    value, sigma = measurement.value, measurement.sigma
    if not math.isfinite(value):
        return NOT_MEASURED_TEXT
    tail = f" {unit_text(unit)}".rstrip()
    if not (math.isfinite(sigma) and sigma > 0):
        return f"{plain(value)}{tail}"
    decimals = 1 - math.floor(math.log10(sigma))
    if round(sigma, decimals) >= 10 ** (2 - decimals):  # 0.0996 rounds to 0.10, which needs one digit less
        decimals -= 1
    shown = max(decimals, 0)
    return f"{_signed(round(value, decimals), shown)} ± {round(sigma, decimals):.{shown}f}{tail}"


def plain(value: float, digits: int = 4) -> str:
    """Write a number with `digits` significant digits and no trailing zeros."""
    if not math.isfinite(value):
        return NOT_MEASURED_TEXT
    if value == 0:
        return "0"
    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    text = _signed(round(value, decimals), max(decimals, 0))
    return text.rstrip("0").rstrip(".") if "." in text else text


def span(length: np.timedelta64) -> str:
    """Write a duration with its two largest units: ``3 d 6 h``, ``45 min``, ``1.5 s``."""
    seconds = float(length / np.timedelta64(1, "s"))
    if seconds < 60:
        return f"{plain(seconds, 3)} s"
    # Whole minutes are enough for anything that lasts longer than a few.
    left = round(seconds) if seconds < 3600 else round(seconds / 60) * 60
    parts: list[str] = []
    for size, name in ((86400, "d"), (3600, "h"), (60, "min"), (1, "s")):
        count, left = divmod(left, size)
        if count:
            parts.append(f"{count} {name}")
    return " ".join(parts[:2])


def day_and_time(moment: Instant) -> str:
    """Write an instant as ``2026-05-04 06:00 UTC``, with seconds only where there are some."""
    text = str(np.datetime_as_string(moment.astype("datetime64[s]"), unit="s")).replace("T", " ")
    return f"{text[:-3] if text.endswith(':00') else text} UTC"


def _signed(value: float, decimals: int) -> str:
    text = f"{abs(value):.{decimals}f}"
    return f"{MINUS}{text}" if value < 0 and float(text) != 0 else text

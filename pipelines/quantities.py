"""Numbers as people read them: a value rounded to its uncertainty, with its unit."""

from __future__ import annotations

import math

from .change import Measurement

__all__ = ["MINUS", "NOT_MEASURED_TEXT", "plain", "unit_text", "with_uncertainty"]

NOT_MEASURED_TEXT = "not measured"

_UNITS = {
    "mm3": "mm³", "mm2": "mm²", "mm-1": "mm⁻¹", "um": "µm", "um2": "µm²", "um3": "µm³",
    "1": "", "degree": "°", "percent": "%", "degree_Celsius": "°C",
}  # fmt: skip
MINUS = "\N{MINUS SIGN}"


def unit_text(unit: str) -> str:
    """Write a UDUNITS unit for people: ``mm3`` becomes ``mm³``, ``mm3/d`` ``mm³/d``, ``1`` nothing."""
    above, per, below = unit.partition("/")
    return f"{_UNITS.get(above, above) or '1'}/{below}" if per else _UNITS.get(unit, unit)


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


def _signed(value: float, decimals: int) -> str:
    text = f"{abs(value):.{decimals}f}"
    return f"{MINUS}{text}" if value < 0 and float(text) != 0 else text

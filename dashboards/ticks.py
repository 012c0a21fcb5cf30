"""Where axes carry marks: round numbers, and round moments with a text that is no longer than it need be."""

from __future__ import annotations

import numpy as np

__all__ = ["number_text", "number_ticks", "time_ticks"]

_MINUTE, _HOUR, _DAY = 60, 3600, 86400
_STEPS = (
    *(1, 2, 5, 10, 15, 30),
    *(_MINUTE * count for count in (1, 2, 5, 10, 15, 30)),
    *(_HOUR * count for count in (1, 2, 3, 6, 12)),
    *(_DAY * count for count in (1, 2, 5, 7, 14)),
)


def number_ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Give 2 to `most` + 1 round numbers, a step of 1, 2 or 5 apart, inside [low, high].

    Needs low < high.
    """
    rough = (high - low) / most
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(float(size * power) for size in (1, 2, 5, 10) if size * power >= rough * (1 - 1e-9))
    first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
    # + 0.0 turns the -0.0 of a rounded-up negative bound into 0.
    return [float(np.round(count * step, 12)) + 0.0 for count in np.arange(first, last + 1)]


def number_text(value: float, step: float) -> str:
    """Write a tick with as many decimals as its step needs, so that all ticks of an axis look alike."""
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9))) if step > 0 else 0
    if decimals > 6 or abs(value) >= 1e7:
        return f"{value:.3g}".replace("-", "\N{MINUS SIGN}")
    return f"{value:.{decimals}f}".replace("-", "\N{MINUS SIGN}")


def time_ticks(start: np.datetime64, end: np.datetime64, most: int = 6) -> list[tuple[np.datetime64, str]]:
    """Give round moments in [start, end] with a text each: clock times, days or months, whatever fits the span."""
    seconds = float((end - start) / np.timedelta64(1, "s"))
    if seconds < 2:
        return [(start, str(np.datetime_as_string(start, unit="s"))[11:])]
    step = next((size for size in _STEPS if seconds / size <= most), None)
    if step is None:
        return _month_ticks(start, end, most)
    if step >= _DAY:
        first = start.astype("datetime64[D]")
        moments = np.arange(first, end.astype("datetime64[D]") + 1, np.timedelta64(step // _DAY, "D"))
        return [(at, _day(at)) for at in moments.astype("datetime64[ns]") if start <= at <= end]
    first = start.astype("datetime64[D]").astype("datetime64[s]")
    skipped = np.ceil((start - first) / np.timedelta64(step, "s"))
    moments = np.arange(
        first + np.timedelta64(int(skipped) * step, "s"), end + np.timedelta64(1, "s"), np.timedelta64(step, "s")
    )
    inside = [at for at in moments.astype("datetime64[ns]") if start <= at <= end]
    return [(at, _clock(at, step)) for at in inside]


def _month_ticks(start: np.datetime64, end: np.datetime64, most: int) -> list[tuple[np.datetime64, str]]:
    months = np.arange(start.astype("datetime64[M]"), end.astype("datetime64[M]") + 1)
    inside = [at for at in months if start <= at.astype("datetime64[ns]") <= end]
    stride = next((count for count in (1, 2, 3, 6, 12, 24, 60) if len(inside) / count <= most), 120)
    kept = [at for at in inside if at.astype(np.int64) % stride == 0]
    return [(at.astype("datetime64[ns]"), str(at)) for at in kept]


def _day(moment: np.datetime64) -> str:
    return str(np.datetime_as_string(moment, unit="D"))[5:]


def _clock(moment: np.datetime64, step: int) -> str:
    text = str(np.datetime_as_string(moment, unit="s"))
    if text.endswith("00:00:00"):
        return text[5:10]
    return text[11:] if step < _MINUTE else text[11:16]

"""Numbers as people read them: times and spans in words; values as `pipelines` rounds them to their uncertainty."""

from __future__ import annotations

import numpy as np

from pipelines import MINUS, NOT_MEASURED_TEXT, Instant, plain, unit_text, with_uncertainty

__all__ = ["MINUS", "NOT_MEASURED_TEXT", "day_and_time", "plain", "span", "unit_text", "with_uncertainty"]


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

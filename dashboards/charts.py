"""Trends as SVG: a line with its band of uncertainty, limits, gaps drawn as gaps, units on the axes.

Colours come from the page's CSS variables, so that a chart follows the light or the dark scheme.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt

from .alarm_limits import Line
from .quantities import day_and_time, plain
from .ticks import number_text, number_ticks, time_ticks

__all__ = ["Trend", "gap_after", "plot_of", "trend_svg"]

_WIDTH, _HEIGHT = 560, 250
_LEFT, _RIGHT, _TOP, _BOTTOM = 62, 16, 14, 40
_COVERAGE = 2.0  # standard uncertainties: 95 % of a normal distribution
_GAP = 1.6  # a step this much longer than the median one is a hole in the record


@dataclass(frozen=True, slots=True, eq=False)
class Trend:
    """One metric through time.

    Parameters
    ----------
    label : str
        Axis label, unit included.
    times : ndarray of datetime64[ns], shape (scans,)
    values, sigmas : ndarray of float64, shape (scans,)
        NaN where not measured.
    lines : sequence of Line
        Limits.
    lost : ndarray of datetime64[ns], shape (n,)
        Planned visits that yielded no scan; marked on the time axis.
    """

    label: str
    times: npt.NDArray[np.datetime64]
    values: npt.NDArray[np.float64]
    sigmas: npt.NDArray[np.float64]
    lines: Sequence[Line] = ()
    lost: npt.NDArray[np.datetime64] | None = None


def gap_after(
    times: npt.NDArray[np.datetime64], lost: npt.NDArray[np.datetime64] | None = None
) -> npt.NDArray[np.bool_]:
    """Whether the record has a hole after each scan, shape (scans - 1,).

    There is one where a visit in between yielded nothing, or where the step is much longer than the usual one.
    """
    if len(times) < 2:
        return np.zeros(0, dtype=np.bool_)
    steps = np.diff(times).astype(np.float64)
    holes = steps > _GAP * np.median(steps)
    if lost is not None and lost.size:
        between = np.searchsorted(lost, times[1:], side="left") > np.searchsorted(lost, times[:-1], side="right")
        holes |= between
    return np.asarray(holes, dtype=np.bool_)


def plot_of(trend: Trend) -> dict[str, Any]:
    """Give a trend's numbers for a page that draws and zooms them itself.

    Returns
    -------
    dict
        ``label``; ``times`` in s since 1970, ``values`` and ``sigmas`` of one length, where None breaks the line;
        ``lines`` as (grade, side, value); ``lost`` in s since 1970.
    """
    seconds = trend.times.astype("datetime64[ms]").astype(np.int64) / 1000
    holes = np.flatnonzero(gap_after(trend.times, trend.lost))
    between = (seconds[holes] + seconds[holes + 1]) / 2
    known = np.isfinite(trend.values)
    values: list[float | None] = [
        _short(value) if good else None for value, good in zip(trend.values, known, strict=True)
    ]
    sigmas: list[float | None] = [_short(sigma, 3) if np.isfinite(sigma) else 0 for sigma in trend.sigmas]
    lost = trend.lost if trend.lost is not None else trend.times[:0]
    return {
        "label": trend.label,
        "times": [
            round(each, 3) if each % 1 else int(each) for each in np.insert(seconds, holes + 1, between).tolist()
        ],
        "values": _with_nothing(values, holes),
        "sigmas": _with_nothing(sigmas, holes),
        "lines": [(line.grade, line.side, line.value) for line in trend.lines],
        "lost": (lost.astype("datetime64[s]").astype(np.int64)).tolist(),
    }


def _short(value: float, digits: int = 6) -> float:
    return float(f"{value:.{digits}g}")


def _with_nothing(values: list[float | None], holes: npt.NDArray[np.intp]) -> list[float | None]:
    """Put a None after each hole's scan."""
    for hole in holes[::-1]:
        values.insert(int(hole) + 1, None)
    return values


def trend_svg(trend: Trend, alternative: str) -> str:
    """Draw a trend.

    Parameters
    ----------
    trend : Trend
    alternative : str
        What the drawing says, for those who do not see it.
    """
    measured = np.isfinite(trend.values)
    sigmas = np.where(np.isfinite(trend.sigmas), trend.sigmas, 0.0)
    low, high = _range(trend, measured, sigmas)
    values = number_ticks(low, high)
    step = values[1] - values[0] if len(values) > 1 else abs(values[0])
    start, end = _ends(trend)

    def x(moment: np.datetime64) -> float:
        return float(_LEFT + (moment - start) / (end - start) * (_WIDTH - _LEFT - _RIGHT))

    def y(value: float) -> float:
        return _TOP + (high - value) / (high - low) * (_HEIGHT - _TOP - _BOTTOM)

    parts = [
        f'<svg class="chart" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{_attribute(alternative)}">',
        f"<title>{escape(alternative)}</title>",
    ]
    for value in values:
        parts.append(
            f'<line class="grid" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y(value):.1f}" y2="{y(value):.1f}"/>'
        )
        parts.append(
            f'<text class="tick" x="{_LEFT - 7}" y="{y(value) + 4:.1f}" text-anchor="end">'
            f"{number_text(value, step)}</text>"
        )
    floor = _HEIGHT - _BOTTOM
    for moment, text in time_ticks(start, end):
        parts.append(f'<line class="axis" x1="{x(moment):.1f}" x2="{x(moment):.1f}" y1="{floor}" y2="{floor + 5}"/>')
        parts.append(f'<text class="tick" x="{x(moment):.1f}" y="{floor + 18}" text-anchor="middle">{text}</text>')
    parts.append(f'<line class="axis" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{floor}" y2="{floor}"/>')
    parts.append(f'<text class="label" x="{_LEFT}" y="{_HEIGHT - 4}">UTC</text>')
    parts.append(
        f'<text class="label" transform="translate(13 {(_TOP + floor) / 2:.0f}) rotate(-90)" '
        f'text-anchor="middle">{escape(trend.label)}</text>'
    )
    if low < 0 < high:
        parts.append(f'<line class="zero" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{y(0):.1f}" y2="{y(0):.1f}"/>')
    for line in trend.lines:
        if low <= line.value <= high:
            at = y(line.value)
            place = _name_place(trend.values[measured], line.value)
            parts.append(
                f'<line class="limit {line.grade}" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{at:.1f}" y2="{at:.1f}"/>'
            )
            parts.append(
                f'<text class="limit-name {line.grade}" y="{at - 4:.1f}" {place}>'
                f"{line.grade} {line.side} {plain(line.value)}</text>"
            )
    for run in _runs(measured, gap_after(trend.times, trend.lost)):
        above = [f"{x(trend.times[i]):.1f},{y(trend.values[i] + _COVERAGE * sigmas[i]):.1f}" for i in run]
        below = [f"{x(trend.times[i]):.1f},{y(trend.values[i] - _COVERAGE * sigmas[i]):.1f}" for i in reversed(run)]
        middle = [f"{x(trend.times[i]):.1f},{y(trend.values[i]):.1f}" for i in run]
        if len(run) > 1:
            parts.append(f'<polygon class="band" points="{" ".join(above + below)}"/>')
            parts.append(f'<polyline class="line" points="{" ".join(middle)}"/>')
        else:
            at = x(trend.times[run[0]])
            parts.append(
                f'<line class="whisker" x1="{at:.1f}" x2="{at:.1f}" y1="{above[0].split(",")[1]}" '
                f'y2="{below[0].split(",")[1]}"/>'
            )
    if measured.sum() <= 120:  # more would merge to a thick line
        parts += [
            f'<circle class="dot" cx="{x(trend.times[i]):.1f}" cy="{y(trend.values[i]):.1f}" r="2.6"/>'
            for i in np.flatnonzero(measured)
        ]
    for moment in trend.lost if trend.lost is not None else ():
        if start <= moment <= end:
            at = x(moment)
            parts.append(
                f'<path class="lost" d="M{at - 3.5:.1f} {floor - 7.5:.1f}l7 7m0 -7l-7 7">'
                f"<title>no scan on {day_and_time(moment)}</title></path>"
            )
    parts.append("</svg>")
    return "".join(parts)


def _name_place(known: npt.NDArray[np.float64], limit: float) -> str:
    """Where a limit's name stands: at the end of its line that lies farther from the values."""
    if known.size and abs(known[-1] - limit) > abs(known[0] - limit):
        return f'x="{_WIDTH - _RIGHT - 5}" text-anchor="end"'
    return f'x="{_LEFT + 5}"'


def _range(trend: Trend, measured: npt.NDArray[np.bool_], sigmas: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Cover the band, and every limit that does not squeeze the data to less than a third of the height."""
    if not measured.any():
        return 0.0, 1.0
    low = float(np.min(trend.values[measured] - _COVERAGE * sigmas[measured]))
    high = float(np.max(trend.values[measured] + _COVERAGE * sigmas[measured]))
    if high - low < 1e-12 * max(abs(high), abs(low), 1e-300):
        low, high = low - (abs(low) or 1.0) * 0.1, high + (abs(high) or 1.0) * 0.1
    wide = low, high
    for line in trend.lines:
        stretched = min(wide[0], line.value), max(wide[1], line.value)
        if stretched[1] - stretched[0] <= 3 * (high - low):
            wide = stretched
    margin = 0.04 * (wide[1] - wide[0])
    return wide[0] - margin, wide[1] + margin


def _ends(trend: Trend) -> tuple[np.datetime64, np.datetime64]:
    lost = trend.lost if trend.lost is not None else trend.times[:0]
    every = np.concatenate([trend.times, lost])
    start, end = every.min(), every.max()
    if start == end:
        half = np.timedelta64(30, "m")
        return start - half, end + half
    margin = (end - start) // 50
    return start - margin, end + margin


def _runs(measured: npt.NDArray[np.bool_], holes: npt.NDArray[np.bool_]) -> list[list[int]]:
    """Stretches of scans that a line may join."""
    runs: list[list[int]] = []
    for index in np.flatnonzero(measured):
        if runs and runs[-1][-1] == index - 1 and not holes[index - 1]:
            runs[-1].append(int(index))
        else:
            runs.append([int(index)])
    return runs


def _attribute(text: str) -> str:
    return escape(text, {'"': "&quot;"})

"""Curl and volume per week: where each stood at a week's end, and what the week added."""

from __future__ import annotations

import math

import numpy as np

from pipelines import Measurement

from ..findings import Findings
from ..metric_names import Named
from ..quantities import with_uncertainty
from ..section import Cell, Section, Table

__all__ = ["weekly"]

_VOLUME = ("net_volume", "gained_volume", "lost_volume", "crack_volume")
_CURL = ("edge_lift", "curl_angle", "plate_lift_largest", "plate_lift_p95", "curl_angle_largest", "curl_curvature")
_MOST_METRICS = 2
_MOST_ROWS = 53


def weekly(findings: Findings) -> Section | None:
    """Tabulate volume and curl at the end of each week, of each day where the record is shorter than two weeks."""
    if len(findings.times) < 2:
        return None
    lasted = (findings.times[-1] - findings.times[0]) / np.timedelta64(1, "D")
    word = "week" if lasted >= 14 else "day" if lasted >= 1 else "hour"
    keys = _keys(findings.times, word)
    tables = []
    for title, names in (("Volume", _VOLUME), ("Curl", _CURL)):
        metrics = [
            metric
            for name in names
            for metric in findings.metrics
            if metric.name == name and np.isfinite(findings.measured(name)[0]).any()
        ][:_MOST_METRICS]
        if metrics:
            tables.append(_table(findings, f"{title} per {word}", word, keys, metrics))
    return Section("weekly", f"Curl and volume per {word}", tables=tuple(tables)) if tables else None


def _keys(times: np.ndarray, word: str) -> np.ndarray:
    """Name the stretch that each scan lies in: weeks by their Monday, as ISO has them."""
    if word == "hour":
        return np.array([f"{str(hour).replace('T', ' ')}h" for hour in times.astype("datetime64[h]")])
    days = times.astype("datetime64[D]")
    return np.array([str(day) for day in (days - (days.astype(np.int64) + 3) % 7 if word == "week" else days)])


def _table(findings: Findings, caption: str, word: str, keys: np.ndarray, metrics: list[Named]) -> Table:
    ends = np.flatnonzero(np.append(keys[1:] != keys[:-1], True))
    head: list[str | Cell] = ["Week from" if word == "week" else word.capitalize(), "Scans"]
    for metric in metrics:
        head += [Cell(metric.title, link=metric.link), "Change"]
    rows = []
    start = 0
    before: dict[str, Measurement] = {}
    for end in ends:
        row = [str(keys[end]), str(int(end) + 1 - start)]
        for metric in metrics:
            values, sigmas = (array[start : end + 1] for array in findings.measured(metric.name))
            known = np.flatnonzero(np.isfinite(values))
            if not known.size:
                row += ["not measured", ""]
                continue
            newest = Measurement(float(values[known[-1]]), float(sigmas[known[-1]]))
            row.append(with_uncertainty(newest, metric.unit))
            old = before.get(metric.name)
            if old is not None:
                grown = Measurement(newest.value - old.value, math.hypot(newest.sigma, old.sigma))
                row.append(with_uncertainty(grown, metric.unit))
            else:
                row.append("")
            before[metric.name] = newest
        rows.append(tuple(row))
        start = int(end) + 1
    shown = tuple(rows[-_MOST_ROWS:])
    return Table(f"{caption}, at its last scan", tuple(head), shown, numeric=tuple(range(1, len(head))))

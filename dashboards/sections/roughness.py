"""Roughness: the ISO 25178 sheet of baseline and newest scan, with the filters without which it means nothing."""

from __future__ import annotations

import numpy as np

from pipelines import Measurement
from pipelines.change import ROUGHNESS, Filters
from pipelines.change import roughness as measure_roughness
from storage import Stored

from ..findings import Findings
from ..quantities import plain, with_uncertainty
from ..section import Section, Table

__all__ = ["roughness"]

_MOST_SIDE = 400
"""Cells: the middle of a larger map stands for it, which keeps a report quick."""


def roughness(findings: Findings) -> Section | None:
    """Tabulate the parameters of the scale-limited surface of the middle of the field."""
    first, last = findings.first, findings.last
    if first is None or last is None:
        return None
    pitch = last.scan.grid.pitch_mm
    filters = Filters(3 * pitch, None, 1)
    part = _middle(findings.counted)
    scans = [first, last] if last.number != first.number else [last]
    try:
        found = [_parameters(stored, findings.counted, part, filters) for stored in scans]
    except ValueError:  # too few cells were measured
        return None
    rows = tuple(
        (name, *(with_uncertainty(each[name], unit) for each in found), meaning)
        for name, (unit, meaning) in ROUGHNESS.items()
    )
    named = tuple(f"Scan {stored.number}{' (baseline)' if stored.number == first.number else ''}" for stored in scans)
    down, across = (plain((each.stop - each.start) * pitch, 3) for each in part)
    text = (
        f"Parameters of ISO 25178-2 of the middle {across} x {down} mm; scale-limited surface: {filters}. "
        "The uncertainty is what the scan's own noise makes of each.",
    )
    columns = tuple(range(1, len(named) + 1))
    table = Table("Surface texture, ± one standard uncertainty", ("", *named, "Meaning"), rows, numeric=columns)
    return Section("roughness", "Surface texture (ISO 25178)", text=text, tables=(table,))


def _middle(counted: np.ndarray) -> tuple[slice, slice]:
    """Give the middle of the smallest rectangle that holds every cell that counts."""
    ends = []
    for axis in (1, 0):
        there = np.flatnonzero(counted.any(axis=axis))
        low, high = (int(there[0]), int(there[-1]) + 1) if there.size else (0, counted.shape[1 - axis])
        cut = max(0, high - low - _MOST_SIDE)
        ends.append(slice(low + cut // 2, high - (cut - cut // 2)))
    return ends[0], ends[1]


def _parameters(
    stored: Stored, counted: np.ndarray, part: tuple[slice, slice], filters: Filters
) -> dict[str, Measurement]:
    scan = stored.scan
    height = np.where(counted, scan.height, np.float32(np.nan))[part]
    return dict(measure_roughness(height, scan.grid.pitch_mm, filters, scan.sigma[part]))

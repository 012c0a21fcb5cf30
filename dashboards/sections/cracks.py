"""Cracks: each crack of the newest scan by name, with how much it has grown since the baseline."""

from __future__ import annotations

import math

from pipelines import Measurement
from pipelines.change import CrackSighting, apply_motion, follow_cracks

from ..findings import Findings
from ..quantities import plain, with_uncertainty
from ..section import Section, Table
from ..terms import term

__all__ = ["cracks"]

_MOST_ROWS = 20


def cracks(findings: Findings) -> Section | None:
    """Tabulate the longest cracks; only where the campaign follows cracks at all."""
    first, last = findings.first, findings.last
    if first is None or last is None or not any(metric.name.startswith("crack_") for metric in findings.metrics):
        return None
    newest = last.scan if last.change is None else apply_motion(last.scan, last.change.motion)
    scans = [first.scan, newest] if last.number != first.number else [newest]
    *before, now = (
        {each.identity: each for each in seen.cracks} for seen in follow_cracks(scans, region=findings.counted)
    )
    if not now:
        return Section("cracks", "Cracks", text=("The newest scan shows no crack.",))
    known = before[0] if before else {}
    shown = sorted(now.values(), key=lambda each: each.size.length.value, reverse=True)[:_MOST_ROWS]
    more = f"; the longest {len(shown)} of {len(now)}" if len(shown) < len(now) else ""
    head = (
        "Crack",
        term("crack-length", "Length, mm"),
        term("crack-width", "Width, mm"),
        term("crack-widest", "Widest, mm"),
        term("crack-depth", "Depth, mm"),
        term("crack-volume", "Volume, mm³"),
        term("crack-seen"),
        "Wider, mm",
        "Longer, mm",
    )
    rows = tuple(_row(each, known.get(each.identity)) for each in shown)
    text = (
        "A crack keeps its number within this report; the command “microrelief cracks” follows each through every "
        "scan, with its tips. Wider and longer are since the baseline. Depth and volume are at least so large: they "
        "count where the floor was seen.",
    )
    table = Table(f"Cracks of scan {last.number}{more}", head, rows, numeric=tuple(range(len(head))))
    return Section("cracks", "Cracks", text=text, tables=(table,))


def _row(crack: CrackSighting, before: CrackSighting | None) -> tuple[str, ...]:
    size = crack.size
    old = before.size if before is not None else None
    return (
        str(crack.identity),
        with_uncertainty(size.length),
        with_uncertainty(size.width),
        plain(size.width_max_mm, 3) if math.isfinite(size.width_max_mm) else "not measured",
        with_uncertainty(size.depth),
        with_uncertainty(size.volume),
        f"{100 * size.seen:.0f} %",
        _since(size.width, old.width if old is not None else None),
        _since(size.length, old.length if old is not None else None),
    )


def _since(now: Measurement, before: Measurement | None) -> str:
    if before is None:
        return "new"
    grown = Measurement(now.value - before.value, math.hypot(now.sigma, before.sigma))
    return with_uncertainty(grown)

"""Provenance: what made these numbers, so that they can be made again."""

from __future__ import annotations

import numpy as np

from ..findings import Findings
from ..quantities import day_and_time, plain
from ..section import Cell, Section, Table

__all__ = ["made_by", "provenance"]

_IMPORTED = "none: height maps from elsewhere"


def made_by(findings: Findings, number: int) -> str:
    """Give the anchor of what made a scan's numbers: its epoch's line in the provenance."""
    return f"made-in-epoch-{int(findings.table.epochs[number])}"


def provenance(findings: Findings) -> Section:
    """Name the snapshot, calibrations, settings, software and grid behind the report, and what lies beside it."""
    about = findings.about
    rows: list[tuple[str | Cell, ...]] = [
        ("Site", about.site or "not named"),
        ("Store", about.location),
        ("Store snapshot", Cell(about.snapshot, anchor="snapshot")),
        ("Scans in the store", str(len(findings.table))),
        ("Campaign settings", Cell(about.campaign_hash or "not recorded", anchor="settings")),
        ("Software", about.software or "not recorded"),
        ("Layout of the store", f"version {about.schema}"),
    ]
    if about.noise is not None:
        rows.append(("Noise model", about.noise.id))
    grid = about.grid
    if grid is not None:
        size = f"{plain(grid.columns * grid.pitch_mm)} x {plain(grid.rows * grid.pitch_mm)} mm"
        rows.append(("Grid", f"{grid.columns} x {grid.rows} cells of {plain(1000 * grid.pitch_mm)} µm ({size})"))
    tables = [Table("What made this report", ("", ""), tuple(rows))]
    if findings.scans:
        head = ("Scans", "Epoch", "Baseline", "Calibration", "From", "To")
        tables.append(Table("What made which scans", head, tuple(_epochs(findings))))
        began = [event for event in findings.happened if event.kind == "note" and ", settings " in event.text]
        if began:
            told = tuple((day_and_time(event.time), event.text) for event in began[-12:])
            tables.append(Table("Software and settings of each run", ("When", "What began"), told))
        tables.append(
            Table(
                "Attachments, beside this page",
                ("", ""),
                (
                    ("series.csv", "every metric of every scan of this report with its standard uncertainty, as text"),
                    ("series.parquet", "the same, for programs"),
                ),
            )
        )
    return Section("provenance", "Provenance", tables=tuple(tables))


def _epochs(findings: Findings) -> list[tuple[str | Cell, ...]]:
    """Give one row for each epoch that the report shows a scan of."""
    table = findings.table
    shown = np.array([findings.period.holds(time) for time in table.times], dtype=np.bool_)
    rows: list[tuple[str | Cell, ...]] = []
    for epoch in dict.fromkeys(table.epochs[shown].tolist()):
        members = np.flatnonzero(table.epochs == epoch)
        first, last = int(members[0]), int(members[-1])
        known = list(dict.fromkeys(table.calibrations[number] for number in members))
        named = ", ".join(each or _IMPORTED for each in known)
        scans = f"{first} to {last}" if last > first else str(first)
        rows.append(
            (
                Cell(scans, anchor=f"made-in-epoch-{epoch}"),
                f"epoch {epoch}",
                f"scan {first}",
                named,
                day_and_time(table.times[first]),
                day_and_time(table.times[last]),
            )
        )
    return rows

"""Provenance: what made these numbers, so that they can be made again."""

from __future__ import annotations

from ..findings import Findings
from ..quantities import plain
from ..section import Section, Table

__all__ = ["provenance"]


def provenance(findings: Findings) -> Section:
    """Name the snapshot, calibration, settings, software and grid behind the report."""
    about = findings.about
    rows: list[tuple[str, str]] = [
        ("Site", about.site or "not named"),
        ("Store", about.location),
        ("Store snapshot", about.snapshot),
        ("Scans", str(findings.scans)),
        ("Campaign settings", about.campaign_hash or "not recorded"),
        ("Software", about.software or "not recorded"),
        ("Layout of the store", f"version {about.schema}"),
    ]
    last = findings.last
    if last is not None and findings.first is not None:
        grid = last.scan.grid
        size = f"{plain(grid.columns * grid.pitch_mm)} x {plain(grid.rows * grid.pitch_mm)} mm"
        rows.append(("Grid", f"{grid.columns} x {grid.rows} cells of {plain(1000 * grid.pitch_mm)} µm ({size})"))
        rows.append(("Calibration of the newest scan", last.scan.calibration_id or "none: an imported height map"))
        rows.append(
            ("Calibration of the baseline", findings.first.scan.calibration_id or "none: an imported height map")
        )
        rows.append(("Baseline", f"scan {findings.first.number}, epoch {last.epoch}"))
    table = Table("What made this report", ("", ""), tuple(rows))
    files = "The numbers behind the trends lie beside this page as series.csv and series.parquet."
    return Section("provenance", "Provenance", text=(files,) if findings.scans else (), tables=(table,))

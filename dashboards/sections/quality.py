"""Quality: how much of the surface was measured, how finely, and how well scans were registered."""

from __future__ import annotations

import numpy as np

from ..findings import Findings
from ..quantities import day_and_time, plain
from ..section import Section, Table

__all__ = ["quality"]

_MOST_ROWS = 24


def quality(findings: Findings) -> Section | None:
    """Tabulate coverage, uncertainty and registration of the newest scans, and name those not to be trusted."""
    if not findings.quality:
        return None
    scans = findings.quality
    coverage = np.array([scan.coverage for scan in scans])
    text = [
        f"Between {plain(100 * float(coverage.min()), 3)} and {plain(100 * float(coverage.max()), 3)} % of the cells "
        "were measured. The residual says how well the parts that hold still "
        "agree with the baseline after registration."
    ]
    doubtful = [scan for scan in scans if scan.verdict not in ("", "good")]
    if doubtful:
        numbers = ", ".join(str(scan.number) for scan in doubtful[-12:])
        text.append(f"Registration is not to be trusted in {len(doubtful)} of {len(scans)} scans: {numbers}.")
    shown = scans[-_MOST_ROWS:]
    rows = tuple(
        (
            str(scan.number),
            day_and_time(scan.time),
            f"{100 * scan.coverage:.1f} %",
            _micrometres(scan.sigma_mm),
            _micrometres(scan.residual_mm) if scan.verdict else "baseline",
            f"{scan.verdict}: {scan.reason}" if scan.reason else scan.verdict,
        )
        for scan in shown
    )
    caption = "Quality of each scan" if len(shown) == findings.scans else f"Quality of the newest {len(shown)} scans"
    head = ("Scan", "Time", "Measured", "Height uncertainty (median)", "Registration residual", "Registration")
    return Section("quality", "Quality", text=tuple(text), tables=(Table(caption, head, rows, numeric=(0, 2, 3, 4)),))


def _micrometres(length_mm: float) -> str:
    return f"{plain(1000 * length_mm, 2)} µm" if np.isfinite(length_mm) else "not measured"

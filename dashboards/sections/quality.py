"""Quality: how much of the surface was measured, how finely, and how well scans were registered."""

from __future__ import annotations

import numpy as np

from pipelines.change import NoiseModel

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
    tables = [Table(caption, head, rows, numeric=(0, 2, 3, 4))]
    noise = findings.about.noise
    if noise is not None:
        text.append(
            f"Levels of detection rest on noise model {noise.id}, calibrated on {noise.scans} scans at rest from "
            f"{noise.first} to {noise.last} ({noise.ground}): a difference scatters by the root of the sum of the "
            f"squares of {_micrometres(noise.floor_mm)}, {plain(noise.gain, 3)} times the scans' own uncertainty, and "
            f"{_micrometres(noise.sideways_mm)} times the slope."
        )
        if np.isfinite(noise.false_positives):
            share = plain(100 * noise.false_positives, 2)
            text.append(f"Of the cells of pairs that it was not fitted to, {share} % were beyond the 95 % level.")
        tables.append(_noise_table(noise))
    return Section("quality", "Quality", text=tuple(text), tables=tuple(tables))


def _noise_table(noise: NoiseModel) -> Table:
    rows = tuple(
        (
            _micrometres(cell.sigma_mm),
            plain(cell.slope, 2),
            str(cell.count),
            _micrometres(cell.observed_mm),
            _micrometres(cell.model_mm),
            f"{100 * cell.beyond:.1f} %",
        )
        for cell in noise.cells
    )
    head = ("Uncertainty stated", "Slope", "Cells", "Scatter seen", "Scatter by the model", "Beyond the 95 % level")
    return Table("Repeatability: differences between scans at rest", head, rows, numeric=(0, 1, 2, 3, 4, 5))


def _micrometres(length_mm: float) -> str:
    return f"{plain(1000 * length_mm, 2)} µm" if np.isfinite(length_mm) else "not measured"

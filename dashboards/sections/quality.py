"""Quality: how much of the surface was measured, how finely, and how well scans were registered."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipelines.change import NoiseModel

from ..charts import Trend, plot_of, trend_svg
from ..findings import Findings, Quality
from ..quantities import day_and_time, plain
from ..section import Figure, Section, Table
from ..terms import term

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
    every = max(1, -(-len(scans) // _MOST_ROWS)) if len(scans) < findings.scans else 1
    shown = scans[::-every][:_MOST_ROWS][::-1]
    rows = tuple(
        (
            str(scan.number),
            day_and_time(scan.time),
            f"{100 * scan.coverage:.1f} %",
            _micrometres(scan.sigma_mm),
            _micrometres(scan.lod_mm) if scan.verdict else "baseline",
            _micrometres(scan.residual_mm) if scan.verdict else "baseline",
            f"{scan.verdict}: {scan.reason}" if scan.reason else scan.verdict,
        )
        for scan in shown
    )
    caption = "Quality of each scan"
    if len(scans) < findings.scans:
        caption = f"Quality of {len(shown)} of {findings.scans} scans, evenly spread; the newest last"
    elif len(shown) < len(scans):
        caption = f"Quality of the newest {len(shown)} scans"
    terms = tuple(term(name) for name in ("measured", "height-uncertainty", "detection", "residual"))
    tables = [Table(caption, ("Scan", "Time", *terms, "Registration"), rows, numeric=(0, 2, 3, 4, 5))]
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
    return Section("quality", "Quality", tuple(text), tuple(tables), _figures(scans))


def _figures(scans: Sequence[Quality]) -> tuple[Figure, ...]:
    """Draw the level of detection through time; a single value says no more than its table."""
    levels = np.array([1000 * scan.lod_mm for scan in scans])
    if np.isfinite(levels).sum() < 2:
        return ()
    times = np.array([scan.time for scan in scans], dtype="datetime64[ns]")
    trend = Trend("Level of detection (µm)", times, levels, np.full(levels.shape, np.nan))
    words = f"Level of detection (95 %), median over the cells: now {plain(float(levels[-1]), 2)} µm"
    return (Figure(trend_svg(trend, f"{words}."), words, "term-detection", plot_of(trend)),)


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

"""The report: one HTML file that needs nothing else, and the series beside it as CSV and Parquet.

Each entry of `SECTIONS` turns the findings into one section, or None where it has nothing to say. A new section is a
function in `dashboards.sections` and a line here.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from configs import StoreError
from storage import Store, write_series

from . import sections
from .findings import Findings, gather
from .section import Section

__all__ = ["SECTIONS", "render", "write_findings", "write_report"]

SECTIONS: dict[str, Callable[[Findings], Section | None]] = {
    "verdict": sections.verdict,
    "period": sections.period,
    "alarms": sections.alarms,
    "trends": sections.trends,
    "maps": sections.maps,
    "metrics": sections.metrics,
    "quality": sections.quality,
    "events": sections.events,
    "provenance": sections.provenance,
}
"""Every section of a report, in the order of the page."""


def write_report(store: Store, folder: Path, *, progress: Callable[[int, int], None] | None = None) -> Path:
    """Write ``report.html``, ``series.csv`` and ``series.parquet`` into a folder.

    A store without scans gives a page that says so, and no series.

    Parameters
    ----------
    store : Store
    folder : Path
        Made where it is not there; files of an earlier report are replaced.
    progress : callable, optional
        Called with (scans read, scans to read).

    Returns
    -------
    Path
        The page.

    Raises
    ------
    StoreError
        If the folder cannot be written.
    """
    return write_findings(gather(store, progress=progress), folder)


def write_findings(findings: Findings, folder: Path) -> Path:
    """Write the report of findings that were gathered already; see `write_report`."""
    page = folder / "report.html"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if findings.scans:
            write_series(findings.series, folder / "series.csv")
            write_series(findings.series, folder / "series.parquet")
        draft = folder / "report.html.part"
        draft.write_text(render(findings), encoding="utf-8")
        draft.replace(page)  # a reader never sees half a page
    except OSError as error:
        if isinstance(error, StoreError):
            raise
        raise StoreError(f"{folder}: cannot write the report there: {error.strerror}") from None
    return page


def render(findings: Findings) -> str:
    """Give the page as HTML."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = [section for make in SECTIONS.values() if (section := make(findings)) is not None]
    loader = PackageLoader("dashboards", "templates")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.get_template("report.html").render(
        site=findings.about.site or "microrelief", software=findings.about.software, sections=made
    )

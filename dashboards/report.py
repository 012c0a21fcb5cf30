"""The report: one HTML file that needs nothing else, the series beside it as CSV and Parquet, and a PDF if asked for.

Each entry of `SECTIONS` turns the findings into one section, or None where it has nothing to say. A new section is a
function in `dashboards.sections` and a line here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from configs import StoreError
from storage import Store, write_series

from . import sections
from .findings import Findings, gather
from .page import render_page
from .section import Section

__all__ = ["COMPARISON", "SECTIONS", "Layout", "make_sections", "write_comparison", "write_findings", "write_report"]

Makers = Mapping[str, Callable[[Findings], Section | None]]

SECTIONS: Makers = {
    "verdict": sections.verdict,
    "period": sections.period,
    "alarms": sections.alarms,
    "trends": sections.trends,
    "maps": sections.maps,
    "cracks": sections.cracks,
    "weekly": sections.weekly,
    "roughness": sections.roughness,
    "environment": sections.environment,
    "metrics": sections.metrics,
    "quality": sections.quality,
    "events": sections.events,
    "definitions": sections.definitions,
    "provenance": sections.provenance,
}
"""Every section of a report, in the order of the page."""


COMPARISON: Makers = {
    "between": sections.between,
    "maps": sections.maps,
    "cracks": sections.cracks,
    "metrics": sections.between_numbers,
    "roughness": sections.roughness,
    "quality": sections.quality,
    "events": sections.events,
    "definitions": sections.definitions,
    "provenance": sections.provenance,
}
"""Every section of a comparison of two scans."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How a report is written: with a PDF or without, by the user's templates (a folder) or by ours."""

    pdf: bool = False
    templates: Path | None = None


def write_report(
    store: Store,
    folder: Path,
    *,
    layout: Layout | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write ``report.html``, ``series.csv`` and ``series.parquet`` into a folder, with ``report.pdf`` where asked for.

    A store without scans gives a page that says so, and no series.

    Parameters
    ----------
    store : Store
    folder : Path
        Made where it is not there; files of an earlier report are replaced.
    layout : Layout, optional
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
    InputError
        If a template cannot be used, or what makes PDFs is not installed.
    """
    return write_findings(gather(store, progress=progress), folder, layout)


def write_comparison(findings: Findings, folder: Path, layout: Layout | None = None) -> Path:
    """Write what `gather_comparison` found; see `write_report`."""
    return _write(findings, folder, layout, "Comparison of two scans", COMPARISON)


def write_findings(findings: Findings, folder: Path, layout: Layout | None = None) -> Path:
    """Write the report of findings that were gathered already; see `write_report`."""
    return _write(findings, folder, layout, "Surface report", SECTIONS)


def make_sections(findings: Findings, makers: Makers = SECTIONS) -> tuple[Section, ...]:
    """Give every section that has something to say."""
    return tuple(section for make in makers.values() if (section := make(findings)) is not None)


def _write(findings: Findings, folder: Path, layout: Layout | None, kind: str, makers: Makers) -> Path:
    layout = layout or Layout()
    made = make_sections(findings, makers)
    words = {"site": findings.about.site or "microrelief", "kind": kind, "software": findings.about.software}
    text = render_page(made, **words, templates=layout.templates)
    page, series = folder / "report.html", folder / "series.csv"
    with _told(folder):
        folder.mkdir(parents=True, exist_ok=True)
        if findings.scans:
            write_series(findings.series, series)
            write_series(findings.series, series.with_suffix(".parquet"))
        _replace(page, text.encode("utf-8"))
    if layout.pdf:
        from .pdf import render_pdf

        attached = {series.name: series.read_bytes()} if findings.scans else {}
        pdf = render_pdf(made, **words, templates=layout.templates, attached=attached)
        with _told(folder):
            _replace(folder / "report.pdf", pdf)
    return page


def _replace(file: Path, content: bytes) -> None:
    draft = file.with_name(f"{file.name}.part")
    draft.write_bytes(content)
    draft.replace(file)  # a reader never sees half a page


@contextmanager
def _told(folder: Path) -> Iterator[None]:
    """Tell a folder that cannot be written in one line."""
    try:
        yield
    except OSError as error:
        if isinstance(error, StoreError):
            raise
        raise StoreError(f"{folder}: cannot write the report there: {error.strerror}") from None

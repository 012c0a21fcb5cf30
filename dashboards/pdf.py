"""A report's sections as a tagged PDF: PDF/A-3b for archives and PDF/UA-1 for readers who hear a page, by typst."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.sax.saxutils import unescape

from configs import InputError

from .page import shipped
from .section import Cell, Figure, Section, Table

__all__ = ["render_pdf"]


def render_pdf(
    sections: Sequence[Section],
    *,
    site: str,
    kind: str,
    software: str,
    templates: Path | None,
    attached: Mapping[str, bytes],
) -> bytes:
    """Give the report as PDF.

    Parameters
    ----------
    sections : sequence of Section
    site, kind, software : str
        The title, what sort of report this is, and what made it.
    templates : Path or None
        Folder that may hold a ``report.typ`` of the user's own.
    attached : mapping of str to bytes
        Files inside the PDF, such as the series.

    Raises
    ------
    InputError
        If typst is not installed, or the user's template cannot be used.
    """
    try:
        import typst
    except ImportError:
        raise InputError("a PDF needs typst: pip install 'microrelief[pdf]'") from None
    own = templates / "report.typ" if templates is not None else None
    source = own.read_text(encoding="utf-8") if own is not None and own.exists() else shipped("templates/report.typ")
    with TemporaryDirectory(prefix="microrelief-report-") as made:
        folder = Path(made)
        (folder / "report.typ").write_text(source, encoding="utf-8")
        for name, content in attached.items():
            (folder / name).write_bytes(content)
        figures: list[Figure] = []
        told = {
            "site": site,
            "kind": kind,
            "software": software,
            "sections": [_section(section, figures) for section in sections],
            "attached": list(attached),
        }
        for number, figure in enumerate(figures):
            (folder / f"figure-{number}.svg").write_text(_printed(figure.svg), encoding="utf-8")
        (folder / "report.json").write_text(json.dumps(told), encoding="utf-8")
        try:
            made_pdf = typst.compile(
                folder / "report.typ",
                root=folder,
                ignore_system_fonts=True,
                format="pdf",
                pdf_standards=["a-3b", "ua-1"],
            )
        except typst.TypstError as error:
            hints = "; ".join(getattr(error, "hints", None) or ())
            raise InputError(f"the PDF could not be made: {error}{f' ({hints})' if hints else ''}") from None
    assert isinstance(made_pdf, bytes)  # one document, no output file
    return made_pdf


def _section(section: Section, figures: list[Figure]) -> dict[str, Any]:
    start = len(figures)
    figures += section.figures
    return {
        "name": section.name,
        "title": section.title,
        "tone": section.tone,
        "text": list(section.text),
        "tables": [_table(table) for table in section.tables],
        "figures": [
            {
                "file": f"figure-{start + number}.svg",
                "alt": _alternative(figure.svg),
                "caption": figure.caption,
                "link": figure.link,
                "map": 'class="map"' in figure.svg,
            }
            for number, figure in enumerate(section.figures)
        ],
    }


def _table(table: Table) -> dict[str, Any]:
    head = ("What", "Value") if table.is_facts else table.head
    return {
        "caption": table.caption,
        "head": [_cell(cell) for cell in head],
        "rows": [[_cell(cell) for cell in row] for row in table.rows],
        "numeric": list(table.numeric),
    }


def _cell(cell: str | Cell) -> dict[str, str]:
    if isinstance(cell, Cell):
        return {"text": cell.text, "link": cell.link, "anchor": cell.anchor}
    return {"text": cell, "link": "", "anchor": ""}


def _alternative(svg: str) -> str:
    """Take the alternative text out of a drawing, which carries it as its title."""
    return unescape(svg.partition("<title>")[2].partition("</title>")[0])


def _printed(svg: str) -> str:
    """Give a drawing that stands alone: with its name space and the printed colours."""
    head, _, rest = svg.partition(">")
    return f'<svg xmlns="http://www.w3.org/2000/svg"{head.removeprefix("<svg")}><style>{shipped("templates/printed.css")}</style>{rest}'

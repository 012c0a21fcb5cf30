"""Section: one part of a report, with its words, tables and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

__all__ = ["Figure", "Section", "Table", "Tone"]

Tone = Literal["", "green", "amber", "red", "no data"]


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under a head.

    `numeric` names the columns, by position, that are aligned to the right; a cell is plain text. `links` gives the
    anchors that first cells lead to, `anchors` those that rows of such first cells are: both by the cell's text.
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[int, ...] = ()
    links: Mapping[str, str] = field(default_factory=dict)
    anchors: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Figure:
    """A drawing: `svg` is trusted markup of ours, with its alternative text inside; `link` defines what it shows."""

    svg: str
    caption: str
    wide: bool = False
    link: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """One part of a report.

    Parameters
    ----------
    name : str
        Its anchor in the page and its key in `SECTIONS`.
    title : str
    text : tuple of str
        Paragraphs.
    tables : tuple of Table
    figures : tuple of Figure
    tone : {"", "green", "amber", "red", "no data"}
        Colours the section; only the verdict uses it.
    """

    name: str
    title: str
    text: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()
    tone: Tone = ""

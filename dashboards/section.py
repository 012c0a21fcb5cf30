"""Section: one part of a report, with its words, tables and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

__all__ = ["Cell", "Figure", "Section", "Table", "Tone"]

Tone = Literal["", "green", "amber", "red", "no data"]


@dataclass(frozen=True, slots=True)
class Cell:
    """A table's text that leads to an anchor of the page (`link`), or is one itself (`anchor`)."""

    text: str
    link: str = ""
    anchor: str = ""

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under a head; `numeric` names the columns, by position, that are aligned to the right."""

    caption: str
    head: tuple[str | Cell, ...]
    rows: tuple[tuple[str | Cell, ...], ...]
    numeric: tuple[int, ...] = ()

    @property
    def is_facts(self) -> bool:
        """Whether it is a list of names and values, without a head."""
        return not any(str(cell) for cell in self.head)


@dataclass(frozen=True, slots=True)
class Figure:
    """A drawing: `svg` is trusted markup of ours, with its alternative text inside.

    `link` defines what it shows; `plot` holds the same numbers for a page that can draw them itself and zoom
    (see `charts.plot_of`).
    """

    svg: str
    caption: str
    link: str = ""
    plot: Mapping[str, Any] | None = None


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

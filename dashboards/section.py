"""Section: one part of a report, with its words, tables and figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Figure", "Section", "Table", "Tone"]

Tone = Literal["", "green", "amber", "red", "no data"]


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under a head.

    `numeric` names the columns, by position, that are aligned to the right; a cell is plain text.
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Figure:
    """A drawing: `svg` is trusted markup of ours, with its alternative text inside."""

    svg: str
    caption: str
    wide: bool = False


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

"""Terms: what the words at the head of a report's tables mean, beside the metrics' own definitions."""

from __future__ import annotations

from dataclasses import dataclass

from .section import Cell

__all__ = ["TERMS", "Term", "term"]


@dataclass(frozen=True, slots=True)
class Term:
    """A word and its meaning."""

    title: str
    definition: str
    uncertainty: str = ""


TERMS: dict[str, Term] = {
    "measured": Term("Measured", "Share of the grid's cells that the scan measured.", "None: a count of cells."),
    "height-uncertainty": Term(
        "Height uncertainty",
        "Median over the cells of the standard uncertainty of a height: two in three true heights lie within it.",
    ),
    "detection": Term(
        "Level of detection",
        "A cell has changed for certain (95 %) where its change is larger than this; median over the cells.",
    ),
    "residual": Term(
        "Registration residual",
        "How well the parts that hold still agree with the baseline once the scan lies on it (1.4826 MAD).",
    ),
    "crack-length": Term("Length of a crack", "Length of the crack's centre line.", "From the noise of its line."),
    "crack-width": Term(
        "Width of a crack",
        "Mean distance between the crack's edges, weighted by length.",
        "From the noise of its edges.",
    ),
    "crack-widest": Term("Widest place", "Median of five neighbouring widths where it is greatest."),
    "crack-depth": Term(
        "Depth of a crack",
        "Mean depth along the centre line below the nearest rim, where its floor was seen: the true one is at least so "
        "large.",
        "From the heights' own.",
    ),
    "crack-volume": Term(
        "Volume of a crack", "Between the rims and the floor, where that was seen: at least.", "From the heights' own."
    ),
    "crack-seen": Term("Floor seen", "Share of the crack's cells whose floor camera and projector could both see."),
    "rate": Term(
        "Rate",
        "Slope of a robust straight line (Theil and Sen) through all values since the baseline.",
        "Sen's 95 % interval, never narrower than the values' own uncertainty allows.",
    ),
}
"""By anchor; ``term-`` goes before it in the page."""


def term(name: str, text: str = "") -> Cell:
    """Give a head's cell that leads to the definition."""
    return Cell(text or TERMS[name].title, link=f"term-{name}")

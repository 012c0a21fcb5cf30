"""PatternSet: the images to project, and what each of them tells about a projector pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["PAPER_STRIPES", "FrameRole", "PatternSet"]

PAPER_STRIPES = (2, 3, 5, 9, 15, 30, 60, 120, 240, 480)
"""Stripes per pattern in Table 1 of the paper that started the project."""


@dataclass(frozen=True, slots=True)
class FrameRole:
    """What one frame of a capture shows.

    `what` is ``white``, ``black``, ``bit`` (a stripe pattern) or ``phase`` (a sinusoid); `axis` is the
    projector axis that it codes (``columns`` or ``rows``; empty for white and black); `index` counts bits from
    the coarsest (0) and phase steps from 0; `inverted` marks the complementary partner.
    """

    what: Literal["white", "black", "bit", "phase"]
    axis: Literal["", "columns", "rows"] = ""
    index: int = 0
    inverted: bool = False


@dataclass(frozen=True, slots=True)
class PatternSet:
    """A set of patterns; the same fields as the pattern file of the capture folder format.

    Parameters
    ----------
    kind : {"gray", "stripes", "phase"}
        Gray code, equal-width stripes (the paper's Table 1), or phase shifting with Gray order.
    size : (int, int)
        Projector columns, rows.
    bits : (int, int)
        Gray bits along columns, rows; 0 where an axis is not projected. For ``phase``: bits of the order.
    offset : {"none", "centred"}
        Where the Gray code sits on the axis: from its first word, or the middle of the code on the middle
        of the axis.
    counts : tuple of int
        Stripes of each pattern, coarsest first (``stripes`` only).
    steps : int
        Phase shifts of one period (``phase`` only), at least 3.
    complementary : bool
        Each stripe pattern is followed by its inverse.
    msb_first : bool
        Coarsest pattern first.
    order : tuple of str
        Order of the groups ``white``, ``black``, ``columns``, ``rows``.
    """

    kind: Literal["gray", "stripes", "phase"]
    size: tuple[int, int]
    bits: tuple[int, int] = (10, 10)
    offset: Literal["none", "centred"] = "none"
    counts: tuple[int, ...] = ()
    steps: int = 4
    complementary: bool = True
    msb_first: bool = True
    order: tuple[str, ...] = ("white", "black", "columns", "rows")

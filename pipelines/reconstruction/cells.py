"""Cells: what decoding gives of a Gray code, whole cells as small numbers; positions are worked out when asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from .codebook import Codebook
from .edge_kernels import levels_of
from .kernels import NO_CELL
from .pixel_maps import Decoded

__all__ = ["AxisCells", "Cells", "gray_cells", "spread_of_contrast"]

HalfSteps = npt.NDArray[np.uint16]
Floats = npt.NDArray[np.float32]
Levels = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class AxisCells:
    """The cells of one projector axis, numbered along it.

    A *half step* is the middle of a cell in half cells from the beginning of the code: 2 n + 1 for cell n; 4 n + 2 for
    the pair of cells 2 n and 2 n + 1 that the finest stripes do not tell apart; and so on: the zeros at the end of
    its binary digits are the level.

    Parameters
    ----------
    edge : ndarray of float32, shape (cell + 1,)
        Where each cell begins, projector px; outside the axis, its end.
    flips : ndarray of int32, shape (cell + 1, bit)
        Bits that flip where the cell begins, coarsest is 0; -1 where there are no more.
    lowest, highest : int
        Numbers of the cells at the ends of the axis.
    """

    edge: Floats
    flips: npt.NDArray[np.int32]
    lowest: int
    highest: int

    def centres(self) -> Floats:
        """Position of each half step, projector px; NaN for 0."""
        low, high = self._ends()
        centre = (0.5 * (self.edge[low] + self.edge[high])).astype(np.float32)
        centre[NO_CELL] = np.nan
        return centre

    def widths(self) -> Floats:
        """Width of the cell of each half step, projector px; NaN for 0."""
        low, high = self._ends()
        width = self.edge[high] - self.edge[low]
        width[NO_CELL] = np.nan
        return width

    def _ends(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        step = np.arange(2 * len(self.edge) - 1)
        half = step & -step
        return (step - half) // 2, np.minimum((step + half) // 2, len(self.edge) - 1)


def gray_cells(book: Codebook) -> AxisCells:
    """Cells of a Gray code, numbered by the code, so that a pair begins at an even number."""
    number = book.word.astype(np.int64)
    for shift in (1, 2, 4, 8):
        number ^= number >> shift
    cells = 2**book.bits
    edge = np.full(cells + 1, book.last[-1] + 0.5, np.float32)
    edge[: number[0] + 1] = -0.5
    edge[number] = book.first - 0.5
    begins = np.arange(cells + 1)
    lowest = np.where(begins > 0, begins & -begins, 1)  # between n - 1 and n the lowest bit of n flips
    bit = book.bits - 1 - np.round(np.log2(lowest)).astype(np.int32)
    return AxisCells(edge, np.maximum(bit, 0).astype(np.int32)[:, np.newaxis], int(number[0]), int(number[-1]))


class Cells(Decoded):
    """A capture of a Gray code decoded to whole cells.

    `column`, `row`, their sigmas and `level` are worked out from the cells when they are first asked for; `refine` does
    not ask. The standard uncertainty is that of a uniform error within the cell and, at its edges, the noise.

    Parameters
    ----------
    steps : (ndarray, ndarray) of uint16, shape (row, column)
        Half step (see `AxisCells`) of each pixel along columns and rows; 0 where not decoded.
    axes : (AxisCells or None, AxisCells or None)
        None where the axis was not projected.
    levels : (float, float)
        By how much twice a pattern exceeds white and black where its stripes end, of white minus black, along columns
        and rows; 0 with inverses.
    noise : float
        Standard deviation of a pixel's value, in 8-bit counts.
    texture, contrast : ndarray of uint8, shape (row, column)
        As of `Decoded`.
    """

    steps: tuple[HalfSteps, HalfSteps]
    axes: tuple[AxisCells | None, AxisCells | None]
    levels: tuple[float, float]
    noise: float

    def __init__(
        self,
        steps: tuple[HalfSteps, HalfSteps],
        axes: tuple[AxisCells | None, AxisCells | None],
        levels: tuple[float, float],
        noise: float,
        texture: Levels,
        contrast: Levels,
    ) -> None:
        for name, value in zip(
            ("steps", "axes", "levels", "noise", "texture", "contrast"),
            (steps, axes, levels, noise, texture, contrast),
            strict=True,
        ):
            object.__setattr__(self, name, value)

    @cached_property
    def column(self) -> Floats:
        """As of `Decoded`."""
        return self._place(0)

    @cached_property
    def row(self) -> Floats:
        """As of `Decoded`."""
        return self._place(1)

    @cached_property
    def sigma_column(self) -> Floats:
        """As of `Decoded`."""
        return self._sigma(0)

    @cached_property
    def sigma_row(self) -> Floats:
        """As of `Decoded`."""
        return self._sigma(1)

    @cached_property
    def level(self) -> Levels:
        """As of `Decoded`: the coarser of the two axes."""
        level = np.zeros(self.steps[0].shape, np.uint8)
        for cells, step in zip(self.axes, self.steps, strict=True):
            if cells:
                levels_of(step.reshape(-1), level.reshape(-1))
        return level

    def _place(self, axis: int) -> Floats:
        cells, step = self.axes[axis], self.steps[axis]
        return cells.centres()[step] if cells else np.full(step.shape, np.nan, np.float32)

    def _sigma(self, axis: int) -> Floats:
        cells, step = self.axes[axis], self.steps[axis]
        if not cells:
            return np.full(step.shape, np.nan, np.float32)
        sigma: Floats = cells.widths()[step] * spread_of_contrast(self.noise * np.sqrt(2))[self.contrast]
        return sigma


def spread_of_contrast(jitter: float) -> Floats:
    """Standard uncertainty of a whole cell, in cells, for each contrast, shape (256,).

    Parameters
    ----------
    jitter : float
        Noise of pattern minus inverse, in 8-bit counts.
    """
    swing = np.maximum(np.arange(256, dtype=np.float64), 0.5)
    return np.sqrt(1 / 12 + np.square(jitter / swing)).astype(np.float32)

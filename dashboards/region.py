"""Region: the part of a surface that a report is about, and metrics measured anew inside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from configs import InputError
from pipelines import Comparison, Grid, Measurement
from pipelines.change import METRICS, NoiseModel, apply_motion, measure, polygon_mask
from storage import Stored

__all__ = ["Region", "measure_inside"]

Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Region:
    """A polygon of (x, y) in the site frame, mm."""

    corners: tuple[tuple[float, float], ...]

    @classmethod
    def parse(cls, text: str) -> Region:
        """Read two opposite corners ``x0,y0,x1,y1`` or a polygon ``x0,y0,x1,y1,x2,y2,...``.

        Raises
        ------
        InputError
            If it is neither.
        """
        try:
            numbers = [float(part) for part in text.replace(";", ",").split(",")]
        except ValueError:
            numbers = []
        if len(numbers) == 4:
            x0, y0, x1, y1 = numbers
            numbers = [x0, y0, x1, y0, x1, y1, x0, y1]
        if len(numbers) < 6 or len(numbers) % 2 or not np.isfinite(numbers).all():
            raise InputError(
                f"--region {text}: give two corners in mm, x0,y0,x1,y1, or a polygon x0,y0,x1,y1,x2,y2,... "
                "(write --region=-2,-2,2,2 where it begins with a minus sign)"
            )
        return cls(tuple(zip(numbers[::2], numbers[1::2], strict=True)))

    def cells(self, grid: Grid) -> Mask:
        """Mark its cells, shape (rows, columns).

        Raises
        ------
        InputError
            If it holds none.
        """
        mask = polygon_mask([self.corners], grid)
        if not mask.any():
            x_low, x_high, y_low, y_high = grid.extent_mm
            raise InputError(
                f"the region holds no cell: the height map reaches from {x_low:.2f} to {x_high:.2f} mm in x and "
                f"from {y_low:.2f} to {y_high:.2f} mm in y"
            )
        return mask

    def __str__(self) -> str:
        return ", ".join(f"({x:g}, {y:g})" for x, y in self.corners) + " mm"


def measure_inside(
    baseline: Stored,
    stored: Stored,
    counted: Mask,
    stable: Mask,
    metrics: Mapping[str, str],
    noise: NoiseModel | None,
) -> dict[str, Measurement]:
    """Measure a stored scan's metrics over some cells, with the registration that the store keeps.

    A baseline has none; what is no metric of a surface, such as the temperature, is left out.
    """
    change = stored.change
    if change is None:
        return {}
    moved = apply_motion(stored.scan, change.motion)
    comparison = Comparison(baseline.scan, moved, change, stable, counted, noise)
    return measure(comparison, [name for name in metrics if name in METRICS])

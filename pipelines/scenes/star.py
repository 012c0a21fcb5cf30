"""Star: the printed star of the paper, a regular star that stands on a stage or high above a background."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .board import Still
from .scene import Array, SceneTruth

__all__ = ["Star"]


@dataclass(frozen=True, slots=True)
class Star:
    """A regular star in the middle, its base in the plane z = 0, on a flat background that may lie far below.

    Every edge of a regular star has the same distance d from its centre. With n the outward normal of the edge in
    whose sector a place p lies, g = n.p / d is 0 in the centre and 1 along the whole outline, and the height is

        g <= 1:  rim + (height - rim) (1 - g)
        g >  1:  background

    so the roof is flat where `rim_mm` equals `height_mm`, and else has a ridge along each point and a valley along each
    notch. Within the outline lie A = n R r sin(pi / n) mm2, R and r the radii of tips and notches, and between the
    base and the roof A (rim + (height - rim) / 3) mm3. Walls are upright.

    Parameters
    ----------
    across_mm : float
        Diameter of the circle through the tips.
    height_mm : float
        Top of the star above its base.
    rim_mm : float, optional
        Height of the roof along the outline; that of the top if not given.
    tips : int
    notch : float
        Radius of the notches as a share of that of the tips; 0.382 is the pentagram's.
    background_mm : float
        Height of the background, 0 or below; the star then stands on a post of its own outline.
    reflects, background_reflects : float
        Albedo, 0 to 1.

    Raises
    ------
    ValueError
        There is no such star.
    """

    across_mm: float = 7.0
    height_mm: float = 2.5
    rim_mm: float | None = None
    tips: int = 5
    notch: float = 0.45
    background_mm: float = -4.5
    reflects: float = 0.6
    background_reflects: float = 0.35

    def __post_init__(self) -> None:
        if self.tips < 3:
            raise ValueError(f"a star has 3 tips or more, not {self.tips}")
        if not 0 < self.notch < np.cos(np.pi / self.tips):
            raise ValueError(f"notch must lie between 0 and {np.cos(np.pi / self.tips):.3f}, not {self.notch}")
        if not (self.across_mm > 0 and 0 < self.rim <= self.height_mm):
            raise ValueError("a star needs a positive size, and a rim above 0 and not above its top")
        if self.background_mm > 0:
            raise ValueError(f"background_mm must not lie above the star's base: {self.background_mm}")

    @property
    def rim(self) -> float:
        """Height of the roof along the outline, mm."""
        return self.height_mm if self.rim_mm is None else self.rim_mm

    @property
    def region_mm(self) -> tuple[float, float, float, float]:
        """The square around the circle through the tips."""
        half = self.across_mm / 2
        return -half, half, -half, half

    @property
    def area_mm2(self) -> float:
        """Area within the outline."""
        outer = self.across_mm / 2
        return float(self.tips * outer * self.notch * outer * np.sin(np.pi / self.tips))

    @property
    def volume_mm3(self) -> float:
        """Volume between the base z = 0 and the roof."""
        return self.area_mm2 * (self.rim + (self.height_mm - self.rim) / 3)

    @property
    def edge_distance_mm(self) -> float:
        """Distance of each edge's line from the centre."""
        return self._edge()[2]

    def outline(self, x_mm: Array, y_mm: Array) -> Array:
        """Give g of the formula above, below 1 inside; (g - 1) `edge_distance_mm` is how far off an edge's line, mm."""
        x, y = (np.asarray(axis, np.float64) for axis in np.broadcast_arrays(x_mm, y_mm))
        along, across, distance = self._edge()
        sector = 2 * np.pi / self.tips
        from_tip = np.arctan2(x, y)  # one tip points to +y
        from_tip = np.abs(from_tip - sector * np.round(from_tip / sector))
        radius = np.hypot(x, y)
        g: Array = radius * (along * np.cos(from_tip) + across * np.sin(from_tip)) / distance
        return g

    def at(self, x_mm: Array, y_mm: Array) -> Still:
        """Fix the places, any shape."""
        g = self.outline(x_mm, y_mm)
        inside = g <= 1
        height = np.where(inside, self.rim + (self.height_mm - self.rim) * (1 - g), self.background_mm)
        return Still(height, np.where(inside, self.reflects, self.background_reflects))

    def truth(self, before_h: float, after_h: float) -> SceneTruth:
        """Nothing ever changes."""
        return SceneTruth(self.region_mm, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def _edge(self) -> tuple[float, float, float]:
        """Normal of the edge from the tip (R, 0) to the notch at the angle pi / tips, and its distance."""
        outer, half = self.across_mm / 2, np.pi / self.tips
        step = np.array([self.notch * np.cos(half) - 1, self.notch * np.sin(half)])
        normal = np.array([step[1], -step[0]]) / np.hypot(*step)
        return float(normal[0]), float(normal[1]), float(normal[0] * outer)

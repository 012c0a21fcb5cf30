"""Scene: what a simulated rig looks at, a surface known in closed form at every place and time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

__all__ = ["Array", "Ground", "Scene", "SceneTruth"]

Array = npt.NDArray[np.float64]


@runtime_checkable
class Ground(Protocol):
    """A scene at fixed places; what depends on the place alone was computed when it was made."""

    def height(self, elapsed_h: float) -> Array:
        """Height above the scene's z = 0, mm, in the shape of the places."""
        ...

    def albedo(self, elapsed_h: float) -> Array:
        """Share of the light that is scattered back, 0 to 1, in the shape of the places."""
        ...


@dataclass(frozen=True, slots=True)
class SceneTruth:
    """What truly changed in the soil from one age to another, by quadrature of the closed form.

    Parameters
    ----------
    region_mm : (float, float, float, float)
        x_min, x_max, y_min, y_max of the area that counts, scene frame.
    net_volume_mm3 : float
        Integral of the change of height, crack floors included.
    plate_volume_mm3 : float
        The same, over what is no crack at the later age: without the floors that no optics at an angle sees whole.
    crack_area_mm2 : float
        Area nearer to a centre line than half the crack's width, at the later age.
    crack_length_mm : float
        Length of the centre lines.
    crack_opening_mm : float
        Mean width across the centre lines at the later age, weighted by length.
    edge_lift_mm : float
        How much the plates' edges rose over their interiors: on each plate the mean change of height 0.05 to 0.25 mm
        from the crack's wall, less the mean farther from it than 0.6 of the greatest such distance; weighted over
        plates by the area of their edges. Plates of less than 1 mm2 in the region do not count.
    """

    region_mm: tuple[float, float, float, float]
    net_volume_mm3: float
    plate_volume_mm3: float
    crack_area_mm2: float
    crack_length_mm: float
    crack_opening_mm: float
    edge_lift_mm: float


@runtime_checkable
class Scene(Protocol):
    """A surface with closed-form height and albedo.

    The scene frame is right-handed, mm, z up, its origin in the middle of the view. A rig knows no more of a scene than
    this protocol.
    """

    @property
    def region_mm(self) -> tuple[float, float, float, float]:
        """The part that may change: x_min, x_max, y_min, y_max."""
        ...

    def at(self, x_mm: Array, y_mm: Array) -> Ground:
        """Fix the places, any shape."""
        ...

    def truth(self, before_h: float, after_h: float) -> SceneTruth:
        """What changed between two ages, hours."""
        ...

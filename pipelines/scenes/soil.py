"""Soil: a crust that dries in a holder. Cracks open, plates curl up at their rims, the whole settles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from .crack_network import CentreLines, CrackNetwork
from .noise import fractal, grains
from .scene import Array, SceneTruth

__all__ = ["Soil"]

# The truth is told in the terms in which pipelines.change defines edge lift; a scene knows nothing of that room.
EDGE_BAND_MM = 0.05, 0.25
INTERIOR_SHARE = 0.6
LEAST_PLATE_MM2 = 1.0

CURL_DECAY_MM = 0.8
HOLDER_SOFTNESS_MM = 0.03


@dataclass(frozen=True, slots=True)
class Soil:
    """A square of soil crust in a holder that never moves.

    With dryness s(h) = 1 - exp(-h / `drying_h`) and the same, later by up to `onset_h` from place to place, for what
    cracks do (s_c), the plates' height over their wet relief at distance d from a centre line is

        outside (d >= w/2):  -settlement s + lift s_c exp(-(d - w/2) / 0.8 mm)
        inside  (d <  w/2):  -settlement s + lift s_c - (depth + lift s_c) (1 - (2 d / w)^4)

    with width w = hairline + opening m s_c and depth = (0.2 + 0.8 s_c) `depth_mm`; m varies smoothly by +-25 % from
    place to place.

    Parameters
    ----------
    seed : int
        Another seed is another soil: relief, grains, colours and cracks.
    side_mm : float
        The soil fills ``|x|, |y| < side / 2``; beyond it is the holder, flat but for its machining marks.
    hairline_mm, opening_mm : float
        Width of the cracks at age 0, and what drying adds.
    depth_mm, lift_mm, settlement_mm : float
        Depth of a dry crack below the wet surface, lift of the plates' rims, fall of the whole.
    drying_h, onset_h : float
    """

    seed: int = 7
    side_mm: float = 10.0
    hairline_mm: float = 0.05
    opening_mm: float = 0.35
    depth_mm: float = 0.6
    lift_mm: float = 0.25
    settlement_mm: float = 0.10
    drying_h: float = 30.0
    onset_h: float = 10.0

    @property
    def region_mm(self) -> tuple[float, float, float, float]:
        """The soil itself."""
        half = self.side_mm / 2
        return -half, half, -half, half

    def cracks(self) -> CrackNetwork:
        """The centre lines: plates about 3.4 mm wide, from a shaken lattice of seeds."""
        spacing = 3.4
        shake = np.random.default_rng(self.seed).uniform(-0.38, 0.38, (7, 7, 2))
        lattice = np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-3, 4), indexing="ij"), axis=-1)
        return CrackNetwork(((lattice + shake + 0.5) * spacing).reshape(-1, 2))

    def at(self, x_mm: Array, y_mm: Array) -> SoilGround:
        """Fix the places, any shape."""
        x, y = (np.asarray(axis, np.float64) for axis in np.broadcast_arrays(x_mm, y_mm))
        return SoilGround(self, x, y)

    def truth(self, before_h: float, after_h: float, pitch_mm: float = 0.01, inset_mm: float = 0.0) -> SceneTruth:
        """What changed between two ages, by the midpoint rule on squares of `pitch_mm`.

        Parameters
        ----------
        before_h, after_h : float
        pitch_mm : float
        inset_mm : float
            Leave out a margin of the soil, so wide, along the holder.
        """
        ground, plates, cell = _squares(self, pitch_mm, inset_mm)
        lines, on_lines, stretch = _walk(self, inset_mm)
        dz = ground.height(after_h) - ground.height(before_h)
        wall = ground.distance - ground.width(after_h) / 2
        widths = on_lines.width(after_h) / stretch
        return SceneTruth(
            region_mm=_inset(self, inset_mm),
            net_volume_mm3=float(dz.sum()) * cell,
            plate_volume_mm3=float(dz[wall >= 0].sum()) * cell,
            crack_area_mm2=float(np.count_nonzero(wall < 0)) * cell,
            crack_length_mm=float(lines.length_mm.sum()),
            crack_opening_mm=float(np.average(widths, weights=lines.length_mm)),
            edge_lift_mm=_edge_lift(dz, wall, plates, cell),
        )


class SoilGround:
    """A soil at fixed places: `distance` to the centre lines and the wet relief are computed once."""

    def __init__(self, soil: Soil, x: Array, y: Array) -> None:
        self._soil = soil
        seed = 7919 * soil.seed
        self.distance = soil.cracks().distance(x, y)
        outside = np.maximum(np.abs(x), np.abs(y)) - soil.side_mm / 2
        self._holder = 1 / (1 + np.exp(-np.clip(outside / (HOLDER_SOFTNESS_MM / 4), -40, 40)))
        grain = grains(x, y, seed + 11, 0.9, (0.10, 0.32))
        rough = fractal(x, y, seed + 1, 0.30, 3, 0.6)
        self._relief = 0.16 * fractal(x, y, seed, 4.5, 4) + 0.035 * rough + grain
        marks = fractal(x * 0.35, y, seed + 5, 0.25, 2, 0.6)
        self._plate = 0.18 + 0.006 * marks
        stain = fractal(x, y, seed + 2, 2.2, 3)
        speckle = fractal(x, y, seed + 3, 0.16, 2, 0.7)
        self._wet_albedo = np.clip(0.40 + 0.10 * stain + 0.16 * speckle + 0.5 * grain, 0.12, 0.75)
        self._holder_albedo = np.clip(0.42 + 0.10 * marks + 0.14 * fractal(x, y, seed + 6, 0.2, 2), 0.1, 0.8)
        self._vary = 1 + 0.25 * fractal(x, y, seed + 8, 3.0, 2)
        self._onset_h = soil.onset_h * (0.5 + 0.5 * fractal(x, y, seed + 9, 6.0, 1))

    def width(self, elapsed_h: float) -> Array:
        """Width of the crack that is nearest, mm."""
        return self._soil.hairline_mm + self._soil.opening_mm * self._vary * self._cracking(elapsed_h)

    def height(self, elapsed_h: float) -> Array:
        """See `Soil`; the holder stays as it is."""
        soil = self._soil
        cracking = self._cracking(elapsed_h)
        width = soil.hairline_mm + soil.opening_mm * self._vary * cracking
        lift = soil.lift_mm * self._vary * cracking
        depth = soil.depth_mm * (0.2 + 0.8 * cracking)
        across = 2 * self.distance / width
        plate = lift * np.exp(np.minimum(0.0, (width / 2 - self.distance) / CURL_DECAY_MM))
        floor = (depth + lift) * np.clip(1 - across**4, 0, None)
        dry = self._relief - soil.settlement_mm * _dryness(elapsed_h, soil.drying_h) + plate - floor
        height: Array = dry + self._holder * (self._plate - dry)
        return height

    def albedo(self, elapsed_h: float) -> Array:
        """Dry soil is brighter than wet; the holder stays as it is."""
        soil = self._wet_albedo * (1 + 0.25 * _dryness(elapsed_h, self._soil.drying_h))
        albedo: Array = soil + self._holder * (self._holder_albedo - soil)
        return albedo

    def _cracking(self, elapsed_h: float) -> Array:
        late = np.maximum(0.0, elapsed_h - self._onset_h)
        cracking: Array = 1 - np.exp(-late / self._soil.drying_h)
        return cracking


def _dryness(elapsed_h: float, drying_h: float) -> float:
    return float(1 - np.exp(-max(0.0, elapsed_h) / drying_h))


def _inset(soil: Soil, inset_mm: float) -> tuple[float, float, float, float]:
    half = soil.side_mm / 2 - inset_mm
    return -half, half, -half, half


@lru_cache(maxsize=1)  # a campaign is judged scan by scan on the same squares
def _squares(soil: Soil, pitch_mm: float, inset_mm: float) -> tuple[SoilGround, npt.NDArray[np.intp], float]:
    low, high, _, _ = _inset(soil, inset_mm)
    count = round((high - low) / pitch_mm)
    side = (high - low) / count
    x, y = np.meshgrid(*(low + (np.arange(count) + 0.5) * side,) * 2)
    return soil.at(x, y), soil.cracks().plate(x, y), side**2


@lru_cache(maxsize=1)
def _walk(soil: Soil, inset_mm: float) -> tuple[CentreLines, SoilGround, Array]:
    cracks = soil.cracks()
    lines = cracks.lines(_inset(soil, inset_mm))
    return lines, soil.at(lines.x_mm, lines.y_mm), cracks.stretch(lines)


def _edge_lift(dz: Array, wall: Array, plates: npt.NDArray[np.intp], cell_mm2: float) -> float:
    """See `SceneTruth.edge_lift_mm`; `wall` is the distance to the nearest crack's wall."""
    lifts, weights = [], []
    for number in np.unique(plates):
        inside = (plates == number) & (wall >= 0)
        if np.count_nonzero(inside) * cell_mm2 < LEAST_PLATE_MM2:
            continue
        edge = inside & (wall > EDGE_BAND_MM[0]) & (wall < EDGE_BAND_MM[1])
        interior = inside & (wall > max(EDGE_BAND_MM[1], INTERIOR_SHARE * float(wall[inside].max())))
        if edge.any() and interior.any():
            lifts.append(float(dz[edge].mean() - dz[interior].mean()))
            weights.append(int(np.count_nonzero(edge)))
    return float(np.average(lifts, weights=weights)) if lifts else 0.0

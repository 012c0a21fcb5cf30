"""Organisms: small creatures that crawl over asphalt and eat it, each path, shape and bite known in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from .noise import fractal, grains
from .scene import Array, SceneTruth

__all__ = ["Organisms", "OrganismsGround", "OrganismsTruth"]

WAVES = 3  # sines per coordinate of a path
SECONDS = 3600.0
KEPT_APART_S = 600
TRIES = 200


@dataclass(frozen=True, slots=True, eq=False)
class OrganismsTruth:
    """Where the organisms are at one age and what they are.

    Parameters
    ----------
    x_mm, y_mm : ndarray of float64, shape (count,)
        Their middles, scene frame.
    heading : ndarray of float64, shape (count,)
        Direction in which each creeps, radians from +x.
    length_mm, width_mm, height_mm : ndarray of float64, shape (count,)
    area_mm2, volume_mm3 : ndarray of float64, shape (count,)
        Footprint, and what lies between its back and the substrate, of each by itself.
    bites : ndarray of int64, shape (count,)
        Bites that each has begun since age 0.
    """

    x_mm: Array
    y_mm: Array
    heading: Array
    length_mm: Array
    width_mm: Array
    height_mm: Array
    area_mm2: Array
    volume_mm3: Array
    bites: npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Organisms:
    """Some organisms on a plate of asphalt.

    Organism k is in the middle of its ellipse, half axes a and b, and lies on the substrate with the back
    h (1 - (u/a)^2 - (v/b)^2), u along its heading: footprint pi a b, volume pi a b h / 2. Where two overlap the higher
    back is seen. Its middle goes along

        x(t) = x_k + sum_i A_i sin(w_i t + p_i),     y(t) likewise,

    with a mean speed of about `speed_mm_s`, and it heads along the path. Every `bite_s` it bites: over the next
    `bite_s` the substrate sinks by d (1 - r^2 / R^2)^2 within R = `bite_radius_mm` of where it was, d such that a bite
    takes `bite_mm3` = pi R^2 d / 3. Bites add up, until `meal_s` is over; an age before 0 is age 0.

    Parameters
    ----------
    seed : int
        Another seed is another plate and other organisms.
    count : int
    side_mm : float
        The organisms keep within ``|x|, |y| < side / 2``.
    length_mm, width_mm, height_mm : (float, float)
        Smallest and largest of each.
    speed_mm_s, apart_mm, bite_s, meal_s, bite_mm3, bite_radius_mm : float

    Raises
    ------
    ValueError
        If a number that must be positive is not.
    """

    seed: int = 3
    count: int = 20
    side_mm: float = 9.0
    length_mm: tuple[float, float] = (0.6, 1.0)
    width_mm: tuple[float, float] = (0.3, 0.45)
    height_mm: tuple[float, float] = (0.12, 0.25)
    speed_mm_s: float = 0.05
    apart_mm: float = 0.4
    bite_s: float = 4.0
    meal_s: float = 600.0
    bite_mm3: float = 2e-4
    bite_radius_mm: float = 0.15

    def __post_init__(self) -> None:
        for name in ("count", "side_mm", "bite_s", "bite_radius_mm"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be above 0, not {getattr(self, name)}")

    @property
    def region_mm(self) -> tuple[float, float, float, float]:
        """The plate on which they crawl."""
        half = self.side_mm / 2
        return -half, half, -half, half

    def at(self, x_mm: Array, y_mm: Array) -> OrganismsGround:
        """Fix the places, any shape."""
        x, y = (np.asarray(axis, np.float64) for axis in np.broadcast_arrays(x_mm, y_mm))
        return OrganismsGround(self, x, y)

    def creatures(self, elapsed_h: float) -> OrganismsTruth:
        """Tell where each organism is and what it has eaten."""
        t = max(0.0, elapsed_h) * SECONDS
        a, b, h = _bodies(self)
        (x, y), (vx, vy) = _places(self, t)
        count = np.full(self.count, int(np.floor(min(t, self.meal_s) / self.bite_s)) + 1, dtype=np.int64)
        return OrganismsTruth(x, y, np.arctan2(vy, vx), 2 * a, 2 * b, h, np.pi * a * b, np.pi * a * b * h / 2, count)

    def eaten_mm3(self, elapsed_h: float) -> float:
        """Volume that all have taken from the substrate since age 0."""
        t = min(max(0.0, elapsed_h) * SECONDS, self.meal_s)
        whole, part = divmod(t, self.bite_s)
        return self.count * self.bite_mm3 * (whole + part / self.bite_s)

    def truth(self, before_h: float, after_h: float) -> SceneTruth:
        """Net change of the substrate: the organisms only move, so their own volume does not change the sum.

        That holds where none overlaps another; an overlap hides less than the smaller body.
        """
        net = self.eaten_mm3(before_h) - self.eaten_mm3(after_h)
        return SceneTruth(self.region_mm, net, net, 0.0, 0.0, 0.0, 0.0)


class OrganismsGround:
    """Asphalt at fixed places: its relief, grains and colour are computed once."""

    def __init__(self, scene: Organisms, x: Array, y: Array) -> None:
        self._scene = scene
        self._x, self._y = x, y
        seed = 104729 * scene.seed
        stones = grains(x, y, seed + 1, 1.1, (0.2, 0.5))
        self._relief = 0.06 * fractal(x, y, seed, 2.5, 4) + 0.35 * stones
        speckle = fractal(x, y, seed + 2, 0.18, 3, 0.7)
        self._colour = np.clip(0.30 + 0.10 * speckle + 0.25 * (stones > 0), 0.12, 0.7)
        self._skin = np.clip(0.62 + 0.08 * fractal(x, y, seed + 3, 0.12, 2), 0.4, 0.8)

    def substrate(self, elapsed_h: float) -> Array:
        """Height of the asphalt without its guests, mm."""
        scene = self._scene
        t = min(max(0.0, elapsed_h) * SECONDS, scene.meal_s)
        deep = 3 * scene.bite_mm3 / (np.pi * scene.bite_radius_mm**2)
        height: Array = self._relief.copy()
        for number in range(int(np.floor(t / scene.bite_s)) + 1):
            share = min(1.0, t / scene.bite_s - number)
            (cx, cy), _ = _places(scene, number * scene.bite_s)
            for k in range(scene.count):
                self._sink(height, float(cx[k]), float(cy[k]), share * deep)
        return height

    def height(self, elapsed_h: float) -> Array:
        """See `Organisms`."""
        height: Array = self.substrate(elapsed_h) + self._backs(elapsed_h)
        return height

    def albedo(self, elapsed_h: float) -> Array:
        """Organisms are brighter than asphalt."""
        return np.where(self._backs(elapsed_h) > 0, self._skin, self._colour)

    def _backs(self, elapsed_h: float) -> Array:
        now = self._scene.creatures(elapsed_h)
        back = np.zeros(self._x.shape)
        for k in range(self._scene.count):
            near = self._near(float(now.x_mm[k]), float(now.y_mm[k]), float(now.length_mm[k]) / 2)
            if near is None:
                continue
            x, y = self._x[near] - now.x_mm[k], self._y[near] - now.y_mm[k]
            along = x * np.cos(now.heading[k]) + y * np.sin(now.heading[k])
            across = y * np.cos(now.heading[k]) - x * np.sin(now.heading[k])
            q = (2 * along / now.length_mm[k]) ** 2 + (2 * across / now.width_mm[k]) ** 2
            back[near] = np.maximum(back[near], now.height_mm[k] * np.clip(1 - q, 0, None))
        return back

    def _sink(self, height: Array, x_mm: float, y_mm: float, deep: float) -> None:
        radius = self._scene.bite_radius_mm
        near = self._near(x_mm, y_mm, radius)
        if near is not None:
            r2 = ((self._x[near] - x_mm) ** 2 + (self._y[near] - y_mm) ** 2) / radius**2
            height[near] -= deep * np.clip(1 - r2, 0, None) ** 2

    def _near(
        self, x_mm: float, y_mm: float, reach: float
    ) -> tuple[slice, ...] | tuple[npt.NDArray[np.intp], ...] | None:
        """Which places may lie within `reach`: a window of a raster, found without a look at all of it."""
        if self._x.ndim == 2 and min(self._x.shape) > 1 and self._is_raster:
            columns, rows = self._x[0], self._y[:, 0]
            c0, c1 = np.searchsorted(columns, [x_mm - reach, x_mm + reach])
            r0, r1 = np.searchsorted(rows, [y_mm - reach, y_mm + reach])
            return (slice(int(r0), int(r1)), slice(int(c0), int(c1))) if r1 > r0 and c1 > c0 else None
        inside = np.nonzero((np.abs(self._x - x_mm) <= reach) & (np.abs(self._y - y_mm) <= reach))
        return inside if inside[0].size else None

    @property
    def _is_raster(self) -> bool:
        ascending = bool((np.diff(self._x[0]) > 0).all() and (np.diff(self._y[:, 0]) > 0).all())
        return ascending and bool((self._x == self._x[:1]).all() and (self._y == self._y[:, :1]).all())


@lru_cache(maxsize=4)
def _bodies(scene: Organisms) -> tuple[Array, Array, Array]:
    """Half axes and heights."""
    random = np.random.default_rng([scene.seed, 1])
    a, b, h = (random.uniform(*span, scene.count) for span in (scene.length_mm, scene.width_mm, scene.height_mm))
    return a / 2, b / 2, h


@lru_cache(maxsize=4)
def _waves(scene: Organisms) -> tuple[Array, Array, Array, Array]:
    """Middle (2, count), and amplitude, frequency and phase (2, count, wave) of every path."""
    random = np.random.default_rng([scene.seed, 2])
    # on a shaken lattice, so that the field is filled; paths may cross
    columns = int(np.ceil(np.sqrt(scene.count)))
    rows = -(-scene.count // columns)
    cell = scene.side_mm / np.array([columns, rows])
    seconds = np.arange(0.0, KEPT_APART_S + 1)[:, None, None]
    drawn: list[tuple[Array, Array, Array, Array]] = []
    gone: list[Array] = []
    for k in range(scene.count):
        # the last try stands: a crowded plate has no room to keep apart
        for _ in range(TRIES):
            amplitude = random.uniform(0.2, 0.5, (2, WAVES))
            frequency = 2 * np.pi / random.uniform(25.0, 90.0, (2, WAVES))
            phase = random.uniform(0, 2 * np.pi, (2, WAVES))
            # the root mean square of the speed is that of the sines
            amplitude *= scene.speed_mm_s / np.sqrt((amplitude**2 * frequency**2 / 2).sum())
            reach = amplitude.sum(axis=1).max() + scene.length_mm[1] / 2
            room = max(scene.side_mm / 2 - reach, 0.0)
            lattice = np.array([k % columns, k // columns]) + 0.5 + random.uniform(-0.25, 0.25, 2)
            middle = np.clip(lattice * cell - scene.side_mm / 2, -room, room)
            path = middle + (amplitude * np.sin(frequency * seconds + phase)).sum(axis=2)
            if all(np.hypot(*(path - other).T).min() >= scene.apart_mm for other in gone):
                break
        drawn.append((middle, amplitude, frequency, phase))
        gone.append(path)
    middles, amplitudes, frequencies, phases = (np.stack(part, axis=1) for part in zip(*drawn, strict=True))
    return middles, amplitudes, frequencies, phases


def _places(scene: Organisms, t: float) -> tuple[Array, Array]:
    """Middles and velocities at t seconds, (2, count) each."""
    middle, amplitude, frequency, phase = _waves(scene)
    angle = frequency * t + phase
    where: Array = middle + (amplitude * np.sin(angle)).sum(axis=2)
    velocity: Array = (amplitude * frequency * np.cos(angle)).sum(axis=2)
    return where, velocity

"""SimulatedStage: carries the simulated rig's sample, as unsure of its steps as a real stage is."""

from __future__ import annotations

import numpy as np

from configs import DeviceUnavailable

__all__ = ["SimulatedStage"]

STEP_MM = 0.00125


class SimulatedStage:
    """A stage without encoders: it says where it was sent, in whole steps, and stands near there.

    Parameters
    ----------
    error_mm : float
        Standard deviation of where it really stands, along each axis.
    travel_mm : float
        It reaches so far from its zero, either way.
    seed : int
        The same seed and place give the same error.
    """

    def __init__(self, *, error_mm: float = 0.01, travel_mm: float = 50.0, seed: int = 1) -> None:
        if error_mm < 0 or travel_mm <= 0:
            raise ValueError("error_mm must not be below 0, and travel_mm above")
        self._error_mm, self._travel_mm, self._seed = error_mm, travel_mm, seed
        self._steps = (0, 0)
        self._open = False

    @property
    def sample_mm(self) -> tuple[float, float]:
        """Where the sample really is, mm: for the rig that looks at it, and to judge results."""
        if self._steps == (0, 0):  # the zero is where the sample lay when it was set
            return 0.0, 0.0
        chance = np.random.default_rng([self._seed, *(step % 2**31 for step in self._steps)])
        x, y = STEP_MM * np.asarray(self._steps) + chance.normal(0.0, self._error_mm, 2)
        return float(x), float(y)

    def open(self) -> None:
        """Nothing to hold."""
        self._open = True

    def home(self) -> None:
        """Go to its zero."""
        self.move_to(0.0, 0.0)

    def move_to(self, x_mm: float, y_mm: float) -> None:
        """Stand there at once."""
        self._check_open()
        if max(abs(x_mm), abs(y_mm)) > self._travel_mm:
            raise DeviceUnavailable(f"the simulated stage reaches {self._travel_mm:g} mm, not {x_mm:g}, {y_mm:g}")
        self._steps = (round(x_mm / STEP_MM), round(y_mm / STEP_MM))

    def where(self) -> tuple[float, float]:
        """Where it was sent, in whole steps."""
        self._check_open()
        return self._steps[0] * STEP_MM, self._steps[1] * STEP_MM

    def close(self) -> None:
        """Nothing to let go."""
        self._open = False

    def _check_open(self) -> None:
        if not self._open:
            raise DeviceUnavailable("simulated stage: not open; call open() before it moves")

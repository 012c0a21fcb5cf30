"""What is believed of lenses before any corner: weak, as residuals beside those of the corners."""

from __future__ import annotations

import numpy as np

from .pinhole import Floats

__all__ = ["CAMERA_SHIFT", "PROJECTOR_SHIFT", "Prior"]

CAMERA_SHIFT, PROJECTOR_SHIFT = 0.05, 0.5  # principal point off the centre, in image widths: projectors shift theirs
SQUARE = 0.01  # camera pixels are square to this
LENS = 8  # fx fy cx cy k1 k2 p1 p2


class Prior:
    """Weak beliefs about lenses, in standard deviations; the first one is the camera, or a device on its own.

    `still` are the places in the vector of distances that nothing tells, because a lens is affine: they are held at 0,
    which costs nothing, since everything else can follow. So can the centre of an affine lens without distortion.
    """

    def __init__(
        self,
        lenses: tuple[Floats, ...],
        sizes: tuple[tuple[int, int], ...],
        shifts: tuple[float, ...],
        still: tuple[int, ...] = (),
    ):
        aims, spreads = [], []
        for lens, size, loose in zip(lenses, sizes, shifts, strict=True):
            aims.append([(size[0] - 1) / 2, (size[1] - 1) / 2, 0, 0, 0, 0])
            r = np.hypot(size[0] / 2 / abs(lens[0]), size[1] / 2 / abs(lens[1]))
            spreads.append([loose * size[0], loose * size[1], 0.03 / r**2, 0.005 / r**4, 0.003 / r, 0.003 / r])
        self.aim, self.spread = np.array(aims, dtype=np.float64), np.array(spreads)
        self.square = shifts[0] <= CAMERA_SHIFT  # a camera's pixels are square
        self.still = list(still)
        self.reach = 0.01 * float(np.hypot(sizes[0][0] / lenses[0][0], sizes[0][1] / lenses[0][1]))  # mm, if affine

    def residuals(self, vector: Floats) -> Floats:
        """Give the beliefs' residuals at this vector."""
        count = len(self.aim)
        lenses = vector[: count * LENS].reshape(count, LENS)
        parts = ((lenses[:, 2:] - self.aim) / self.spread).ravel()
        if self.square:
            parts = np.append(parts, np.log(abs(vector[0] / vector[1])) / SQUARE)
        return np.append(parts, vector[self.still] / self.reach) if self.still else parts

    def jacobian(self, vector: Floats) -> Floats:
        """Derivatives (residual, parameter) of the residuals."""
        count = len(self.aim)
        J = np.zeros((6 * count + self.square + len(self.still), len(vector)))
        for n in range(count):
            J[np.arange(6) + 6 * n, np.arange(6) + n * LENS + 2] = 1 / self.spread[n]
        if self.square:
            J[6 * count, 0], J[6 * count, 1] = 1 / vector[0] / SQUARE, -1 / vector[1] / SQUARE
        for n, place in enumerate(self.still):
            J[6 * count + self.square + n, place] = 1 / self.reach
        return J

"""Compiled second passes of decoding: the phase inside an order cell, and pixels that their neighbours contradict."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["unwrap_phase"]

F32 = npt.NDArray[np.float32]
Stack = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
JUMP = 0.375
"""Farthest from the middle of its order cell that a phase may lie, periods: half a cell and as much again in doubt."""


@numba.njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def unwrap_phase(
    stack: Stack, frames: npt.NDArray[np.int64], period: float, length: int, noise: float, out: F32, sigma: F32
) -> None:
    """Replace order cells by the phase within them.

    The phase is that of the least-squares sinusoid through the steps (Bruning et al. 1974), its standard uncertainty
    sqrt(2 / steps) noise / amplitude. An order cell is half a period: the period is the one that brings the phase
    nearest to the cell, so a cell read one too high or low at its own edge does no harm.

    Parameters
    ----------
    stack : ndarray, shape (frame, pixel)
    frames : ndarray of int64, shape (steps,)
    period : float
        px.
    length : int
        Projector pixels of the axis.
    noise : float
        Standard deviation of a pixel's value, counts.
    out, sigma : ndarray of float32, shape (pixel,)
        In: the middle of the order cell, NaN where not decoded. Out: projector px and standard uncertainty.
    """
    steps = frames.size
    angle = 2 * np.pi / steps
    cosine = np.cos(angle * np.arange(steps))
    sine = np.sin(angle * np.arange(steps))
    full = np.iinfo(stack.dtype).max
    for i in range(out.size):
        if not np.isfinite(out[i]):
            continue
        real, imaginary = 0.0, 0.0
        saturated = False
        for step in range(steps):
            value = stack[frames[step], i]
            saturated |= value == full
            real += value * cosine[step]
            imaginary += value * sine[step]
        amplitude = 2 / steps * np.sqrt(real * real + imaginary * imaginary)
        error = np.sqrt(2 / steps) * noise / max(amplitude, 1e-9)
        share = np.arctan2(imaginary, real) / (2 * np.pi)
        coarse = (out[i] + 0.5) / period
        fine = share + np.rint(coarse - share)
        place = period * fine - 0.5
        # beyond a third of a radian the noise can carry a phase into the next period
        bad = saturated or error > 0.33 or abs(fine - coarse) > JUMP or place < -0.5 or place > length - 0.5
        out[i] = np.nan if bad else place
        sigma[i] = np.nan if bad else period * error / (2 * np.pi)

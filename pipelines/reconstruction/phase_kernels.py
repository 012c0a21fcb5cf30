"""Compiled loop of phase shifting: phase of a pixel from its steps, period from its order bits."""

from __future__ import annotations

import numba as nb
import numpy as np

__all__ = ["locate_phases"]

JUMP = 0.375
"""Farthest from the middle of its order cell that a phase may lie, periods: half a cell and as much again in doubt."""
WORST_RAD = 0.17
"""Largest standard uncertainty: six of them are the third of a half turn that may lie between a phase and its cell."""
MISS = 0.7
"""Farthest that the swing of an order bit may lie from what it is at the place found; noise comes on top."""
FAINT, STRAY = 0.45, 0.3
"""Least amplitude, of that of the whole capture, and farthest mean from its mean, of white minus black: where a pixel
sees two surfaces, their sinusoids cancel."""
TURNS = 4


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _solve(values, known, cosine, sine):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Least-squares sinusoid through the known steps: mean, real, imaginary, and variance of the phase for noise 1.

    The variance is that at amplitude 1.
    """
    n = 0.0
    c, s, cc, ss, cs, y, yc, ys = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(values.size):
        if known[k]:
            n += 1
            c += cosine[k]
            s += sine[k]
            cc += cosine[k] * cosine[k]
            ss += sine[k] * sine[k]
            cs += cosine[k] * sine[k]
            y += values[k]
            yc += values[k] * cosine[k]
            ys += values[k] * sine[k]
    cc -= c * c / n
    ss -= s * s / n
    cs -= c * s / n
    yc -= y * c / n
    ys -= y * s / n
    det = cc * ss - cs * cs
    real, imaginary = (yc * ss - ys * cs) / det, (ys * cc - yc * cs) / det
    power = max(real * real + imaginary * imaginary, 1e-12)
    # along the circle (-imaginary, real): how the phase moves
    spread = (imaginary * imaginary * ss + 2 * imaginary * real * cs + real * real * cc) / (det * power)
    return (y - c * real - s * imaginary) / n, real, imaginary, spread


@nb.njit(cache=True, nogil=True, error_model="numpy")
def locate_phases(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    stack,
    white,
    black,
    plus,
    minus,
    steps,
    power,
    drift,
    harmonics,
    straight,
    slack,
    expected,
    period,
    lit,
    noise,
    rows,
    place,
    sigma,
):
    """Find where on the projector each pixel of some rows looks.

    Parameters
    ----------
    stack : ndarray, shape (frame, row, column)
    plus, minus, steps : ndarray of int64, shape (bits,), (bits,) and (steps,)
        Frames of the order bits, coarsest first, of their inverses (-1: none), and of the phase steps.
    power, drift : ndarray of float64, shape (steps,)
        Light of each step, of the mean; what came on top, of white minus black.
    harmonics : ndarray of float64, shape (n,)
        Mean, amplitude and overtones of the sinusoid as the camera sees it, of white minus black.
    straight : ndarray of float64, shape (n + 1,)
        True share of the period by the share that all steps together say, from 0 to 1; without the ripple of the
        overtones.
    slack : float
        Standard uncertainty of `straight`, and of what flicker left, periods.
    expected : ndarray of float32, shape (px, bits)
        Swing of the order bits, -1 to 1.
    period : float
        px.
    lit, noise : float
        Least white minus black, standard deviation of a pixel's value, counts.
    rows : (int, int)
        First, last.
    place, sigma : ndarray of float32, shape (row, column)
        Filled; NaN where not found.
    """
    W = stack.shape[2]
    full = np.iinfo(stack.dtype).max
    length, bits = expected.shape
    count = steps.size
    angle = 2 * np.pi * np.arange(count) / count
    cosine, sine = np.cos(angle), np.sin(angle)
    values, bare, known = np.empty(count), np.empty(count), np.ones(count, np.bool_)
    swings = np.empty(bits)
    nan = np.float32(np.nan)
    whole = 2.0 / count
    for i in range(rows[0], rows[1]):
        for j in range(W):
            place[i, j], sigma[i, j] = nan, nan
            w, k = float(stack[white, i, j]), float(stack[black, i, j])
            light = w - k
            if light < lit:
                continue
            number, last = 0, 0
            for bit in range(bits):
                p = float(stack[plus[bit], i, j])
                q = float(stack[minus[bit], i, j]) if minus[bit] >= 0 else w + k - p
                swings[bit] = (p - q) / light
                last ^= p > q
                number = (number << 1) | last
            good = 0
            real, imaginary, mean = 0.0, 0.0, 0.0
            for step in range(count):
                value = stack[steps[step], i, j]
                known[step] = value < full
                good += known[step]
                lamp = (value - k - drift[step] * light) / power[step]
                values[step] = lamp
                real += lamp * cosine[step]
                imaginary += lamp * sine[step]
                mean += lamp
            if good < 3:
                continue
            if good == count:
                real *= whole
                imaginary *= whole
                mean /= count
                spread = whole
                share = np.arctan2(imaginary, real) / (2 * np.pi)
                amplitude = np.sqrt(real * real + imaginary * imaginary)
                t = (share - np.floor(share)) * (straight.size - 1)
                n = min(int(t), straight.size - 2)
                stretch = (straight[n + 1] - straight[n]) * (straight.size - 1)
                share = straight[n] + (t - n) * (straight[n + 1] - straight[n])
                doubt = slack
            else:  # without some steps the overtones do not cancel: take them off, as the phase found so far says
                mean, real, imaginary, spread = _solve(values, known, cosine, sine)
                for _ in range(TURNS):
                    phase = np.arctan2(imaginary, real)
                    scale = np.sqrt(real * real + imaginary * imaginary) / harmonics[1]
                    for step in range(count):
                        over = 0.0
                        for h in range(2, harmonics.size):
                            over += harmonics[h] * np.cos(h * (phase - angle[step]))
                        bare[step] = values[step] - scale * over
                    mean, real, imaginary, spread = _solve(bare, known, cosine, sine)
                share = np.arctan2(imaginary, real) / (2 * np.pi)
                amplitude = np.sqrt(real * real + imaginary * imaginary)
                doubt, stretch = 3 * slack, 1.0
            error = stretch * np.sqrt(spread) * noise / max(amplitude, 1e-9)
            if error > WORST_RAD:
                continue
            if stack[white, i, j] < full and (
                amplitude < FAINT * harmonics[1] * light or abs(mean - harmonics[0] * light) > STRAY * light
            ):
                continue
            coarse = (number + 0.5) / 2  # periods
            fine = share + np.rint(coarse - share)
            x = period * fine - 0.5
            if abs(fine - coarse) > JUMP or x < -0.5 or x > length - 0.5:
                continue
            n = min(max(int(np.rint(x)), 0), length - 1)
            worst = MISS + 4 * noise / light
            agree = True
            for bit in range(bits):
                agree &= abs(swings[bit] - expected[n, bit]) < worst
            if not agree:
                continue
            error /= 2 * np.pi
            place[i, j] = x
            sigma[i, j] = period * np.sqrt(error * error + doubt * doubt)

"""Where an edge of stripes lies between two pixels, and how sure: of a single edge, and among narrow stripes."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

__all__ = ["edge_between"]

# A Gaussian edge's swing, as a share of full swing, to the distance from the edge: x (1 - P x2) / (1 - Q x2) is the
# inverse error function to 2 % up to CLEAR, least squares. Nearer to full swing noise decides.
P, Q, CLEAR = 0.483, 0.721, 0.95
# Square of what a straight line and a Gaussian edge differ by: the true profile lies anywhere between, and we take the
# Gaussian end: uniform over [0, d] about 0 has a mean square of d2 / 3.
UNSURE = 1 / 3
# Stripes so narrow are no single edges: their neighbours reach into them. Two harmonics are left of such a wave: the
# third has THIRD (LEFT amplitude)^9, whatever the blur, by the Fourier series of a square wave and the Gaussian.
THIRD, LEFT = 4 / (3 * math.pi), math.pi / 4
EDGE_BELOW, EDGE_FROM = 0.93, 1.08  # amplitudes, of full swing, between which a wave passes into single edges
OFF_PITCH = 0.2  # twice the share by which the pitch of the stripes may be off, as it changes with the slope


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def edge_between(a, b, full_a, full_b, noise, per_turn, tangent):  # type: ignore[no-untyped-def]  # numba infers
    """Where an edge lies between two pixels of opposite swings, 0 to 1, and its variance, px squared.

    An edge that a lens has blurred is an error function of the distance. A straight line between two pixels misses it
    by up to a tenth of a pixel where it is sharp, its inverse (`P`, `Q`) does not, whatever the blur; and measured by
    each pixel's own full swing an edge lies right where the surface is darker on one side. Noise of both swings, and of
    both full swings, moves it by the slope of that inverse: most where one pixel has nearly its full swing, least in
    the middle of a wide edge.
    """
    one, p, q = np.float32(1), np.float32(P), np.float32(Q)
    least = np.float32(1 / CLEAR)
    full_a, full_b = max(full_a, abs(a) * least), max(full_b, abs(b) * least)
    whole = one / (full_a * full_b)
    per_a, per_b = whole * full_b, whole * full_a
    low, high = a * per_a, b * per_b
    a2, b2 = low * low, high * high
    under_a, under_b = one - q * a2, one - q * b2
    over = one / (under_a * under_b)
    over_a, over_b = over * under_b, over * under_a
    u, v = low * (one - p * a2) * over_a, high * (one - p * b2) * over_b  # distances, in widths of the blur
    share = one / ((u - v) * (low - high))
    part, scale, off = u * (low - high) * share, (low - high) * share, (v * low - u * high) * share
    bend = q - np.float32(3) * p
    slope_a = (one - part) * per_a * over_a * over_a * (one + a2 * (bend + p * q * a2))
    slope_b = part * per_b * over_b * over_b * (one + b2 * (bend + p * q * b2))
    moved = slope_a * slope_a * (one + a2) + slope_b * slope_b * (one + b2)
    sum_, apart = low + high, low - high
    square = tangent * tangent
    # amplitude of the wave, squared: cos = (1 - tan2) / (1 + tan2), sin2 = 4 tan2 / (1 + tan2)2, of half the angle;
    # swings have opposite signs
    amplitude2 = (one + square) * (apart * apart + square * sum_ * sum_)
    if amplitude2 >= np.float32(4 * EDGE_FROM**2) * square:
        return part, noise * scale * scale * moved + off * off * np.float32(UNSURE)
    amplitude2 /= np.float32(4) * square
    return _on_wave(
        low, high, per_a, per_b, part, off, noise, noise * scale * scale * moved, per_turn, tangent, amplitude2
    )


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _on_wave(low, high, per_a, per_b, single, off, noise, moved, per_turn, tangent, amplitude2):  # type: ignore[no-untyped-def]  # numba infers
    """The same among narrow stripes, from what it is for a `single` edge.

    Two samples of a sine that are an angle `turn` apart say where it crosses zero, whatever its amplitude: with
    z = (a + b) / (a - b), at 1/2 + atan(tan(turn / 2) z) / turn. The overtone is taken off first: of an amplitude A it
    leaves ``THIRD LEFT^9 A^8 s (3 - 4 s^2 / A^2)`` in a swing s.
    """
    one, two, three, four, half = np.float32(1), np.float32(2), np.float32(3), np.float32(4), np.float32(0.5)
    square, per_apart = tangent * tangent, one / (low - high)
    share = np.float32(1 / (EDGE_FROM - EDGE_BELOW)) * (np.sqrt(amplitude2) - np.float32(EDGE_BELOW))
    share = max(share, np.float32(0))
    third = np.float32(THIRD * LEFT**9) * amplitude2 * amplitude2 * amplitude2
    low_ = low - third * low * (three * amplitude2 - four * low * low)
    high_ = high - third * high * (three * amplitude2 - four * high * high)
    z = (low_ + high_) / (low_ - high_)
    place = half + _arc(tangent * z) * per_turn
    climb = tangent * per_turn / (one + square * z * z)
    slope = two * climb * per_apart * per_apart
    slope_a, slope_b = slope * high * per_a, slope * low * per_b
    own = noise * (slope_a * slope_a * (one + low * low) + slope_b * slope_b * (one + high * high))
    overtone, straight = climb * (z - (low + high) * per_apart), low * per_apart
    doubt = share * off + (one - share) * (overtone + np.float32(OFF_PITCH) * (place - straight))
    at = single + (one - share) * (place - single)
    return at, share * moved + (one - share) * own + doubt * doubt * np.float32(UNSURE)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _arc(y):  # type: ignore[no-untyped-def]  # numba infers
    """Arc tangent to 1e-5 (Abramowitz and Stegun 4.4.49): a library's differs from device to device."""
    one = np.float32(1)
    beyond = abs(y) > one
    x = one / y if beyond else y
    q = x * x
    part = np.float32(-0.0851330) + q * np.float32(0.0208351)
    part = np.float32(0.9998660) + q * (np.float32(-0.3302995) + q * (np.float32(0.1801410) + q * part))
    part *= x
    quarter = np.float32(0.5 * math.pi)
    return (quarter if y > 0 else -quarter) - part if beyond else part

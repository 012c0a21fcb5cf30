"""Compiled loops of the clean-up, over a band of image rows: pixels on no surface, and pixels with too few neighbours.

A band is `planes`, float32 (4, row, column): x, y, z and sigma, NaN where not measured. Both loops first pass the many
pixels that a few comparisons prove good, in a form that the compiler turns into vector instructions, and then look at
the rest one by one.
"""

from __future__ import annotations

import numba as nb
import numpy as np

__all__ = ["drop_mixed", "keep_dense", "take_points"]

NEIGHBOURS = 6  # of the 24 around a pixel must lie on its surface
SLOPE = np.float32(3)  # neighbours on one surface differ by less than this many times their distance
SUPPORT = 2  # of the eight directions must lead on to a point
STANDARD = np.float32(4)  # standard uncertainties that two points of one surface may differ by
BEND = np.float32(1)  # and as much as a slope of so much that begins between them


@nb.njit(cache=True, nogil=True)
def take_points(xyz, sigma_z, planes):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Put a band of a `PointMap` into planes."""
    for i in range(len(xyz)):
        for j in range(xyz.shape[1]):
            planes[0, i, j], planes[1, i, j], planes[2, i, j] = xyz[i, j, 0], xyz[i, j, 1], xyz[i, j, 2]
            planes[3, i, j] = sigma_z[i, j]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def drop_mixed(planes, doubt, first, last):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Set to NaN the points of rows `first` to `last` that fewer than `SUPPORT` directions lead on to.

    `doubt`, (row, column) of uint8, is 1 afterwards where a point was dropped.
    """
    x, y, z, s = planes[0], planes[1], planes[2], planes[3]
    W = z.shape[1]
    for i in range(first, last):
        _doubt_line(z[i], s[i], doubt[i])
        for j in range(W):
            if doubt[i, j]:
                doubt[i, j] = s[i, j] > 0 and _on_no_surface(x, y, z, s, i, j)
    nan = np.float32(np.nan)
    for i in range(first, last):
        for j in range(W):
            if doubt[i, j]:
                z[i, j], s[i, j] = nan, nan


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _doubt_line(z, s, doubt):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Clear `doubt` where left and right lead on within sigma alone: part of what `_leads_on` allows, and no root."""
    W = z.size
    doubt[:2], doubt[W - 2 :] = 1, 1
    z1, z2, z3, z4, z5 = z[: W - 4], z[1 : W - 3], z[2 : W - 2], z[3 : W - 1], z[4:]
    s1, s2, s4, s5, out = s[: W - 4], s[1 : W - 3], s[3 : W - 1], s[4:], doubt[2 : W - 2]
    two = np.float32(2)
    for j in range(W - 4):
        good = abs(z3[j] - two * z2[j] + z1[j]) <= two * STANDARD * s2[j]
        good &= abs(z2[j] - z1[j]) <= STANDARD * (s2[j] + s1[j])
        good &= abs(z3[j] - two * z4[j] + z5[j]) <= two * STANDARD * s4[j]
        good &= abs(z4[j] - z5[j]) <= STANDARD * (s4[j] + s5[j])
        out[j] = not good  # not for NaN


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _on_no_surface(x, y, z, s, i, j):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    H, W = z.shape
    found = 0
    for a, b in ((0, -1), (0, 1), (-1, 0), (1, 0), (-1, -1), (1, 1), (-1, 1), (1, -1)):
        if 0 <= i + 2 * a < H and 0 <= j + 2 * b < W and _leads_on(x, y, z, s, i, j, a, b):
            found += 1
            if found == SUPPORT:
                return False
    return True


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _leads_on(x, y, z, s, i, j, a, b):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Whether pixels (i + 2a, j + 2b) and (i + a, j + b) lead on to (i, j)."""
    z0, z1, z2 = z[i, j], z[i + a, j + b], z[i + 2 * a, j + 2 * b]
    s0, s1, s2 = s[i, j], s[i + a, j + b], s[i + 2 * a, j + 2 * b]
    dx, dy = x[i + a, j + b] - x[i, j], y[i + a, j + b] - y[i, j]
    off, bend = abs(z0 - 2 * z1 + z2), BEND * np.sqrt(dx * dx + dy * dy)
    if not off <= bend + STANDARD * (s0 + 2 * s1 + s2):  # NaN is not; cheaper than the root below, and never less
        return False
    if not abs(z1 - z2) <= SLOPE * bend / BEND + STANDARD * (s1 + s2):
        return False
    return off <= bend + STANDARD * np.sqrt(s0 * s0 + 4 * s1 * s1 + s2 * s2)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def keep_dense(planes, worst, keep, first, last):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Tell which points of rows `first` to `last` are no worse than `worst` and not alone on their surface."""
    x, y, z, s = planes[0], planes[1], planes[2], planes[3]
    H, W = z.shape
    limit = np.float32(worst)
    for i in range(first, last):
        for j in range(W):
            keep[i, j] = False
        if 0 < i < H - 1:
            _keep_line(z[i - 1], z[i], z[i + 1], s[i - 1], s[i], s[i + 1], limit, keep[i])
        for j in range(W):
            if not keep[i, j] and s[i, j] <= limit:  # false for NaN
                keep[i, j] = _near(x, y, z, s, i, j) > NEIGHBOURS


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _keep_line(z0, z1, z2, s0, s1, s2, limit, keep):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Keep those that enough of the eight next neighbours agree with within sigma."""
    for j in range(1, z1.size - 1):
        z, s = z1[j], s1[j]
        near = 1
        near += abs(z0[j - 1] - z) <= STANDARD * (s + s0[j - 1])
        near += abs(z0[j] - z) <= STANDARD * (s + s0[j])
        near += abs(z0[j + 1] - z) <= STANDARD * (s + s0[j + 1])
        near += abs(z1[j - 1] - z) <= STANDARD * (s + s1[j - 1])
        near += abs(z1[j + 1] - z) <= STANDARD * (s + s1[j + 1])
        near += abs(z2[j - 1] - z) <= STANDARD * (s + s2[j - 1])
        near += abs(z2[j] - z) <= STANDARD * (s + s2[j])
        near += abs(z2[j + 1] - z) <= STANDARD * (s + s2[j + 1])
        keep[j] = (near > NEIGHBOURS) & (s <= limit)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _near(x, y, z, s, i, j):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """How many of 5x5 pixels lie on the surface of the one in the middle, itself included; it stops at enough."""
    H, W = z.shape
    near = 0
    for a in range(max(i - 2, 0), min(i + 3, H)):
        for b in range(max(j - 2, 0), min(j + 3, W)):
            dx, dy, dz = x[a, b] - x[i, j], y[a, b] - y[i, j], abs(z[a, b] - z[i, j])
            more = dz - STANDARD * (s[i, j] + s[a, b])
            if more <= 0 or more * more <= SLOPE * SLOPE * (dx * dx + dy * dy):  # false for NaN
                near += 1
        if near > NEIGHBOURS:
            break
    return near

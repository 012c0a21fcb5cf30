"""Compiled loops of M3C2 on a raster: sums over balls and cylinders for whole runs of cores, SIMD over the cores."""

from __future__ import annotations

import numba as nb
import numpy as np

__all__ = ["cylinders", "medians", "normals"]

RUN = 32  # cores of one row that are worked on together; a literal, so that the compiler knows the sums apart
# Neighbours are read through slices: an index that might be below zero would keep the compiler from the wide registers.
MATHS = {"nsz", "arcp", "contract"}  # NaN must stay NaN: it is what "not measured" is


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=MATHS)
def normals(z, pad, pitch, radii, core, first, last, out):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Write unit normals (row, column, 3), up, of rows `first` to `last`: the smallest axis of the points in a ball.

    `z` (rows + 2 pad, columns + 2 pad) is padded with NaN. Of several radii the one with the greatest planarity counts,
    (middle - smallest) / greatest eigenvalue of the covariance, the first of equals.
    """
    columns = z.shape[1] - 2 * pad
    row = np.empty(6 * RUN)
    total = np.empty(10 * RUN)
    best = np.empty(RUN)
    middle = np.empty(RUN)
    normal = np.empty(3)
    for i in range(first, last):
        for start in range(0, columns, RUN):
            width = min(RUN, columns - start)
            any_core = False
            for b in range(width):
                any_core |= core[i, start + b]
                middle[b] = z[i + pad, start + pad + b]
                best[b] = -1.0
                out[i, start + b, 0] = out[i, start + b, 1] = out[i, start + b, 2] = np.nan
            if not any_core:
                continue
            for radius in radii:
                total[:] = 0.0
                reach = int(np.floor(radius / pitch))
                for dy in range(-reach, reach + 1):
                    y = dy * pitch
                    line = z[i + pad + dy]
                    row[:] = 0.0
                    at = start + pad
                    for dx in range(reach + 1):  # both sides at once: the sums are loaded and stored half as often
                        x = dx * pitch
                        room = radius * radius - x * x - y * y
                        if room <= 0:
                            break
                        if dx == 0:
                            for b in range(width):
                                d = line[at + b] - middle[b]
                                inside = d * d < room  # false where it is NaN
                                d = d if inside else 0.0
                                row[b] += 1.0 if inside else 0.0
                                row[3 * RUN + b] += d
                                row[5 * RUN + b] += d * d
                            continue
                        one, two = line[at + dx : at + dx + width], line[at - dx : at - dx + width]
                        for b in range(width):
                            d, e = one[b] - middle[b], two[b] - middle[b]
                            right, left = d * d < room, e * e < room
                            m, k = 1.0 if right else 0.0, 1.0 if left else 0.0
                            d, e = d if right else 0.0, e if left else 0.0
                            row[b] += m + k
                            row[RUN + b] += x * (m - k)
                            row[2 * RUN + b] += x * x * (m + k)
                            row[3 * RUN + b] += d + e
                            row[4 * RUN + b] += x * (d - e)
                            row[5 * RUN + b] += d * d + e * e
                    for b in range(width):
                        total[b] += row[b]
                        total[RUN + b] += row[RUN + b]
                        total[2 * RUN + b] += y * row[b]
                        total[3 * RUN + b] += row[3 * RUN + b]
                        total[4 * RUN + b] += row[2 * RUN + b]
                        total[5 * RUN + b] += y * row[RUN + b]
                        total[6 * RUN + b] += row[4 * RUN + b]
                        total[7 * RUN + b] += y * y * row[b]
                        total[8 * RUN + b] += y * row[3 * RUN + b]
                        total[9 * RUN + b] += row[5 * RUN + b]
                for b in range(width):
                    n = total[b]
                    if not core[i, start + b] or n < 3:
                        continue
                    sx, sy, sz = total[RUN + b] / n, total[2 * RUN + b] / n, total[3 * RUN + b] / n
                    flat = _smallest_axis(
                        total[4 * RUN + b] / n - sx * sx,
                        total[5 * RUN + b] / n - sx * sy,
                        total[6 * RUN + b] / n - sx * sz,
                        total[7 * RUN + b] / n - sy * sy,
                        total[8 * RUN + b] / n - sy * sz,
                        total[9 * RUN + b] / n - sz * sz,
                        normal,
                    )
                    if flat > best[b]:
                        best[b] = flat
                        for k in range(3):
                            out[i, start + b, k] = normal[k]


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=MATHS)
def _smallest_axis(xx, xy, xz, yy, yz, zz, normal):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Eigenvector of the smallest eigenvalue of a symmetric matrix, up, into `normal`; gives its planarity.

    Eigenvalues by the trigonometric formula (Smith 1961), the vector as the largest cross product of rows of A - l I.
    """
    size = (xx + yy + zz) / 3
    if size <= 0:
        return -1.0
    a, b, c = (xx - size) / size, (yy - size) / size, (zz - size) / size
    d, e, f = xy / size, xz / size, yz / size
    p = np.sqrt((a * a + b * b + c * c + 2 * (d * d + e * e + f * f)) / 6)
    if p <= 0:
        return -1.0
    det = (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)) / (2 * p * p * p)
    angle = np.arccos(min(1.0, max(-1.0, det))) / 3
    high = 2 * p * np.cos(angle)
    low = 2 * p * np.cos(angle + 2 * np.pi / 3)
    mid = -high - low
    a, b, c = a - low, b - low, c - low
    x0, y0, z0 = d * f - e * b, e * d - a * f, a * b - d * d
    x1, y1, z1 = d * c - e * f, e * e - a * c, a * f - d * e
    x2, y2, z2 = b * c - f * f, f * e - d * c, d * f - b * e
    n0, n1, n2 = x0 * x0 + y0 * y0 + z0 * z0, x1 * x1 + y1 * y1 + z1 * z1, x2 * x2 + y2 * y2 + z2 * z2
    if n0 >= n1 and n0 >= n2:
        x, y, z, n = x0, y0, z0, n0
    elif n1 >= n2:
        x, y, z, n = x1, y1, z1, n1
    else:
        x, y, z, n = x2, y2, z2, n2
    if n <= 0:
        return -1.0
    n = np.sqrt(n)
    if z < 0:
        n = -n
    normal[0], normal[1], normal[2] = x / n, y / n, z / n
    return (mid - low) / (high + 1)


@nb.njit(cache=True, nogil=True, error_model="numpy", fastmath=MATHS)
def cylinders(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    z, pad, pitch, radius, half, core, other, shift, direction, first, last, count, mean, spread
):
    """Count, mean and standard deviation, along the normals, of `other`'s points in the cores' cylinders.

    `z` and `other` are padded with NaN, `other` by `shift[2:]` = (rows, columns), and lying `shift[:2]` = (y, x) mm,
    at most half a cell, beside the cores' raster.
    """
    columns = z.shape[1] - 2 * pad
    sums = np.empty(3 * RUN)
    n = np.zeros(4 * RUN)  # x, y, z of the normals, then a level near the mean that keeps the sums of squares exact
    middle = np.empty(RUN)
    fy, fx = shift[0], shift[1]
    py, px = int(shift[2]), int(shift[3])
    limit = radius * radius
    for i in range(first, last):
        for start in range(0, columns, RUN):
            width = min(RUN, columns - start)
            # the part of the raster that the cylinders reach over
            y_low, y_high, x_low, x_high = np.inf, -np.inf, np.inf, -np.inf
            for b in range(width):
                j = start + b
                middle[b] = z[i + pad, j + pad]
                a, c = direction[i, j, 0], direction[i, j, 1]
                n[b], n[RUN + b], n[2 * RUN + b] = a, c, direction[i, j, 2]
                level = direction[i, j, 2] * (other[i + py, j + px] - middle[b])
                n[3 * RUN + b] = level if abs(level) < half else 0.0
                if core[i, j] and a == a:
                    ex = abs(a) * half + radius * np.sqrt(max(0.0, 1 - a * a))
                    ey = abs(c) * half + radius * np.sqrt(max(0.0, 1 - c * c))
                    x_low, x_high = min(x_low, -ex), max(x_high, ex)
                    y_low, y_high = min(y_low, -ey), max(y_high, ey)
            sums[:] = 0.0
            if x_high >= x_low:
                top, bottom = int(np.ceil((y_low - fy) / pitch)), int(np.floor((y_high - fy) / pitch))
                left, right = int(np.ceil((x_low - fx) / pitch)), int(np.floor((x_high - fx) / pitch))
                top, bottom = max(top, -i - py), min(bottom, other.shape[0] - 1 - i - py)
                left, right = max(left, -start - px), min(right, other.shape[1] - width - start - px)
                for dy in range(top, bottom + 1):
                    y = dy * pitch + fy
                    line = other[i + py + dy]
                    at = start + px
                    for dx in range(left, right + 1, 2):  # two at once: the sums are loaded and stored half as often
                        x = dx * pitch + fx
                        u = x + pitch
                        flat, wide = x * x + y * y, u * u + y * y
                        one, two = line[at + dx : at + dx + width], line[at + dx + 1 : at + dx + 1 + width]
                        for b in range(width):
                            d, e = one[b] - middle[b], two[b] - middle[b]
                            across = n[RUN + b] * y
                            along = n[b] * x + across + n[2 * RUN + b] * d
                            other_along = n[b] * u + across + n[2 * RUN + b] * e
                            away = flat + d * d - along * along
                            other_away = wide + e * e - other_along * other_along
                            inside = (away < limit) & (abs(along) <= half)  # false where either is NaN
                            beside = (other_away < limit) & (abs(other_along) <= half)
                            along = along - n[3 * RUN + b] if inside else 0.0
                            other_along = other_along - n[3 * RUN + b] if beside else 0.0
                            sums[b] += (1.0 if inside else 0.0) + (1.0 if beside else 0.0)
                            sums[RUN + b] += along + other_along
                            sums[2 * RUN + b] += along * along + other_along * other_along
            for b in range(width):
                j = start + b
                k = sums[b] if core[i, j] else 0.0
                count[i, j] = int(k)
                mean[i, j], spread[i, j] = np.nan, np.nan
                if k > 0:
                    m = sums[RUN + b] / k
                    mean[i, j] = m + n[3 * RUN + b]
                    if k > 1:  # of a single point nothing is known of the spread
                        spread[i, j] = np.sqrt(max(0.0, sums[2 * RUN + b] - k * m * m) / (k - 1))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def medians(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    z, pad, pitch, radius, half, core, other, shift, direction, first, last, count, middle, spread
):
    """As `cylinders`, with the median and the interquartile range."""
    columns = z.shape[1] - 2 * pad
    fy, fx = shift[0], shift[1]
    py, px = int(shift[2]), int(shift[3])
    found = np.empty(4096)
    for i in range(first, last):
        for j in range(columns):
            count[i, j] = 0
            middle[i, j], spread[i, j] = np.nan, np.nan
            a, c, e = direction[i, j, 0], direction[i, j, 1], direction[i, j, 2]
            if not core[i, j] or a != a:
                continue
            ex = abs(a) * half + radius * np.sqrt(max(0.0, 1 - a * a))
            ey = abs(c) * half + radius * np.sqrt(max(0.0, 1 - c * c))
            top = max(int(np.ceil((-ey - fy) / pitch)), -i - py)
            bottom = min(int(np.floor((ey - fy) / pitch)), other.shape[0] - 1 - i - py)
            left = max(int(np.ceil((-ex - fx) / pitch)), -j - px)
            right = min(int(np.floor((ex - fx) / pitch)), other.shape[1] - 1 - j - px)
            k = 0
            if (bottom - top + 1) * (right - left + 1) > found.size:
                found = np.empty((bottom - top + 1) * (right - left + 1))
            for dy in range(top, bottom + 1):
                y = dy * pitch + fy
                for dx in range(left, right + 1):
                    x = dx * pitch + fx
                    d = other[i + py + dy, j + px + dx] - z[i + pad, j + pad]
                    along = a * x + c * y + e * d
                    if x * x + y * y + d * d - along * along < radius * radius and abs(along) <= half:
                        found[k] = along
                        k += 1
            if k == 0:
                continue
            ordered = np.sort(found[:k])
            count[i, j] = k
            middle[i, j] = _quantile(ordered, 2)
            if k > 1:
                spread[i, j] = _quantile(ordered, 3) - _quantile(ordered, 1)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _quantile(ordered, quarters):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Quarters of sorted values: the mean of the two at a step of their distribution (Hyndman and Fan 1996, type 2)."""
    at = quarters * ordered.size
    high = at // 4
    return 0.5 * (ordered[high - 1] + ordered[high]) if at % 4 == 0 else ordered[high]

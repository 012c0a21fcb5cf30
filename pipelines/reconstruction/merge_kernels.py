"""The compiled loop of merging: which views of a cell agree, and what they say together."""

from __future__ import annotations

import numba as nb
import numpy as np

from ..scan import LEVEL_NONE
from .grid_kernels import STEEPEST

__all__ = ["merge_block"]

AGREE = 4.0  # combined sigmas by which two views of one surface may differ
CLEARLY = 2.0  # of two surfaces with as many views, the one with the sigma this much smaller counts


@nb.njit(cache=True, nogil=True, error_model="numpy")
def merge_block(  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    height, sigma, texture, level, weight, pose, bow, kind, pitch, contested, out
):
    """Merge the views of a block of cells, (view, row, column), into the five arrays of `out`.

    `pose` (view, 2) is the standard uncertainty of where each view was placed, vertical and lateral; `bow` (view,) the
    part of sigma that all cells of one calibration share, `kind` (view,) which calibration that is.
    """
    out_height, out_sigma, out_texture, out_level, out_views = out
    K, rows, columns = height.shape
    seen, group = np.empty(K, np.int64), np.empty((K, K), np.bool_)
    own, step, w = np.empty(K), np.empty(K), np.empty(K)
    for i in range(rows):
        for j in range(columns):
            n = 0
            for k in range(K):
                h = height[k, i, j]
                if h != h:
                    continue
                steepest = 0.0
                for a, b in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                    if 0 <= i + a < rows and 0 <= j + b < columns:
                        change = abs(height[k, i + a, j + b] - h)
                        if change <= STEEPEST * pitch:  # false where it is NaN
                            steepest = max(steepest, change)
                s2 = sigma[k, i, j] * sigma[k, i, j]
                lateral = steepest / pitch * pose[k, 1]
                seen[n], step[n] = k, steepest
                own[n] = max(s2 - bow[k] * bow[k], 0.25 * s2) + pose[k, 0] * pose[k, 0] + lateral * lateral
                n += 1
            if n == 0:
                out_height[i, j], out_sigma[i, j] = np.nan, np.nan
                out_texture[i, j], out_level[i, j], out_views[i, j] = 0, LEVEL_NONE, 0
                continue
            best, best_count, tie = 0, 0, False
            for a in range(n):
                count = 0
                for b in range(n):
                    allowed = AGREE * np.sqrt(own[a] + own[b] + bow[seen[a]] ** 2 + bow[seen[b]] ** 2)
                    allowed += 0.5 * max(step[a], step[b])  # a surface that falls by a step within a cell
                    group[a, b] = abs(height[seen[a], i, j] - height[seen[b], i, j]) <= allowed
                    count += group[a, b]
                if count > best_count:
                    best, best_count, tie = a, count, False
                elif count == best_count and not group[best, a]:
                    tie = True
                    if own[a] * CLEARLY * CLEARLY < own[best]:
                        best = a
                    elif own[best] * CLEARLY * CLEARLY >= own[a] and height[seen[a], i, j] > height[seen[best], i, j]:
                        best = a  # about as good: the upper one, as in gridding
                elif count == best_count and own[a] < own[best]:
                    best = a
            total, mean, bright, worst = 0.0, 0.0, 0.0, np.uint8(0)
            for b in range(n):
                w[b] = 0.0
                if group[best, b]:
                    k = seen[b]
                    w[b] = max(weight[k, i, j], 1e-6) / own[b]
                    total += w[b]
                    mean += w[b] * height[k, i, j]
                    bright += w[b] * texture[k, i, j]
                    worst = max(worst, level[k, i, j])
            variance = 0.0
            for a in range(n):
                variance += w[a] * w[a] * own[a]
                for b in range(n):
                    if kind[seen[a]] == kind[seen[b]]:
                        variance += w[a] * w[b] * bow[seen[a]] * bow[seen[b]]
            out_height[i, j] = mean / total
            out_sigma[i, j] = np.sqrt(variance) / total
            out_texture[i, j] = np.uint8(bright / total + 0.5)
            out_level[i, j] = contested if tie else worst
            out_views[i, j] = best_count

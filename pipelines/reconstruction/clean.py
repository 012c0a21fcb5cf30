"""What does not belong to the surface: mixed pixels, uncertain and lone points, a background that stands apart."""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from .pixel_maps import PointMap
from .slabs import in_slabs

__all__ = ["background_border", "reject_mixed", "remove_lone"]

Mask = npt.NDArray[np.bool_]

NEIGHBOURS = 6  # of the 24 around a pixel must lie on its surface
SLOPE = np.float32(3)  # neighbours on one surface differ by less than this many times their distance
APART = 4.0  # two modes are well separated if the empty band between them is this many times their spreads
FAR = 0.25  # of the shorter side of the field of view; the paper's rig is sharp within 0.3 of it to either side
WIDE = 0.03  # a background is wider than this share of the image; a crack's floor is not
SAMPLES = 20_000
SUPPORT = 2  # of the eight directions must lead on to a point
STANDARD = np.float32(4)  # standard uncertainties that two points of one surface may differ by
BEND = np.float32(1)  # and as much as a slope of so much that begins between them


def reject_mixed(points: PointMap) -> Mask:
    """Tell which pixels lie on no surface that their neighbours show.

    Where a pixel sees two surfaces at once (the rim of a crack, the border of a shadow), patterns of both add up and
    decode to a place between them. No threshold of contrast tells such a pixel, but its neighbours do: going on
    straight from the two next pixels in one of the eight directions leads to any point of a surface, on its own side of
    an edge too, but not to a point between two surfaces.

    Returns
    -------
    ndarray of bool, shape (row, column)
        True where fewer than `SUPPORT` directions lead on to a measured point.
    """
    mixed = np.zeros(points.sigma_z.shape, np.bool_)
    in_slabs(len(mixed), lambda first, last: _mixed(points.xyz, points.sigma_z, mixed, first, last))
    return mixed


@nb.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _leads_on(xyz, sigma_z, i, j, a, b):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    """Whether pixels (i + 2a, j + 2b) and (i + a, j + b) lead on to (i, j)."""
    z0, z1, z2 = xyz[i, j, 2], xyz[i + a, j + b, 2], xyz[i + 2 * a, j + 2 * b, 2]
    s0, s1, s2 = sigma_z[i, j], sigma_z[i + a, j + b], sigma_z[i + 2 * a, j + 2 * b]
    dx, dy = xyz[i + a, j + b, 0] - xyz[i, j, 0], xyz[i + a, j + b, 1] - xyz[i, j, 1]
    off, bend = abs(z0 - 2 * z1 + z2), BEND * np.sqrt(dx * dx + dy * dy)
    if not off <= bend + STANDARD * (s0 + 2 * s1 + s2):  # NaN is not; cheaper than the root below, and never less
        return False
    if not abs(z1 - z2) <= SLOPE * bend / BEND + STANDARD * (s1 + s2):
        return False
    return off <= bend + STANDARD * np.sqrt(s0 * s0 + 4 * s1 * s1 + s2 * s2)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _mixed(xyz, sigma_z, mixed, first, last):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    H, W = sigma_z.shape
    around = ((0, -1), (0, 1), (-1, 0), (1, 0), (-1, -1), (1, 1), (-1, 1), (1, -1))
    for i in range(first, last):
        for j in range(W):
            if not sigma_z[i, j] > 0:
                continue
            found = 0
            for a, b in around:
                if 0 <= i + 2 * a < H and 0 <= j + 2 * b < W and _leads_on(xyz, sigma_z, i, j, a, b):
                    found += 1
                    if found == SUPPORT:
                        break
            mixed[i, j] = found < SUPPORT


def remove_lone(points: PointMap, worst: float = np.inf) -> Mask:
    """Tell which measured pixels have neighbours on the same surface.

    Parameters
    ----------
    points : PointMap
    worst : float
        Points with a larger sigma, mm, count as not measured.

    Returns
    -------
    ndarray of bool, shape (row, column)
        True where the point is kept.
    """
    keep = np.zeros(points.sigma_z.shape, np.bool_)
    in_slabs(len(keep), lambda first, last: _density(points.xyz, points.sigma_z, worst, keep, first, last))
    return keep


@nb.njit(cache=True, nogil=True)
def _density(xyz, sigma_z, worst, keep, first, last):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    H, W = sigma_z.shape
    for i in range(first, last):
        for j in range(W):
            s = sigma_z[i, j]
            if not s <= worst:  # false for NaN
                continue
            x, y, z = xyz[i, j, 0], xyz[i, j, 1], xyz[i, j, 2]
            near = 0
            for a in range(max(i - 2, 0), min(i + 3, H)):
                for b in range(max(j - 2, 0), min(j + 3, W)):
                    dx, dy, dz = xyz[a, b, 0] - x, xyz[a, b, 1] - y, abs(xyz[a, b, 2] - z)
                    more = dz - STANDARD * (s + sigma_z[a, b])
                    if more <= 0 or more * more <= SLOPE * SLOPE * (dx * dx + dy * dy):  # false for NaN
                        near += 1
                if near > NEIGHBOURS:  # itself included
                    break
            keep[i, j] = near > NEIGHBOURS


def background_border(points: PointMap, keep: Mask) -> float:
    """Find a background behind the object: K-means with two clusters of the distance, if there are two.

    The farther cluster is background only if (1) the two are well separated: the empty band between them is at least
    `APART` times wider than the clusters' own spreads; (2) it is far: the band is wider than `FAR` of the field of
    view, about the depth in which such a rig is sharp at all; and (3) it is wide: opened by `WIDE` of the image most of
    it remains. So a step stays, and what an object lies on, and a crack's floor, however deep.

    Parameters
    ----------
    points : PointMap
    keep : ndarray of bool, shape (row, column)
        Pixels that count.

    Returns
    -------
    float
        Depth beyond which a point shows the background, mm; infinite where there is none.
    """
    step = max(1, int(np.sqrt(keep.size / SAMPLES / 4)))
    some = keep[::step, ::step]
    x, y, depth = (points.xyz[::step, ::step, n][some] for n in range(3))
    if len(depth) < 100:
        return np.inf
    field = min(float(np.ptp(np.percentile(side, [2, 98]))) for side in (x, y))
    border = _two_modes(np.sort(depth.astype(np.float64)), FAR * field)
    if border is None:
        return np.inf
    return border if _is_wide(keep & (points.xyz[..., 2] > border)) else np.inf


def _two_modes(depth: npt.NDArray[np.float64], least: float) -> float | None:
    """Give the depth that separates two well separated modes of sorted depths, or None where there is one."""
    low, high = depth[int(0.02 * len(depth))], depth[int(0.98 * len(depth)) - 1]
    core = depth[(depth >= low) & (depth <= high)]
    if len(core) < 50 or np.diff(core).max() < least:
        return None  # a cheap necessary condition first: scikit-learn takes seconds to import
    from sklearn.cluster import KMeans

    labels = KMeans(n_clusters=2, n_init=1, init=np.array([[low], [high]])).fit_predict(core[:, None])
    near, far = core[labels == 0], core[labels == 1]
    if len(near) == 0 or len(far) == 0:
        return None
    gap = float(far.min() - near.max())
    if gap < least or gap < APART * max(float(near.std()), float(far.std())):
        return None
    return float(near.max() + gap / 2)


def _is_wide(mask: Mask) -> bool:
    from scipy.ndimage import distance_transform_edt

    step = max(1, min(mask.shape) // 256)
    coarse = np.pad(mask[::step, ::step], 1)  # padded: the image's edge is an edge
    radius = max(2.0, WIDE * max(coarse.shape))
    inside = distance_transform_edt(coarse) > radius
    opened = distance_transform_edt(~inside) <= radius
    return bool((opened & coarse).sum() > 0.5 * coarse.sum())

"""What does not belong to the surface: a background that stands apart (K-means), and lone points (density)."""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from .pixel_maps import PointMap

__all__ = ["background", "remove_lone"]

Mask = npt.NDArray[np.bool_]

NEIGHBOURS = 6  # of the 24 around a pixel must lie on its surface
SLOPE = 3.0  # neighbours on one surface differ by less than this many times their distance
APART = 4.0  # two modes are well separated if the empty band between them is this many times their spreads
FAR = 0.25  # of the shorter side of the field of view; the paper's rig is sharp within 0.3 of it to either side
WIDE = 0.03  # a background is wider than this share of the image; a crack's floor is not
SAMPLES = 20_000


def remove_lone(points: PointMap) -> Mask:
    """Tell which measured pixels have neighbours on the same surface.

    Returns
    -------
    ndarray of bool, shape (row, column)
        True where the point is kept.
    """
    keep = np.zeros(points.sigma_z.shape, np.bool_)
    _density(points.xyz, points.sigma_z, keep)
    return keep


@nb.njit(cache=True, nogil=True)
def _density(xyz, sigma_z, keep):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    H, W = sigma_z.shape
    for i in range(H):
        for j in range(W):
            z = xyz[i, j, 2]
            if not z > 0:
                continue
            x, y, s = xyz[i, j, 0], xyz[i, j, 1], sigma_z[i, j]
            near = 0
            for a in range(max(i - 2, 0), min(i + 3, H)):
                for b in range(max(j - 2, 0), min(j + 3, W)):
                    dx, dy, dz = xyz[a, b, 0] - x, xyz[a, b, 1] - y, abs(xyz[a, b, 2] - z)
                    allowed = SLOPE * np.sqrt(dx * dx + dy * dy) + 4 * (s + sigma_z[a, b])
                    if dz <= allowed:  # false for NaN
                        near += 1
            keep[i, j] = near > NEIGHBOURS  # itself included


def background(points: PointMap, keep: Mask) -> Mask:
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
    ndarray of bool, shape (row, column)
        True where a pixel shows the background.
    """
    none = np.zeros(keep.shape, np.bool_)
    depth = points.xyz[..., 2][keep]
    if len(depth) < 100:
        return none
    sample = np.sort(depth[:: max(1, len(depth) // SAMPLES)]).astype(np.float64)
    y, x = (points.xyz[..., n][keep][:: max(1, len(depth) // SAMPLES)] for n in (1, 0))
    field = min(float(np.ptp(np.percentile(side, [2, 98]))) for side in (x, y))
    border = _two_modes(sample, FAR * field)
    if border is None:
        return none
    behind = keep & (points.xyz[..., 2] > border)
    return behind if _is_wide(behind) else none


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

"""What does not belong to the surface: mixed pixels, and a background that stands apart."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..slabs import in_slabs
from .clean_kernels import drop_mixed, take_points
from .pixel_maps import PointMap

__all__ = ["background_border", "reject_mixed"]

Mask = npt.NDArray[np.bool_]

HALO = 2  # rows beside a pixel that the clean-up looks at
APART = 4.0  # two modes are well separated if the empty band between them is this many times their spreads
FAR = 0.25  # of the shorter side of the field of view; the paper's rig is sharp within 0.3 of it to either side
WIDE = 0.03  # a background is wider than this share of the image; a crack's floor is not
SAMPLES = 40_000
BAND = 64  # rows that are worked on at once


def reject_mixed(points: PointMap) -> Mask:
    """Tell which pixels lie on no surface that their neighbours show.

    Where a pixel sees two surfaces at once (the rim of a crack, the border of a shadow), patterns of both add up and
    decode to a place between them. No threshold of contrast tells such a pixel, but its neighbours do: going on
    straight from the two next pixels in one of the eight directions leads to any point of a surface, on its own side of
    an edge too, but not to a point between two surfaces.

    Returns
    -------
    ndarray of bool, shape (row, column)
        True where fewer than two directions lead on to a measured point.
    """
    columns = points.sigma_z.shape[1]
    mixed = np.zeros(points.sigma_z.shape, np.uint8)

    def slab(first: int, last: int) -> None:
        low, high = max(first - HALO, 0), min(last + HALO, len(mixed))
        planes = np.empty((4, high - low, columns), np.float32)
        take_points(points.xyz[low:high], points.sigma_z[low:high], planes)
        doubt = np.empty((high - low, columns), np.uint8)
        drop_mixed(planes, doubt, first - low, last - low)
        mixed[first:last] = doubt[first - low : last - low]

    in_slabs(len(mixed), slab, step=BAND)
    return mixed.view(np.bool_)


def background_border(some: npt.NDArray[np.float32]) -> float:
    """Find a background behind the object: K-means with two clusters of the distance, if there are two.

    The farther cluster is background only if (1) the two are well separated: the empty band between them is at least
    `APART` times wider than the clusters' own spreads; (2) it is far: the band is wider than `FAR` of the field of
    view, about the depth in which such a rig is sharp at all; and (3) it is wide: opened by `WIDE` of the image most of
    it remains. So a step stays, and what an object lies on, and a crack's floor, however deep.

    Parameters
    ----------
    some : ndarray of float32, shape (3, row, column)
        x, y, z of a raster of pixels, camera frame, mm; z NaN where a pixel does not count.

    Returns
    -------
    float
        Depth beyond which a point shows the background, mm; infinite where there is none.
    """
    step = max(1, int(np.sqrt(some[2].size / SAMPLES)))
    few = some[:, ::step, ::step]
    x, y, depth = few[:, np.isfinite(few[2])]
    if len(depth) < 100:
        return np.inf
    field = min(float(np.ptp(np.percentile(side, [2, 98]))) for side in (x, y))
    border = _two_modes(np.sort(depth.astype(np.float64)), FAR * field)
    if border is None:
        return np.inf
    return border if _is_wide(some[2] > border) else np.inf


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

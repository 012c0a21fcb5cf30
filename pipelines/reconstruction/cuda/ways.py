"""The whole ways on the card: frames to points, points to a height map, frames to a height map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt
from numba import cuda

from configs import DeviceUnavailable

from ...grid import Grid
from ...instant import Instant
from ...scan import Scan
from ..decode import decode
from ..frames import Frames
from ..height_doubt import doubt_mm, doubt_of_cells
from ..light import frame_of, read_light
from ..pixel_maps import Decoded, PointMap, Shared
from ..reconstruct import check_projector
from ..rig_model import Calibration
from ..shared_error import shared_mm2
from ..smooth_cells import reach_of, tell_smooth
from ..subpixel import RUNS
from ..surface import Samples, _usual, sharing, stripe_px, stripe_raster, stripe_samples
from ..triangulate_parallel import triangulate_parallel
from .card import SIMULATED, OnCard, empty, kernel, launch, up, up_quickly
from .filled import fill_cells
from .gray import decode_gray
from .laid import lay
from .place import Placed, bring, place
from .points import add_doubt, drop_mixed, planes_of, point_map, sight_of, triangulate

__all__ = ["reconstruct", "scan_frames", "to_scan"]


@contextmanager
def _told() -> Iterator[None]:
    """Tell an error of the driver in one line.

    Raises
    ------
    DeviceUnavailable
        The card has no room, is held by another program, or fell out.
    """
    failures: tuple[type[Exception], ...] = ()
    if not SIMULATED:
        from numba.cuda.cudadrv.driver import CudaAPIError
        from numba.cuda.cudadrv.error import CudaDriverError

        failures = CudaAPIError, CudaDriverError
    try:
        yield
    except failures as error:
        text = " ".join(str(error).split())
        raise DeviceUnavailable(
            f"the GPU cannot be used now: {text}: see with `nvidia-smi` whether another program holds it, "
            "or leave --device cuda out"
        ) from error


@_told()
def reconstruct(frames: Frames, calibration: Calibration) -> PointMap:
    """As `reconstruction.reconstruct`.

    Stripes and phase sets are decoded on the CPU, and rays of affine lenses are met there.

    Raises
    ------
    ValueError
        If the images or the patterns are not of the size that was calibrated.
    DeviceUnavailable
        The card has no room, is held by another program, or fell out.
    """
    check_projector(frames, calibration)
    placed = _placed(frames)
    if calibration.camera.parallel or calibration.projector.parallel:
        from ..clean import reject_mixed
        from ..reconstruct import without

        points = triangulate_parallel(_back(placed, frames), calibration)
        return without(points, reject_mixed(points))
    sight = sight_of(placed, calibration)
    planes = triangulate(placed, sight)
    add_doubt(planes[3], doubt_mm(calibration), 1.0)
    drop_mixed(planes)
    return point_map(planes, placed, sight, _texture(frames), shared_mm2(placed.shared, calibration))


@_told()
def to_scan(
    points: PointMap, calibration: Calibration, grid: Grid, time: Instant, *, remove_background: bool = True
) -> Scan:
    """As `reconstruction.to_scan`.

    Raises
    ------
    DeviceUnavailable
        The card has no room, is held by another program, or fell out.
    """
    some = stripe_samples(points.projector[..., 0], points.projector[..., 1])
    texture, level = up(points.texture), up(points.level)
    return _gridded(
        planes_of(points), texture, level, some, points.shared, calibration, grid, time,
        background=not remove_background,
    )  # fmt: skip


@_told()
def scan_frames(frames: Frames, calibration: Calibration, grid: Grid, *, remove_background: bool = True) -> Scan:
    """As `reconstruction.scan_frames`: only frames go to the card, and only the height map comes back.

    Raises
    ------
    ValueError
        If the images or the patterns are not of the size that was calibrated.
    DeviceUnavailable
        The card has no room, is held by another program, or fell out.
    """
    check_projector(frames, calibration)
    placed = _placed(frames)
    if calibration.camera.parallel or calibration.projector.parallel:
        planes = planes_of(triangulate_parallel(_back(placed, frames), calibration))
    else:
        planes = triangulate(placed, sight_of(placed, calibration))
        add_doubt(planes[3], doubt_mm(calibration), 1.0)
    drop_mixed(planes)
    some = _stripe_samples(placed.column, placed.row)
    texture = up(_texture(frames))
    return _gridded(
        planes, texture, placed.level, some, shared_mm2(placed.shared, calibration), calibration, grid, frames.time,
        background=not remove_background,
    )  # fmt: skip


def _placed(frames: Frames) -> Placed:
    light = read_light(frames, RUNS)
    if frames.patterns.kind != "gray":
        return bring(decode(frames, noise=light.noise))
    return place(frames, decode_gray(frames, up_quickly(frames.stack), light.noise), light)


def _gridded(
    planes: OnCard,
    texture: OnCard,
    level: OnCard,
    some: Sequence[Samples],
    shared: Shared,
    calibration: Calibration,
    grid: Grid,
    time: Instant,
    *,
    background: bool,
) -> Scan:
    laid = lay(planes, calibration, grid, background=background)
    usual, stripe = _usual(calibration, grid), stripe_px(some)
    filled = fill_cells(laid, texture, level, grid, usual, sharing(stripe, some, shared, calibration, usual))
    height, sigma, light, coarsest = (each.copy_to_host() for each in filled)
    tell_smooth(height, sigma, reach_of(stripe, usual))
    doubt_of_cells(sigma, grid, calibration)
    return Scan(grid, time, height, sigma, light, coarsest, calibration.id)


def _texture(frames: Frames) -> npt.NDArray[np.uint8]:
    white = frames.stack[frame_of(frames.patterns, "white")]
    return np.ascontiguousarray(white if white.itemsize == 1 else white >> 8, np.uint8)


def _back(placed: Placed, frames: Frames) -> Decoded:
    arrays = (placed.column, placed.row, placed.sigma_column, placed.sigma_row, placed.level)
    column, row, sigma_column, sigma_row, level = (each.copy_to_host() for each in arrays)
    texture = _texture(frames)
    # nobody asks for the contrast
    return Decoded(column, row, sigma_column, sigma_row, level, texture, texture, placed.shared)


def _stripe_samples(*places: OnCard) -> list[Samples]:
    """As `surface.stripe_samples`, picked on the card."""
    steps = stripe_raster(places[0].shape)
    count = [-(-(side - 1) // step) for side, step in zip(places[0].shape, steps, strict=True)]
    found = []
    for each in places:
        some = empty((3, *count), np.float32)
        launch(_beside, count[0] * count[1], each, *steps, some)
        here, aside, below = some.copy_to_host()
        found.append((here, aside, below))
    return found


@kernel
def _beside(place, rows, columns, some):  # type: ignore[no-untyped-def]  # a kernel: numba infers the types
    W = some.shape[2]
    for n in range(cuda.grid(1), some.shape[1] * W, cuda.gridsize(1)):
        i, j = n // W * rows, n % W * columns
        some[0, n // W, n % W] = place[i, j]
        some[1, n // W, n % W] = place[i, j + 1]
        some[2, n // W, n % W] = place[i + 1, j]

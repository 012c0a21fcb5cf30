"""What a reconstruction runs on: the CPU, or an NVIDIA GPU where there is one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from ..grid import Grid
from ..instant import Instant
from ..scan import Scan
from .frames import Frames
from .pixel_maps import PointMap
from .reconstruct import reconstruct
from .rig_model import Calibration
from .surface import scan_frames, to_scan

__all__ = ["Device", "DeviceName", "device"]

DeviceName = Literal["cpu", "cuda"]


class Reconstruct(Protocol):
    """`reconstruct.reconstruct`."""

    def __call__(self, frames: Frames, calibration: Calibration) -> PointMap: ...  # noqa: D102 - the class says it


class ToScan(Protocol):
    """`surface.to_scan`."""

    def __call__(  # noqa: D102 - the class says it
        self,
        points: PointMap,
        calibration: Calibration,
        grid: Grid,
        time: Instant,
        *,
        remove_background: bool = True,
    ) -> Scan: ...


class ScanFrames(Protocol):
    """`surface.scan_frames`."""

    def __call__(  # noqa: D102 - the class says it
        self, frames: Frames, calibration: Calibration, grid: Grid, *, remove_background: bool = True
    ) -> Scan: ...


@dataclass(frozen=True, slots=True)
class Device:
    """The three ways through a reconstruction, all on one device; every device gives the same numbers."""

    name: DeviceName
    reconstruct: Reconstruct
    to_scan: ToScan
    scan_frames: ScanFrames


def device(name: DeviceName) -> Device:
    """Give a device by its name.

    Raises
    ------
    ValueError
        If there is no such device on this machine, or what it needs is not installed; the message says which.
    """
    if name == "cpu":
        return Device(name, reconstruct, to_scan, scan_frames)
    from . import cuda  # numba's CUDA target is not installed everywhere, and is slow to import

    why = cuda.missing()
    if why:
        raise ValueError(f"there is no GPU to work on: {why}")
    return Device(name, cuda.reconstruct, cuda.to_scan, cuda.scan_frames)

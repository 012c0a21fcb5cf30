"""What a reconstruction runs on: the CPU, or an NVIDIA GPU where there is one."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Literal, Protocol

from ..grid import Grid
from ..instant import Instant
from ..scan import Scan
from .frames import Frames
from .pixel_maps import PointMap
from .reconstruct import reconstruct
from .rig_model import Calibration
from .surface import scan_frames, to_scan

__all__ = ["Device", "DeviceName", "device", "missing"]

DeviceName = Literal["cpu", "cuda"]


class Reconstruct(Protocol):
    """`reconstruct.reconstruct`."""

    def __call__(self, frames: Frames, calibration: Calibration) -> PointMap: ...


class ToScan(Protocol):
    """`surface.to_scan`."""

    def __call__(
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

    def __call__(
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
    why = missing()
    if why:
        raise ValueError(f"there is no GPU to work on: {why}")
    from . import cuda  # only here: not installed everywhere, and slow to import

    return Device(name, cuda.reconstruct, cuda.to_scan, cuda.scan_frames)


def missing() -> str:
    """Why there is no GPU to work on, and what to do; empty if there is one."""
    from numba import config, cuda

    if find_spec("numba_cuda") is None and not config.ENABLE_CUDASIM:
        return "the extra is not installed: pip install 'microrelief[cuda]'"
    if not cuda.is_available():
        return "no NVIDIA GPU with its driver is found on this machine (`nvidia-smi` lists what there is)"
    return ""

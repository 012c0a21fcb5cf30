"""``microrelief reconstruct``: one capture to a height map or a point map."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from configs import CaptureError, InputError
from pipelines import Calibration, Frames, PointMap, Scan
from pipelines import reconstruction as rec
from storage import read_capture, read_patterns

from ..outputs import check_out
from ..surfaces import measure_points

__all__ = ["read_calibration", "reconstruct"]

POINTS = ".npz"
MOST_CELLS_PER_PIXEL = 25


def reconstruct(
    capture: Path,
    *,
    calibration: Path,
    out: Annotated[Path, Parameter(name=["--out", "-o"])],
    patterns: Path | None = None,
    pitch_mm: float | None = None,
    keep_background: Annotated[bool, Parameter(negative="")] = False,
    local_integration: Annotated[bool, Parameter(negative="")] = False,
    device: rec.DeviceName = "cpu",
    force: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Turn one capture into a height map.

    An .npz holds what was measured per camera pixel, before any clean-up: `xyz` in mm in the camera's frame,
    `sigma_z`, `projector`, `level`. The other formats hold the height map on a grid of the site frame, without
    background and lone points. A capture that `microrelief run` would reject is refused by the same verdict.

    Parameters
    ----------
    capture
        The capture folder.
    calibration
        The calibration.json of the rig.
    out
        Where the result goes; its suffix says as what: .npz, .nc, .tif or .ply.
    patterns
        Pattern file, where the capture does not say what was projected.
    pitch_mm
        Side of a cell; by default about one camera pixel.
    keep_background
        Keep a background that stands well apart.
    local_integration
        Read pixels that are too faint by themselves from sums over 3x3 or 5x5 pixels; of Gray code, on the CPU.
    device
        What works it out: the CPU, or an NVIDIA GPU (`pip install 'microrelief[cuda]'`). Both give the same numbers.
    force
        Go on with a capture that would be refused, and say so.

    Example
    -------
    microrelief reconstruct captures/0001 --calibration calibration.json --out soil.nc
    """
    check_out(out, pitch_mm)
    if local_integration and device != "cpu":
        raise InputError(f"--local-integration: works on the CPU only; leave out --device {device}")
    on = _device(device)
    rig = read_calibration(calibration)
    frames = read_capture(capture, read_patterns(patterns) if patterns is not None else None)
    unfit = _judged(frames, capture, force=force)
    points = measure_points(capture, frames, rig, on, local_integration=local_integration)
    if unfit:
        raise CaptureError(unfit)
    print(_about_points(points))
    if out.suffix.lower() == POINTS:
        from storage import write_points

        write_points(points, out)
    else:
        from storage import write_height_map

        grid = rec.footprint_grid(rig, pitch_mm)
        pixels = points.level.size
        if grid.rows * grid.columns > MOST_CELLS_PER_PIXEL * pixels:
            raise InputError(
                f"--pitch-mm {pitch_mm:g}: makes {grid.columns}x{grid.rows} cells of {pixels} camera pixels: "
                f"most would be empty, leave it out (about {rec.footprint_grid(rig).pitch_mm:g} mm) or make it larger"
            )
        scan = on.to_scan(points, rig, grid, frames.time, remove_background=not keep_background)
        print(_about_scan(scan))
        write_height_map(scan, out)
    print(f"wrote {out}")


def _device(name: rec.DeviceName) -> rec.Device:
    try:
        return rec.device(name)
    except ValueError as error:
        raise InputError(f"--device {name}: {error}") from error


def _judged(frames: Frames, capture: Path, *, force: bool) -> str:
    """Say on standard error what is wrong with a capture; give the line that refuses it, or nothing."""
    found = rec.diagnose(frames)
    advice = [f"{finding.line}: {finding.advice}" for finding in found.findings]
    if found.verdict == "reject" and not force:
        return f"{capture}: {advice[0]} (--force reconstructs it all the same)"
    for line in advice:
        print(
            f"{capture}: {'reconstructed by force' if found.verdict == 'reject' else 'note'}: {line}", file=sys.stderr
        )
    return ""


def read_calibration(file: Path) -> Calibration:
    """Read a calibration file.

    Raises
    ------
    InputError
        If there is no such file, or it is no calibration.
    """
    try:
        text = file.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{file}: no such calibration file; `microrelief calibrate` makes one") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: cannot be read as a calibration: {error}") from None
    try:
        return Calibration.from_json(text)
    except ValueError as error:
        raise InputError(f"{file}: {error}") from None


def _about_points(points: PointMap) -> str:
    share = 100 * float(points.valid.mean())
    sigma = _length(float(np.nanmedian(points.sigma_z)))
    return f"measured {share:.1f} % of the camera's pixels, sigma_z {sigma} (median)"


def _about_scan(scan: Scan) -> str:
    rows, columns = scan.grid.shape
    low, high = np.nanpercentile(scan.height, [1, 99]) if np.isfinite(scan.height).any() else (np.nan, np.nan)
    return (
        f"height map of {columns}x{rows} cells of {_length(scan.grid.pitch_mm)}, {100 * scan.coverage:.1f} % measured, "
        f"heights {low:.3f} to {high:.3f} mm (1 to 99 %), sigma {_length(float(np.nanmedian(scan.sigma)))} (median)"
    )


def _length(mm: float) -> str:
    return f"{mm:.3g} mm" if mm >= 0.1 else f"{1000 * mm:.3g} um"

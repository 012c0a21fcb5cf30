"""``microrelief compare``: what changed between two height maps, and how surely."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter

from configs import InputError, MicroreliefError
from pipelines import Motion, Scan, with_uncertainty
from pipelines import change as ch
from storage import whole_file

from ..compared import read_compared, read_stable

__all__ = ["compare"]

NORMAL_CELLS, RADIUS_CELLS = 10.3, 5.3
"""Radii where none are given, in cells of BEFORE; no whole numbers, so that no point lies just on a border."""
LEAST_NORMAL_CELLS, LEAST_RADIUS_CELLS = 1.5, 1.0


def compare(
    before: str,
    after: str,
    *,
    out: Annotated[Path, Parameter(name=["--out", "-o"])],
    method: Literal["m3c2", "dod"] = "m3c2",
    normal_radius: Annotated[tuple[float, ...], Parameter(negative="")] = (),
    radius: float | None = None,
    max_distance: float | None = None,
    registration_error: float | None = None,
    statistic: Literal["mean", "median"] = "mean",
    register: Annotated[bool, Parameter(negative="")] = False,
    stable: Path | None = None,
) -> None:
    """Say what changed between two height maps, and how surely.

    M3C2 measures along the surface's local normal (Lague, Brodu and Leroux 2013) and is right on walls too; dod
    subtracts heights cell by cell. Every measured cell is a point (x = column * pitch, y = row * pitch). Lengths in mm.

    The .npz holds `distance`, `lod` (level of detection, 95 %), `n1`, `n2`, `spread1`, `spread2` in BEFORE's shape;
    distance is positive where AFTER lies along the normal that points up; `motion` (4x4) is what took AFTER onto
    BEFORE. Volumes are printed. Scans of one store take its noise model (`repeatability`) for dod's lod and volumes.

    Parameters
    ----------
    before
        Height map: .npz (`height`, `pitch_mm`), .nc or .tif; or a scan of a store: STORE@12, STORE@-1 (the newest),
        STORE@TIME (the nearest).
    after
        The later one, likewise.
    out
        Where the result goes, an .npz.
    method
        m3c2, or dod (difference of heights).
    normal_radius
        Radius of the ball that gives the normal, by default 10.3 cells; given several times, the most planar counts.
    radius
        Radius of the cylinder, by default 5.3 cells.
    max_distance
        Half of the cylinder's length; by default enough for the greatest change of height.
    registration_error
        What alignment leaves between the two; with --register what it says of itself, else 0.
    statistic
        mean, or median (with interquartile ranges) for surfaces with gross errors.
    register
        Align AFTER to BEFORE first; never done unasked.
    stable
        File of what holds still, for registering and for the volumes' uncertainty: a campaign, or a .json list of
        polygons [[[x, y], ...], ...] in mm. Without it those of BEFORE's campaign; without these --register finds them.

    Example
    -------
    microrelief compare monday.tif friday.tif --register --out change.npz
    microrelief compare site.icechunk@12 site.icechunk@34 --register --method dod --out change.npz
    """
    _check(out, registration_error)
    first, second = read_compared(before), read_compared(after)
    one, two = first.scan, _same_pitch(second.scan, first.scan)
    ground = first.stable if stable is None else read_stable(stable, one.grid)
    noise = first.noise if second.noise is not None else None
    known = 0.0 if registration_error is None else registration_error
    motion = replace(Motion.none(), sigma_z_mm=known)
    on_grid = ch.apply_motion(two, Motion.none(), one.grid)
    if register:
        found = ch.compare(on_grid, one, ground)
        if found.change.motion.verdict == "failed":
            raise MicroreliefError(f"{after}: cannot be registered to {before}: {found.change.motion.reason}")
        motion = found.change.motion
        if registration_error is not None:
            motion = replace(motion, sigma_z_mm=registration_error)
        held, two = found.stable, found.scan
        on_grid = two
        print(_about_motion(motion))
    else:
        held = _still(on_grid, one) if ground is None else ground
    change = ch.difference(on_grid, one, motion, noise)
    if not np.isfinite(change.dz).any():
        raise InputError(f"{after}: has no measured cell in common with {before}")
    if method == "dod":
        result = _dod(one, on_grid, change)
    else:
        lengths = _lengths(one, change.dz, normal_radius, radius, max_distance)
        result = _m3c2(one, two, lengths, motion.sigma_z_mm, statistic)
    for line in _about(result, method):
        print(line)
    region = np.ones(one.grid.shape, dtype=np.bool_) if ground is None else ~ground
    volumes = ch.volumes(change, region, held, noise)
    for name, each in (("gained", volumes.gained), ("lost", volumes.lost), ("net", volumes.net)):
        print(f"volume {name:<7}{with_uncertainty(each, 'mm3')}")
    if volumes.systematic_mm3 > 0:
        part = f"{volumes.systematic_mm3:.2g} mm3"
        print(f"of the net volume's uncertainty {part} is registration's, one error for all cells")
    if noise is not None:
        print(f"levels of detection and volumes rest on the store's noise model {noise.id}")
    share = f"{100 * volumes.covered:.1f} %"
    cells = "BEFORE's cells" if ground is None else "BEFORE's cells outside of the stable areas"
    print(f"volumes are sums of AFTER less BEFORE over the {share} of {cells} that both measured")
    with whole_file(out) as file, file.open("wb") as stream:
        grid = one.grid
        place: dict[str, Any] = {"pitch_mm": grid.pitch_mm, "x0_mm": grid.x0_mm, "y0_mm": grid.y0_mm}
        np.savez_compressed(stream, **place, motion=motion.matrix, **result)
    print(f"wrote {out}")


def _still(after: Scan, before: Scan) -> npt.NDArray[np.bool_]:
    """Cells that most likely did not change, for the errors' covariance; none where fewer than half agree."""
    dz = after.height - before.height
    agreed, share = ch.largest_consensus(dz, np.sqrt(after.sigma**2 + before.sigma**2))
    return agreed if share >= 0.5 else np.zeros(dz.shape, dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class _Lengths:
    """What M3C2 is told, mm."""

    normals: tuple[float, ...]
    radius: float
    most: float


def _check(out: Path, registration_error: float | None) -> None:
    if out.suffix.lower() != ".npz":
        raise InputError(f"--out {out}: a comparison is an .npz file")
    if not out.parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {out.parent}")
    if out.is_dir():
        raise InputError(f"--out {out}: is a folder, name a file")
    if registration_error is not None and not (np.isfinite(registration_error) and registration_error >= 0):
        raise InputError(f"--registration-error {registration_error:g}: must be 0 or a positive number of mm")


def _same_pitch(two: Scan, one: Scan) -> Scan:
    """AFTER with BEFORE's cells where its own are of another size."""
    if abs(two.grid.pitch_mm - one.grid.pitch_mm) <= 1e-6 * one.grid.pitch_mm:
        return two
    print(
        f"AFTER's cells of {two.grid.pitch_mm:g} mm are interpolated to BEFORE's of {one.grid.pitch_mm:g} mm: "
        "neighbours share their noise then"
    )
    return ch.apply_motion(two, Motion.none(), one.grid)


def _lengths(
    one: Scan,
    dz: npt.NDArray[np.float32],
    normal_radius: tuple[float, ...],
    radius: float | None,
    max_distance: float | None,
) -> _Lengths:
    pitch = one.grid.pitch_mm
    normals = normal_radius or (NORMAL_CELLS * pitch,)
    around = RADIUS_CELLS * pitch if radius is None else radius
    for option, least, values in (
        ("--normal-radius", LEAST_NORMAL_CELLS * pitch, normals),
        ("--radius", LEAST_RADIUS_CELLS * pitch, (around,)),
    ):
        for value in values:
            if not (np.isfinite(value) and value > least):
                raise InputError(f"{option} {value:g}: must be more than {least:g} mm, for cells of {pitch:g} mm")
    if max_distance is None:
        greatest = float(np.quantile(np.abs(dz[np.isfinite(dz)]), 0.999))
        max_distance = max(3 * around, 1.2 * greatest)
    if not (np.isfinite(max_distance) and max_distance > 0):
        raise InputError(f"--max-distance {max_distance:g}: must be a positive number of mm")
    return _Lengths(normals, around, max_distance)


def _m3c2(
    one: Scan, two: Scan, lengths: _Lengths, error: float, statistic: Literal["mean", "median"]
) -> dict[str, Any]:
    several = ", ".join(f"{each:.4g}" for each in lengths.normals)
    print(
        f"M3C2 ({statistic}): normal radius {several} mm, radius {lengths.radius:.4g} mm, "
        f"max distance {lengths.most:.4g} mm, registration error {error:.2g} mm"
    )
    found = ch.m3c2(
        one.height,
        two.height,
        one.grid.pitch_mm,
        normal_radii_mm=lengths.normals,
        radius_mm=lengths.radius,
        max_distance_mm=lengths.most,
        registration_error_mm=error,
        statistic=statistic,
        offset_mm=(two.grid.x0_mm - one.grid.x0_mm, two.grid.y0_mm - one.grid.y0_mm),
    )
    names = ("distance", "lod", "n1", "n2", "spread1", "spread2", "normal")
    return {name: getattr(found, name) for name in names}


def _dod(one: Scan, two: Scan, change: ch.Change) -> dict[str, Any]:
    """The difference of heights: one cell of each, its own sigma for the spread."""
    count = np.isfinite(change.dz).astype(np.int32)
    spreads = [np.where(count > 0, scan.sigma, np.nan).astype(np.float64) for scan in (one, two)]
    distance, lod = change.dz.astype(np.float64), change.lod.astype(np.float64)
    return {
        "distance": distance,
        "lod": lod,
        "n1": count,
        "n2": count,
        "spread1": spreads[0],
        "spread2": spreads[1],
    }


def _about_motion(motion: Motion) -> str:
    x, y, z = motion.shift_mm
    tilt = np.rad2deg(np.hypot(motion.matrix[2, 0], motion.matrix[2, 1]))
    turn = np.rad2deg(np.arctan2(motion.matrix[1, 0], motion.matrix[0, 0]))
    doubt = f"; {'doubtful: ' if motion.verdict == 'doubtful' else ''}{motion.reason}" if motion.reason else ""
    return (
        f"registered: AFTER moved by {x:+.6g}, {y:+.6g}, {z:+.6g} mm, tilted by {tilt:.3g} and turned by {turn:.3g} "
        f"deg, residual {motion.residual_mm:.3g} mm, +-{motion.sigma_xy_mm:.2g} mm sideways, "
        f"+-{motion.sigma_z_mm:.2g} mm up{doubt}"
    )


def _about(result: dict[str, Any], method: str) -> list[str]:
    distance, lod = result["distance"], result["lod"]
    known = np.isfinite(distance)
    if not known.any():
        return [f"{method}: no distance could be measured: the cylinders hold no point of AFTER, give --max-distance"]
    significant = float((np.abs(distance) > lod)[known].mean())
    low, middle, high = np.quantile(distance[known], (0.05, 0.5, 0.95))
    detect = float(np.nanmedian(lod)) if np.isfinite(lod).any() else float("nan")
    return [
        f"distance {low:+.4g} / {middle:+.4g} / {high:+.4g} mm (5 / 50 / 95 %) over {int(known.sum())} of "
        f"{distance.size} cells; level of detection {detect:.3g} mm (median), {100 * significant:.1f} % significant"
    ]

"""``microrelief mosaic``: tiles from a scanning stage to one height map of a large area."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter

from configs import InputError
from pipelines import Scan
from pipelines import reconstruction as rec
from storage import StageFile, read_patterns, read_stage

from ..laying import laid, united
from ..outputs import check_out
from ..progress import progress
from ..stage_axes import ORIENTATIONS
from ..stitching import LonelyTileError, Stitched, stitch
from ..surfaces import Surface, read_surfaces
from .reconstruct import read_calibration

__all__ = ["mosaic", "write_merged"]

STAGE_SIGMA_MM = 0.05


def mosaic(
    *tiles: Path,
    stage: Path,
    out: Annotated[Path, Parameter(name=["--out", "-o"])],
    calibration: Path | None = None,
    patterns: Path | None = None,
    pitch_mm: float | None = None,
) -> None:
    """Stitch the tiles of a scanning stage into one height map.

    Neighbouring tiles are registered where they overlap, from relief and texture; all positions are adjusted at once to
    what that found, beginning at the stage's coordinates. Tiles need an overlap of some 50 cells or more. Prints each
    tile's real position in the stage's own axes, and how well the tiles meet at each seam.

    The stage file says how far the stage had moved the sample at each tile, in mm: CSV with the header tile,x_mm,y_mm,
    or YAML such as `tiles: {a: [0, 0], b: [4.5, 0]}`. How the stage's axes lie against the image is found by itself;
    YAML may say it (`axes: [-x, y]`), and how far off the stage may be (`sigma_mm: 0.05`).

    Parameters
    ----------
    tiles
        Capture folders, files of `microrelief reconstruct`, or height maps (.npz, .nc, .tif).
    stage
        The stage file.
    out
        Where the height map goes: .npz, .nc, .tif or .ply.
    calibration
        The calibration.json of the rig; needed for captures and points, and for what all tiles' errors share.
    patterns
        Pattern file, where the captures do not say what was projected.
    pitch_mm
        Side of a cell, for captures and points; by default about one camera pixel.

    Example
    -------
    microrelief mosaic tile1 tile2 tile3 --stage stage.csv --calibration calibration.json --out area.tif
    """
    check_out(out, pitch_mm)
    if len(tiles) < 2:
        raise InputError("a mosaic needs two tiles or more")
    told = read_stage(stage)
    stage_mm = _positions(tiles, told, stage)
    rig = read_calibration(calibration) if calibration is not None else None
    pattern_set = read_patterns(patterns) if patterns is not None else None
    surfaces = read_surfaces(tiles, [rig] * len(tiles), pattern_set, pitch_mm)
    bow = surfaces[0].bow_mm
    scans = [surface.scan for surface in surfaces]
    try:
        with progress("registering neighbours") as step:
            sigma = told.sigma_mm or STAGE_SIGMA_MM
            found = stitch(scans, stage_mm, axes=told.axes, stage_sigma_mm=sigma, bow_mm=bow, step=step)
    except LonelyTileError as error:
        name = surfaces[error.number].name
        raise InputError(
            f"{name}: overlaps no other tile at the coordinates of {stage}: are they in mm and of this tile?"
        ) from None
    for line in _about_positions(surfaces, stage_mm, found):
        print(line)
    first, home = scans[0].grid, found.placement.position_mm[0]
    placed = laid(scans, found.placement, (first.x0_mm - float(home[0]), first.y0_mm - float(home[1])))
    for line in _about_seams(surfaces, placed):
        print(line)
    first = placed[0].grid
    whole = rec.covering_grid(placed, [np.eye(4)] * len(placed), first.pitch_mm, (first.x0_mm, first.y0_mm))
    write_merged(united(placed, found.placement, bow, whole), out)


def write_merged(merged: rec.Merged, out: Path) -> None:
    """Say what was merged, and write it."""
    from storage import write_height_map

    scan = merged.scan
    rows, columns = scan.grid.shape
    measured = merged.views > 0
    print(
        f"height map of {columns}x{rows} cells of {scan.grid.pitch_mm:g} mm, {100 * scan.coverage:.1f} % measured; of "
        f"these {100 * float((merged.views > 1).sum() / max(1, measured.sum())):.1f} % by several views, "
        f"{100 * float(merged.contested.sum() / max(1, measured.sum())):.2f} % contested (level "
        f"{rec.LEVEL_CONTESTED}); sigma {1000 * float(np.nanmedian(scan.sigma)):.3g} um (median)"
    )
    write_height_map(scan, out)
    print(f"wrote {out}")


def _positions(tiles: tuple[Path, ...], told: StageFile, stage: Path) -> npt.NDArray[np.float64]:
    rows = []
    for tile in tiles:
        position = told.position(tile)
        if position is None:
            known = ", ".join(list(told.tiles)[:5])
            raise InputError(f"{stage}: has no position of tile {tile.name or tile}; it names {known}")
        if position.turn_deg:
            raise InputError(f"{stage}: tile {tile.name} is turned: a mosaic's tiles are only shifted, use `merge`")
        rows.append((position.x_mm, position.y_mm, position.z_mm))
    return np.array(rows, dtype=np.float64)


def _about_positions(surfaces: list[Surface], stage_mm: npt.NDArray[np.float64], found: Stitched) -> list[str]:
    turn = ORIENTATIONS[found.axes]
    real = found.placement.position_mm.copy()
    real[:, :2] = real[:, :2] @ turn  # the inverse of a signed permutation is its transpose
    sigma = found.placement.sigma_mm.copy()
    sigma[:, :2] = sigma[:, :2] @ np.abs(turn)
    width = max(4, *(len(surface.name) for surface in surfaces))
    lines = [f"the stage's axes move the sample along {found.axes[0]} and {found.axes[1]} of the site frame"]
    lines.append(f"{'tile':<{width}}  real position x, y, z (mm)      off the command (um)      sigma (um)")
    for surface, place, command, spread in zip(surfaces, real, stage_mm, sigma, strict=True):
        x, y, z = place
        off, s = 1000 * (place - command), 1000 * spread
        lines.append(
            f"{surface.name:<{width}}  {x:9.4f} {y:9.4f} {z:8.4f}  "
            f"{off[0]:+7.1f} {off[1]:+7.1f} {off[2]:+7.1f}   {s[0]:5.2f} {s[1]:5.2f} {s[2]:5.2f}"
        )
    lines += found.doubts([surface.name for surface in surfaces])
    group = found.placement.group
    lines += [
        f"{surface.name}: no overlap could be registered, its place rests on the stage alone"
        for number, surface in enumerate(surfaces)
        if group[number] != group[0]
    ]
    return lines


def _about_seams(surfaces: list[Surface], placed: list[Scan]) -> list[str]:
    lines = ["seams: second less first over the common cells, bias, robust sd (um), sd over what sigma predicts"]
    for i, j in combinations(range(len(placed)), 2):
        seam = rec.seam_between(placed[i], placed[j])
        if np.isfinite(seam.bias_mm):
            lines.append(
                f"  {surfaces[i].name} - {surfaces[j].name}: {seam.cells} cells, bias {1000 * seam.bias_mm:+.2f}, "
                f"sd {1000 * seam.sd_mm:.2f}, ratio {seam.over_sigma:.2f}"
            )
    return lines

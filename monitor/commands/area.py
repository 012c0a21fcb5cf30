"""The command `area`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from configs import Campaign, InputError

from ..check import load_checked
from ..clock import RealClock
from ..outputs import check_out
from ..recipe import read_calibration, read_pattern_set, rig_of, simulated_calibration_file, stage_of
from ..stopping import graceful_stop
from ..tile_folder import TileFolder
from ..tiles import TileWalk, plan_tiles
from .mosaic import mosaic

__all__ = ["area"]


def area(
    campaign: Path,
    *,
    out: Annotated[Path, Parameter(name=["--out", "-o"])],
    dry_run: bool = False,
    height_map: Path | None = None,
    pitch_mm: float | None = None,
) -> int:
    """Scan an area larger than one field of view once: a stage carries the sample from tile to tile.

    The campaign says where the stage goes (`area:`). Each tile is captured and looked through; one that is not good
    enough is taken again. Then the tiles are stitched, as `microrelief mosaic` does, from where the stage says that it
    stood. Ctrl-C ends after the tile under way; the same command goes on from there, and so after any other stop.
    Nobody needs to be there. Exit code 4: tiles are missing; 75: a device went away. To follow an area on a schedule:
    `microrelief run`.

    Parameters
    ----------
    campaign
        Campaign file with `area:`.
    out
        Folder for the tiles and the stage file; made if it is not there.
    dry_run
        Show where the stage would go, and move nothing.
    height_map
        Where the height map goes: .npz, .nc, .tif or .ply; `area.nc` in the folder unless given.
    pitch_mm
        Side of a cell; by default the campaign's `grid.pitch_mm`, and without one about a camera pixel.

    Examples
    --------
    microrelief area soil.yaml --out crust --dry-run
    microrelief area soil.yaml --out crust
    """
    settings = load_checked(campaign).campaign
    if settings.area is None:
        raise InputError(
            f"{campaign}: has no `area:`: say where the stage goes, such as "
            "`area: {stage: {kind: gcode, port: /dev/ttyACM0}, x_mm: [0, 20], y_mm: [0, 10]}`"
        )
    result = out / "area.nc" if height_map is None else height_map
    if height_map is not None:
        check_out(height_map, pitch_mm)
    pitch_mm = pitch_mm if pitch_mm is not None else settings.grid.pitch_mm
    scan = _prepare(settings, out)
    if dry_run:
        for tile in scan.tiles:
            print(f"{tile.name}  x {tile.x_mm:8.3f} mm  y {tile.y_mm:8.3f} mm")
        print(f"{len(scan.tiles)} tiles")
        return 0
    out.mkdir(parents=True, exist_ok=True)
    scan.resume()
    with graceful_stop() as stop:
        scan.walk.stop = stop
        for done in scan.visit_all():
            if not done.again:
                print(f"{done.tile.name}: {done.cause or 'taken'}", flush=True)
            for note in done.notes:
                print(f"  {note}", flush=True)
    missing = len(scan.tiles) - len(scan.taken)
    print(f"{len(scan.taken)} of {len(scan.tiles)} tiles are in {out}")
    if stop.is_set() and missing:
        print("the same command goes on from here")
        return 4
    if len(scan.taken) > 1:
        file = settings.calibration.file or simulated_calibration_file(settings, scan.walk.patterns)
        tiles = [out / tile.name for tile in scan.tiles if tile.name in scan.taken]
        mosaic(*tiles, stage=scan.stage_file, out=result, calibration=file, pitch_mm=pitch_mm)
    return 4 if missing else 0


def _prepare(settings: Campaign, out: Path) -> TileFolder:
    from pipelines.reconstruction import footprint_grid

    assert settings.area is not None
    clock = RealClock()
    patterns = read_pattern_set(settings)
    calibration = read_calibration(settings, patterns, clock.now(), lambda what: print(what, flush=True))
    grid = footprint_grid(calibration)
    tiles = plan_tiles(settings.area, (grid.columns * grid.pitch_mm, grid.rows * grid.pitch_mm))
    rig = rig_of(settings, None)
    walk = TileWalk(settings.area, rig, stage_of(settings.area, rig), patterns, time.sleep)
    return TileFolder(walk, tiles, out, clock.now)

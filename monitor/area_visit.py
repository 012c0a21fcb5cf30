"""Area visit: a stage carries the sample past the rig, and what all tiles show becomes the slot's one scan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from configs import CaptureError
from pipelines import Event, Frames, Instant, PatternSet, Scan
from storage import StagePosition

from .area_plan import AreaPlan
from .tiles import Tile, TileWalk
from .visit import Measured, Recipe, Work, compared, make_scan, remarks

__all__ = ["AreaRig", "TakenTile", "Tiles", "area_work"]


@dataclass(frozen=True, slots=True, eq=False)
class TakenTile:
    """A tile as a height map in the rig's site frame, and where the stage said that it stood."""

    tile: Tile
    scan: Scan
    stands: StagePosition


@dataclass(frozen=True, slots=True, eq=False)
class Tiles:
    """What a visit of an area captured: the tiles that could be taken, and what there is to say of any."""

    time: Instant
    taken: tuple[TakenTile, ...]
    notes: tuple[Event, ...] = ()


@dataclass(slots=True)
class AreaRig:
    """A rig and a stage, used as one rig that captures a whole area.

    A tile becomes a height map as soon as it is taken: frames of one tile at a time are in memory. A tile that is not
    good enough in all its tries is left out. A device that goes away ends the visit, as it does on a rig alone.

    Parameters
    ----------
    walk : TileWalk
    plan : AreaPlan
    recipe : Recipe
    let_go : callable
        Told of frames that nobody needs any more.
    """

    walk: TileWalk
    plan: AreaPlan
    recipe: Recipe
    let_go: Callable[[Frames], None]

    def open(self) -> None:
        """Take hold of rig and stage."""
        self.walk.open()

    def close(self) -> None:
        """Let rig and stage go."""
        self.walk.close()

    def capture(self, patterns: PatternSet, at: Instant) -> Tiles:
        """Visit all tiles. All of them bear the time of the visit.

        Raises
        ------
        CaptureError
            Too few tiles were good enough.
        DeviceUnavailable
            A device stayed away.
        """
        taken: list[TakenTile] = []
        notes: list[Event] = []
        lost: list[str] = []

        def keep(tile: Tile, frames: Frames, stands: StagePosition) -> tuple[str, ...]:
            try:
                found = remarks(frames)
                taken.append(TakenTile(tile, make_scan(frames, self.recipe.calibration, self._rules), stands))
            except ValueError as error:
                raise CaptureError(str(error)) from error
            finally:
                self.let_go(frames)
            return tuple(event.text for event in found)

        for tile in self.plan.tiles:
            visited = self.walk.visit(tile, lambda: at, keep)
            # `unfit` and `process` know what is said of a capture by how it begins
            notes += [Event(at, "note", f"{text} ({tile.name})") for text in visited.notes]
            if visited.cause:
                lost.append(f"{tile.name}: {visited.cause}")
                notes.append(Event(at, "note", f"capture: a hole is left by {lost[-1]}"))
        _check_enough(self.plan, len(taken), "could be taken", lost)
        return Tiles(at, tuple(taken), tuple(notes))

    @property
    def _rules(self) -> Recipe:
        return replace(self.recipe, grid=self.plan.footprint, stable=None, region=None)


def area_work(plan: AreaPlan) -> Work[Measured]:
    """Give what makes a tick of an area's tiles: stitched on the plan's grid, and compared as any scan is."""
    return Work(partial(stitched, plan), compared)


def stitched(plan: AreaPlan, tiles: Tiles, recipe: Recipe) -> Measured:
    """Make one scan of the tiles, on the grid of the recipe.

    Neighbours are registered to each other from where the stage says that they are; what nothing joins to the others
    leaves a hole.

    Raises
    ------
    CaptureError
        Too few tiles hang together.
    """
    from pipelines.reconstruction import bow_mm

    from .joined_tiles import join
    from .laying import laid, united

    area, bow = plan.area, bow_mm(recipe.calibration)
    assert area.axes is not None  # of a plan
    names = [each.tile.name for each in tiles.taken]
    stage_mm = np.array([(each.stands.x_mm, each.stands.y_mm, 0.0) for each in tiles.taken])
    scans = [each.scan for each in tiles.taken]
    joined = join(scans, names, stage_mm, axes=area.axes, stage_sigma_mm=area.sigma_mm, bow_mm=bow)
    lost = [f"{names[number]}: {why}" for number, why in joined.left_out.items()]
    _check_enough(plan, len(joined.members), "hang together", lost)
    placed = laid(
        [scans[number] for number in joined.members], joined.placement, (recipe.grid.x0_mm, recipe.grid.y0_mm)
    )
    merged = united(placed, joined.placement, bow, recipe.grid)
    told = [*(f"a hole is left by {each}" for each in lost), *([joined.doubts] if joined.doubts else [])]
    return Measured(merged.scan, (*tiles.notes, *(Event(tiles.time, "note", f"capture: {text}") for text in told)))


def _check_enough(plan: AreaPlan, count: int, what: str, lost: Sequence[str]) -> None:
    if count < plan.least:
        raise CaptureError(f"only {count} of {len(plan.tiles)} tiles {what}: {lost[0]}")

"""Tiles of a large area, taken by a rig while a stage carries the sample: planned, visited, resumed after a stop."""

from __future__ import annotations

import math
import shutil
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from configs import Area, CaptureError, DeviceUnavailable, InputError
from pipelines import Instant, PatternSet
from storage import StagePosition, read_stage, whole_file, write_capture

from .rigs import Rig, Stage
from .visit import remarks

__all__ = ["Tile", "TileScan", "Visited", "plan_tiles"]

STAGE_FILE = "stage.yaml"
SAME_MM = 0.05
"""A recorded tile stands as near as this to where the plan has it, or it is of another plan."""
RETRY_S = 10.0
"""A device that went away is looked for again so much later."""


@dataclass(frozen=True, slots=True)
class Tile:
    """Where the stage goes for one field of view."""

    name: str
    x_mm: float
    y_mm: float


@dataclass(frozen=True, slots=True)
class Visited:
    """How a tile ended: its ``cause`` is empty where it was taken; ``again`` where an earlier run had."""

    tile: Tile
    cause: str = ""
    again: bool = False
    notes: tuple[str, ...] = ()


def plan_tiles(area: Area, field_mm: Sequence[float]) -> tuple[Tile, ...]:
    """Spread tiles evenly over an area, so that neighbours overlap; to and fro, so that the stage travels little.

    Parameters
    ----------
    area : Area
    field_mm : (float, float)
        Width and height of the field of view. How the stage's axes lie against the image is not known beforehand, so
        the lesser counts along both.
    """
    step = (1.0 - area.overlap) * min(field_mm)
    columns, rows = (_places(travel, step) for travel in (area.x_mm, area.y_mm))
    tiles = []
    for row, y in enumerate(rows):
        across = list(enumerate(columns))
        for column, x in across if row % 2 == 0 else reversed(across):
            tiles.append(Tile(f"tile_{row + 1:02d}_{column + 1:02d}", x, y))
    return tuple(tiles)


def _places(travel: tuple[float, float], step: float) -> list[float]:
    begin, end = travel
    count = math.ceil((end - begin) / step - 1e-9) + 1
    return [round(float(place), 4) for place in np.linspace(begin, end, count)]


@dataclass(slots=True)
class TileScan:
    """A scan of an area into a folder: a capture folder per tile, and the stage file that `mosaic` reads.

    Parameters
    ----------
    area : Area
    tiles : tuple of Tile
    rig : Rig
    stage : Stage
    patterns : PatternSet
    folder : Path
        Of an earlier run of the same plan, what it holds is kept and not taken again.
    now : callable
        Tells the time.
    wait : callable
        Waits so many seconds.
    stop : Event
        Ends the scan after the tile under way.
    """

    area: Area
    tiles: tuple[Tile, ...]
    rig: Rig
    stage: Stage
    patterns: PatternSet
    folder: Path
    now: Callable[[], Instant]
    wait: Callable[[float], object]
    stop: threading.Event = field(default_factory=threading.Event)
    taken: dict[str, StagePosition] = field(default_factory=dict)
    _open: bool = False

    @property
    def stage_file(self) -> Path:
        """Where the stage stood at each tile taken so far."""
        return self.folder / STAGE_FILE

    def resume(self) -> None:
        """Take up what an earlier run left.

        Raises
        ------
        InputError
            The folder holds tiles of another plan.
        """
        if not self.stage_file.exists():
            return
        planned = {tile.name: tile for tile in self.tiles}
        for name, place in read_stage(self.stage_file).tiles.items():
            tile = planned.get(name)
            if tile is None or max(abs(tile.x_mm - place.x_mm), abs(tile.y_mm - place.y_mm)) > SAME_MM:
                raise InputError(f"--out {self.folder}: holds tiles of another plan ({name}); give a new folder")
            if (self.folder / name / "capture.json").is_file():
                self.taken[name] = place

    def visit_all(self) -> Iterator[Visited]:
        """Visit the tiles that are not there yet, and give how each ended; then go back to the first.

        Raises
        ------
        DeviceUnavailable
            A device stayed away in all tries of one tile. What was taken is kept.
        """
        try:
            for tile in self.tiles:
                if tile.name in self.taken:
                    yield Visited(tile, again=True)
                    continue
                if self.stop.is_set():
                    return
                yield self._visit(tile)
            if self._open:
                self.stage.move_to(self.tiles[0].x_mm, self.tiles[0].y_mm)
        finally:
            self._close()

    def _visit(self, tile: Tile) -> Visited:
        for attempt in range(1, self.area.tries + 1):
            last = attempt == self.area.tries or self.stop.is_set()
            try:
                notes = self._take(tile)
            except DeviceUnavailable:
                self._close()
                if last:
                    raise
                self.wait(RETRY_S)
            except CaptureError as error:
                if last:
                    return Visited(tile, cause=str(error))
            else:
                return Visited(tile, notes=notes)
        raise AssertionError("unreachable: the last try returns or raises")

    def _take(self, tile: Tile) -> tuple[str, ...]:
        if not self._open:
            self._hold()
        self.stage.move_to(tile.x_mm, tile.y_mm)
        self.wait(self.area.settle_s)
        frames = self.rig.capture(self.patterns, self.now())
        notes = tuple(event.text for event in remarks(frames))
        place = self.folder / tile.name
        if place.exists():  # an earlier run was ended in the middle of writing it
            shutil.rmtree(place)
        write_capture(frames, place)
        x, y = self.stage.where()
        self.taken[tile.name] = StagePosition(x, y)
        self._write_stage_file()
        return notes

    def _hold(self) -> None:
        self.stage.open()
        self._open = True
        self.rig.open()
        if self.area.home:
            self.stage.home()

    def _close(self) -> None:
        self._open = False
        self.rig.close()
        self.stage.close()

    def _write_stage_file(self) -> None:
        lines = [f"sigma_mm: {self.area.sigma_mm:g}"]
        if self.area.axes is not None:
            lines.append(f"axes: [{', '.join(self.area.axes)}]")
        lines.append("tiles:")
        lines += [f"  {name}: [{place.x_mm:.4f}, {place.y_mm:.4f}]" for name, place in self.taken.items()]
        with whole_file(self.stage_file) as part:
            part.write_text("\n".join(lines) + "\n", encoding="utf-8")

"""Tiles of a large area: planned, and visited one by one while a stage carries the sample past the rig."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from configs import Area, CaptureError, DeviceUnavailable
from pipelines import Frames, Instant, PatternSet
from storage import StagePosition

from .rigs import Rig, Stage

__all__ = ["Keep", "Tile", "TileWalk", "Visited", "plan_tiles"]

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


Keep = Callable[[Tile, Frames, StagePosition], tuple[str, ...]]
"""Takes a tile's frames, and where the stage says that it stands; gives what there is to say of them. It raises
CaptureError where they are not good enough."""


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
class TileWalk:
    """Goes from tile to tile: move, let it settle, capture, and again where that was not good enough.

    Parameters
    ----------
    area : Area
    rig : Rig
    stage : Stage
    patterns : PatternSet
    wait : callable
        Waits so many seconds.
    stop : Event
        Once it is set, nothing is tried again.
    is_open : bool
        Both devices are held already.
    """

    area: Area
    rig: Rig
    stage: Stage
    patterns: PatternSet
    wait: Callable[[float], object]
    stop: threading.Event = field(default_factory=threading.Event)
    is_open: bool = False

    def open(self) -> None:
        """Take hold of both devices, if they are not held; the stage finds its zero where the area asks for that.

        Raises
        ------
        DeviceUnavailable
            One is not there now.
        """
        if not self.is_open:
            self.stage.open()
            self.rig.open()
            if self.area.home:
                self.stage.home()
            self.is_open = True

    def close(self) -> None:
        """Let both devices go."""
        self.is_open = False
        try:
            self.rig.close()
        finally:
            self.stage.close()

    def visit(self, tile: Tile, now: Callable[[], Instant], keep: Keep) -> Visited:
        """Visit a tile as often as the area allows, until what came is good enough to be kept.

        Raises
        ------
        DeviceUnavailable
            A device stayed away in all tries.
        """
        for attempt in range(1, self.area.tries + 1):
            last = attempt == self.area.tries or self.stop.is_set()
            try:
                self.open()
                self.stage.move_to(tile.x_mm, tile.y_mm)
                self.wait(self.area.settle_s)
                frames = self.rig.capture(self.patterns, now())
                notes = keep(tile, frames, StagePosition(*self.stage.where()))
            except DeviceUnavailable:
                self.close()
                if last:
                    raise
                self.wait(RETRY_S)
            except CaptureError as error:
                if last:
                    return Visited(tile, cause=str(error))
            else:
                return Visited(tile, notes=notes)
        raise AssertionError("unreachable: the last try returns or raises")

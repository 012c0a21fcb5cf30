"""TileFolder: a scan of an area into a folder, a capture folder per tile, taken up again after any stop."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from configs import InputError
from pipelines import Frames, Instant
from storage import StagePosition, read_stage, whole_file, write_capture

from .tiles import Tile, TileWalk, Visited
from .visit import remarks

__all__ = ["TileFolder"]

STAGE_FILE = "stage.yaml"
SAME_MM = 0.05
"""A recorded tile stands as near as this to where the plan has it, or it is of another plan."""


@dataclass(slots=True)
class TileFolder:
    """The folder of one scan: its captures, and the stage file that `mosaic` reads.

    Parameters
    ----------
    walk : TileWalk
        Its ``stop`` ends the scan after the tile under way.
    tiles : tuple of Tile
    folder : Path
        Of an earlier run of the same plan, what it holds is kept and not taken again.
    now : callable
        Tells the time.
    """

    walk: TileWalk
    tiles: tuple[Tile, ...]
    folder: Path
    now: Callable[[], Instant]
    taken: dict[str, StagePosition] = field(default_factory=dict)

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
                if self.walk.stop.is_set():
                    return
                yield self.walk.visit(tile, self.now, self._keep)
            if self.walk.is_open:
                self.walk.stage.move_to(self.tiles[0].x_mm, self.tiles[0].y_mm)
        finally:
            self.walk.close()

    def _keep(self, tile: Tile, frames: Frames, stands: StagePosition) -> tuple[str, ...]:
        notes = tuple(event.text for event in remarks(frames))
        place = self.folder / tile.name
        if place.exists():  # an earlier run was ended in the middle of writing it
            shutil.rmtree(place)
        write_capture(frames, place)
        self.taken[tile.name] = stands
        self._write_stage_file()
        return notes

    def _write_stage_file(self) -> None:
        area = self.walk.area
        lines = [f"sigma_mm: {area.sigma_mm:g}"]
        if area.axes is not None:
            lines.append(f"axes: [{', '.join(area.axes)}]")
        lines.append("tiles:")
        lines += [f"  {name}: [{place.x_mm:.4f}, {place.y_mm:.4f}]" for name, place in self.taken.items()]
        with whole_file(self.stage_file) as part:
            part.write_text("\n".join(lines) + "\n", encoding="utf-8")

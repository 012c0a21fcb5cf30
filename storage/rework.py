"""Rework: results made again on a branch beside the newest ones, which they replace at once when all are there."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from configs import StoreError
from pipelines import AlarmState, Event, Grid, Instant, Scan, Tick

from .layout import CELLS_OF_CHANGE, CELLS_OF_SCAN, FOLD, add_metric, metrics_of
from .location import Location
from .order import Tail, place
from .packing import Packing
from .records import read_scan, rows_of_change, rows_of_events, rows_of_metrics, rows_of_scan, tail_of
from .repository import root_of, short
from .rows import Rows, row, texts, write_rows
from .scan_table import ScanTable, table_of

__all__ = ["Rework"]

BRANCH = "process"
COMMIT_EVERY = 32
"""Scans between two commits of the branch: what a kill costs."""

REPLACED = ("alarm", "rejected", "note", "epoch")
"""Kinds of events that a visit gives its scan's own time to; those of other times are somebody else's."""

CELLS = {*(f"scans/{name}" for name in CELLS_OF_SCAN), *(f"change/{name}" for name in CELLS_OF_CHANGE)}
AS_TAKEN = {f"scans/{name}" for name in CELLS_OF_SCAN}
"""What a scan keeps whose heights are not made again."""


class Rework:
    """Writes scans again from a number on, in their order, on a branch that starts at the newest snapshot.

    Readers see the old results until `finish`; the snapshot before stays the parent of what follows. Work that was cut
    short goes on where its last commit stood, if it was the same work (`key`) on the same snapshot.

    Parameters
    ----------
    repository, location
        The Icechunk repository, and where it is.
    base : str
        The newest snapshot.
    key : str
        Names the work: range, settings, software.
    grid, packing, metrics
        The store's; `metrics` with the unit of each, those to add among them.
    first : int
        The first scan to write.
    check : callable
        Raises where the store may not be written, or not any more.
    adopt : callable
        Told of the snapshot that became the newest.
    """

    def __init__(
        self,
        repository: Any,
        location: Location,
        base: str,
        key: str,
        grid: Grid,
        packing: Packing,
        metrics: Mapping[str, str],
        first: int,
        *,
        check: Callable[[], None],
        adopt: Callable[[str], None],
    ) -> None:
        self._repository, self._location, self._base, self._key = repository, location, base, key
        self._grid, self._packing, self._metrics = grid, packing, dict(metrics)
        self._first, self._check, self._adopt = first, check, adopt
        self.tally: dict[str, int] = {}
        self.next = first
        self._new_baseline = False
        self._states: dict[str, AlarmState] | None = None
        self.resumed = self._resume()
        if not self.resumed:
            if BRANCH in repository.list_branches():
                repository.delete_branch(BRANCH)
            repository.create_branch(BRANCH, base)
        self._begin_session()
        for name, unit in self._metrics.items():
            if name not in metrics_of(self._root["metrics"]):
                add_metric(self._root["metrics"], name, unit)
        self._tail = tail_of(self._root.store, self.next)

    @staticmethod
    def done(repository: Any, snapshot: str, key: str) -> bool:
        """Whether a snapshot is what this very work gave."""
        return dict(repository.lookup_snapshot(snapshot).metadata).get("processed") == key

    @property
    def settled(self) -> bool:
        """Whether the scans from `next` on need not be written again: nothing that they depend on has changed."""
        if self.next == 0:
            return False
        old = tail_of(self._old.store, self.next)
        return old == self._tail and not self._new_baseline

    @property
    def tail(self) -> Tail:
        """What the next scan follows."""
        return self._tail

    def baseline(self) -> Scan | None:
        """Give the baseline that the next scan is compared with, as the store gives it back; None before scan 0."""
        if not self._tail.count:
            return None
        scan = read_scan(self._root.store, self._tail.baseline, self._grid, self._packing)
        return replace(scan, calibration_id=self._tail.calibration_id)  # tables are written at the next commit

    def alarms(self) -> dict[str, AlarmState]:
        """Give where the alarms stand before the next scan."""
        if self._states is None and self.next:
            self._states = dict(json.loads(str(self._root["scans/alarms"][self.next - 1])))
        return dict(self._states or {})

    def write(self, tick: Tick, *, keep_heights: bool, outcome: str) -> None:
        """Write the next scan; `outcome` is counted in `tally`.

        With `keep_heights` height, sigma, texture and level stay as they are stored, to the bit.
        """
        where = place(self._tail, tick, self._grid, self._metrics)
        number = self.next
        assert where.number == number
        assert tick.scan is not None
        rows = rows_of_scan(where, tick, self._packing)
        rows += rows_of_change(number, tick, self._packing)
        rows += rows_of_metrics(number, tick, self._metrics)
        if keep_heights:
            rows = [each for each in rows if each.path not in AS_TAKEN]
        self._bins["height"][number] = None if keep_heights else tick.scan.height
        self._bins["dz"][number] = (
            np.full(self._grid.shape, np.nan, np.float32) if tick.change is None else tick.change.dz
        )
        rows = [_plain(self._root, each) for each in rows]
        if tick.calibration is not None and tick.calibration.id not in self._calibrations:
            at = len(self._calibrations)
            self._calibrations.append(tick.calibration.id)
            rows.append(row("calibrations/id", at, tick.calibration.id))
            rows.append(row("calibrations/json", at, tick.calibration.to_json()))
        write_rows(self._root.store, [each for each in rows if each.path in CELLS])
        self._pending += [each for each in rows if each.path not in CELLS]
        self._states = dict(tick.alarms)
        self._replace_events(tick.scan.time, REPLACED, where.events)
        if where.tail.baseline == number:
            self._new_baseline = not keep_heights
        self._tail, self.next = where.tail, number + 1
        self.tally[outcome] = self.tally.get(outcome, 0) + 1
        if self.next % COMMIT_EVERY == 0:
            self._commit(f"process: scans {self._first} to {number}")
            self._begin_session()

    def table(self) -> ScanTable:
        """Give the table of all scans: those before `next` as they are now, the others as they were."""
        return table_of(self._root)

    def judge(self, number: int, time: Instant, states: Mapping[str, AlarmState], events: tuple[Event, ...]) -> None:
        """Write where some alarms stand after a scan that is not written again, and what is told of it; in order."""
        states = {**json.loads(str(self._root["scans/alarms"][number])), **states}
        self._pending.append(row("scans/alarms", number, json.dumps(states, sort_keys=True)))
        self._replace_events(time, ("alarm",), events)

    def finish(self, note: Event, attributes: Mapping[str, Any]) -> str:
        """Make what was written the newest, durably; give its snapshot.

        Raises
        ------
        StoreError
            If the disk does not take it; the old results then stay the newest.
        """
        self._new_events.append(note)
        self._root.attrs.update(attributes)
        import icechunk

        try:
            tip = self._commit(note.text, processed=self._key)
            self._check()
            self._location.advance(self._repository, self._base, tip)
        except StoreError:
            raise
        except (OSError, icechunk.IcechunkError) as error:
            why = getattr(error, "strerror", None) or short(error)
            raise StoreError(f"{self._location}: was not processed: {why}") from error
        self._adopt(tip)
        self._repository.delete_branch(BRANCH)
        return tip

    def _resume(self) -> bool:
        """Take up the branch, if it is the same work on the same snapshot, and whole."""
        if BRANCH not in self._repository.list_branches():
            return False
        # whatever a power cut left of the branch: the work then begins again
        with suppress(Exception):
            about = dict(self._repository.lookup_snapshot(self._repository.lookup_branch(BRANCH)).metadata)
            if (about.get("process"), about.get("base")) != (self._key, self._base):
                return False
            following = int(about["next"])
            read_scan(self._repository.readonly_session(BRANCH).store, following - 1, self._grid, self._packing)
            self.next, self.tally = following, dict(json.loads(about["tally"]))
            self._new_baseline = bool(about["new_baseline"])
            return True
        return False

    def _begin_session(self) -> None:
        self._session = self._repository.writable_session(BRANCH)
        self._root = root_of(self._session, "r+")
        self._old = root_of(self._repository.readonly_session(snapshot_id=self._base))
        self._pending: list[Rows] = []
        self._bins: dict[str, dict[int, Any]] = {"height": {}, "dz": {}}
        self._new_events: list[Event] = []
        self._calibrations = [str(name) for name in self._root["calibrations/id"][:]]
        self._replaced: dict[int, Collection[str]] = {}

    def _replace_events(self, time: Instant, kinds: Collection[str], events: Iterable[Event]) -> None:
        self._replaced[int(time.astype("datetime64[ns]").astype(np.int64))] = kinds
        self._new_events += events

    def _commit(self, message: str, **metadata: str) -> str:
        self._check()
        rows = _joined(self._pending) + self._rows_of_bins()
        self._rewrite_events()
        write_rows(self._root.store, rows)
        about = {"process": self._key, "base": self._base, "next": str(self.next), "tally": json.dumps(self.tally)}
        about["new_baseline"] = "yes" if self._new_baseline else ""
        snapshot: str = self._session.commit(message, metadata={**about, **metadata})
        return snapshot

    def _rows_of_bins(self) -> list[Rows]:
        """Give the coarse means of what was written: in the long chunks, and in the tail after them."""
        group, rows = self._root["binned"], []
        for name, values in self._bins.items():
            folded, packed = group[name].shape[0], []
            for number, cells in sorted(values.items()):
                path, at = (name, number) if number < folded else (f"{name}_tail", number % FOLD)
                array = group[path]
                # rows as they are, rather than gaps: two runs of rows in one chunk would overwrite each other
                fresh = array[at] if cells is None else self._packing.pack_bins(cells, name)
                packed.append(Rows(f"binned/{path}", at, 1, fresh[np.newaxis]))
            rows += _joined(packed)
        return rows

    def _rewrite_events(self) -> None:
        """Leave out the events that were replaced, and add the new ones."""
        group = self._root["events"]
        times, kinds = group["time"][:], group["kind"][:]
        gone = [kind in self._replaced.get(int(time), ()) for time, kind in zip(times, kinds, strict=True)]
        keep = ~np.array(gone, dtype=bool)
        count = int(keep.sum())
        if count < len(times):
            for name in ("time", "kind", "text"):
                values = group[name][:][keep]
                group[name].resize((count,))
                group[name][:] = values
        write_rows(self._root.store, rows_of_events(count, self._new_events))


def _plain(root: Any, rows: Rows) -> Rows:
    """Where a row only lengthens its array (no change), write the fill value: there may be something already."""
    if rows.values is not None:
        return rows
    array = root[rows.path]
    if array.dtype.kind not in "biuf":
        return Rows(rows.path, rows.start, rows.count, texts([str(array.fill_value)] * rows.count))
    return Rows(
        rows.path, rows.start, rows.count, np.full((rows.count, *array.shape[1:]), array.fill_value, array.dtype)
    )


def _joined(rows: list[Rows]) -> list[Rows]:
    """Join the rows of each array, which follow each other: a table is then written once a commit, not once a scan."""
    by_path: dict[str, list[Rows]] = {}
    for each in rows:
        by_path.setdefault(each.path, []).append(each)
    joined = []
    for path, parts in by_path.items():
        values = np.concatenate([each.values for each in parts if each.values is not None])
        assert parts[0].start + len(values) == parts[-1].start + parts[-1].count
        joined.append(Rows(path, parts[0].start, len(values), values))
    return joined

"""IcechunkStore: a campaign as one Icechunk repository in a folder or a bucket; one tick is one transaction."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from configs import StoreError
from pipelines import Calibration, Event, Frames, Grid, Instant, Tick, format_instant, parse_instant

from .allocator import give_back
from .layout import (
    SCHEMA,
    add_metric,
    grid_of,
    lay_out,
    metrics_of,
    noise_of,
    root_attributes,
    split_sizes,
)
from .location import BRANCH, Location, Lock
from .order import Place, Tail, described, place_all
from .packing import Packing
from .raw_frames import read_frames
from .records import (
    read_change,
    read_events,
    read_scan,
    tail_of,
)
from .repository import check_whole, create_repository, newest_whole, open_repository, reason, root_of
from .rows import Known, read_row, write_rows
from .series import frame_of
from .store import About, Stored
from .tick_rows import rows_of_tick
from .wholeness import read_newest

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from .rework import Rework

__all__ = ["IcechunkStore"]

GIVE_BACK_EVERY = 128
"""Commits between two returns of freed memory: each takes some milliseconds."""


class IcechunkStore:
    """A store on a disk or on S3. Made by `create_store` and `open_store`.

    A reader sees the snapshot that was newest when it opened; a writer sees its own last append.
    """

    def __init__(
        self, location: Location, lock: Lock | None, past: Callable[[Any, Location], str] | None = None
    ) -> None:
        self._location = location
        self._lock = lock
        self._known: Known = {}
        self._commits = 0
        self._repository = open_repository(location)
        if past is None:
            snapshot, lost = newest_whole(self._repository, location, self._probe)
        else:
            snapshot, lost = past(self._repository, location), ""
            check_whole(self._repository, location, snapshot, self._probe)
        self._attach(snapshot, self._known)  # which `_probe` learnt
        self._about, self._packing, self._tail = self._load()
        self._lost: tuple[Event, ...] = ()
        if lost:
            created = parse_instant(self._root.attrs["created"])
            when = self._tail.time if self._tail.time is not None else created
            newest = f"scan {self._tail.count - 1}" if self._tail.count else "no scan"
            self._lost = (Event(when, "lost", f"store: {lost}, whose newest is {newest}; what came after is lost"),)
            if lock is not None:
                self._go_back()

    @staticmethod
    def create(
        location: Location,
        *,
        site: str,
        grid: Grid,
        campaign: str,
        campaign_hash: str,
        metrics: Mapping[str, str],
        software: str,
        created: Instant,
        packing: Packing,
    ) -> IcechunkStore:
        """Make a store at `location`, where there must be nothing, and hold its lock."""
        import icechunk
        import zarr

        def fill(making: Location) -> None:
            repository = create_repository(making, split_sizes(grid))
            session = repository.writable_session(BRANCH)
            attributes = root_attributes(site, grid, campaign, campaign_hash, software, format_instant(created))
            lay_out(zarr.create_group(session.store, attributes=attributes), grid, packing, metrics)
            making.publish(repository, session, "store created", {})

        lock = None
        try:
            lock = location.make(fill)
            return IcechunkStore(location, lock)
        except BaseException as error:
            if lock is not None:
                lock.release()
            if isinstance(error, (OSError, icechunk.IcechunkError)) and not isinstance(error, StoreError):
                raise StoreError(f"{location}: cannot be made: {reason(error)}") from error
            raise

    @staticmethod
    def open(
        location: Location,
        *,
        write: bool,
        metrics: Mapping[str, str],
        past: Callable[[Any, Location], str] | None = None,
    ) -> IcechunkStore:
        """Open a store; a writer takes the lock, and adds `metrics` that are not there yet; `past` picks a snapshot."""
        if write:
            location.check()  # says what is wrong with the place before a lock is made in it
        lock = location.lock() if write else None
        try:
            store = IcechunkStore(location, lock, past)
            if lock is not None and lock.taken_from:
                store._note_takeover(lock.taken_from)
            new = {name: unit for name, unit in metrics.items() if name not in store.about.metrics}
            if write and new:
                store._add_metrics(new)
        except BaseException:
            if lock is not None:
                lock.release()
            raise
        return store

    def append(self, tick: Tick) -> int | None:
        """Commit one tick durably; see `append_all`."""
        return self.append_all([tick])[0]

    def append_all(self, ticks: Sequence[Tick]) -> tuple[int | None, ...]:
        """Commit ticks durably, as one transaction; see `Store.append_all`.

        Raises
        ------
        StoreError
            If the store is open to read, a tick does not fit (see `order.place`), or the disk does not take it;
            then the store is as it was.
        """
        self._writing()
        if not ticks:
            return ()
        places = place_all(self._tail, ticks, self._about.grid or Grid(1, 1, 1.0), self._about.metrics)

        def write(root: Any, known: Known) -> None:
            for tick, where in zip(ticks, places, strict=True):
                self._write(root, known, tick, where)

        self._commit(write, *described(ticks, places))
        self._tail = places[-1].tail
        return tuple(where.number for where in places)

    def __len__(self) -> int:
        return self._tail.count

    def __getitem__(self, number: int) -> Stored:
        import icechunk

        number = self._number(number)
        try:
            return self._read(number)
        # a damaged file shows as whatever the codec above it makes of the bytes
        except (icechunk.IcechunkError, OSError, ValueError, RuntimeError, TypeError) as error:
            raise StoreError(f"{self._location}: scan {number} cannot be read: {reason(error)}") from error

    def window(self, first: Instant | None = None, last: Instant | None = None) -> xr.Dataset:
        """Give the scans between two instants, lazily; see `Store.window`."""
        from .view import window_of

        return window_of(self._session.store, first, last)

    def series(self) -> pd.DataFrame:
        """Give all metrics; see `Store.series`."""
        table, scans = self._root["metrics"], self._root["scans"]
        times = table["time"][:].astype("datetime64[ns]")
        columns = {each: table[each][:] for name in self._about.metrics for each in (name, f"{name}_sigma")}
        return frame_of(times, scans["scan"][:], columns, self._about.metrics)

    @property
    def about(self) -> About:
        """What this store is and what made it."""
        return replace(self._about, snapshot=self._snapshot, noise=noise_of(self._root.attrs))

    @property
    def events(self) -> tuple[Event, ...]:
        """All events, oldest first; a reader that had to go back to an older snapshot says so last."""
        return (*read_events(self._root["events"]), *self._lost)

    def calibration(self, calibration_id: str) -> Calibration:
        """Give a calibration that placed some scan. Raises KeyError where there is none of that id."""
        group = self._root["calibrations"]
        ids = [str(name) for name in group["id"][:]]
        if calibration_id not in ids:
            raise KeyError(f"{self._location}: no calibration {calibration_id!r}: it holds {', '.join(ids) or 'none'}")
        return Calibration.from_json(str(group["json"][ids.index(calibration_id)]))

    def frames(self, number: int) -> Frames | None:
        """Give the frames that a scan was made of; see `Store.frames`."""
        return read_frames(self._root, self._number(number))

    def rework(self, key: str, first: int, metrics: Mapping[str, str]) -> Rework | None:
        """Begin, or take up again, to write all scans from `first` on anew; None where the store is that work's result.

        Raises StoreError if the store is open to read.
        """
        from .rework import Rework

        self._writing()
        if Rework.done(self._repository, self._snapshot, key):
            return None

        def adopt(snapshot: str) -> None:
            self._attach(snapshot, {})
            self._about, self._packing, self._tail = self._load()

        units = {**self._about.metrics, **metrics}
        grid = grid_of(self._root.attrs)
        about = (self._repository, self._location, self._snapshot, key, grid, self._packing, units, first)
        return Rework(*about, check=self._writing, adopt=adopt)

    @property
    def session(self) -> Any:
        """The Icechunk session at ``about.snapshot``: ``xarray.open_zarr(session.store, group="scans")`` reads it."""
        return self._session

    @property
    def binned(self) -> Any:
        """The Zarr group of coarse histories; `cell_history` and `line_history` read it."""
        return self._root["binned"]

    @property
    def repository(self) -> Any:
        """The Icechunk repository."""
        return self._repository

    @property
    def location(self) -> Location:
        """Where it is."""
        return self._location

    @property
    def lost_now(self) -> tuple[Event, ...]:
        """What a reader had to leave to find a whole snapshot; a writer has it among its events."""
        return self._lost

    def close(self) -> None:
        """Let go of the writer's lock, if held."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def __repr__(self) -> str:
        return f"IcechunkStore({str(self._location)!r}, {len(self)} scans)"

    def _number(self, number: int) -> int:
        count = len(self)
        if not -count <= number < count:
            raise IndexError(f"{self._location}: there is no scan {number}: it holds {count}")
        return number % count

    def _read(self, number: int) -> Stored:
        store, grid = self._session.store, grid_of(self._root.attrs)
        found = read_row(store, "scans", number, ("epoch", "baseline", "planned", "alarms"), self._known)
        return Stored(
            number=number,
            epoch=int(found["epoch"]),
            baseline=int(found["baseline"]),
            planned=np.datetime64(int(found["planned"]), "ns"),
            scan=read_scan(store, number, grid, self._packing, self._known),
            change=read_change(store, number, grid, self._packing, self._known),
            alarms=json.loads(str(found["alarms"])),
        )

    def _writing(self) -> None:
        if self._lock is None:
            raise StoreError(f"{self._location}: is open to read: open it with write=True")
        self._lock.check()

    def _commit(self, write: Callable[[Any, Known], None], message: str, metadata: dict[str, Any]) -> None:
        """Let `write` fill a session's root group and commit it; where that fails, the store is as it was."""
        import icechunk

        known, self._known = self._known, {}  # of a commit that failed nothing is known
        try:
            session = self._repository.writable_session(BRANCH)
            if session.snapshot_id != self._snapshot:
                raise StoreError(f"{self._location}: another writer wrote here meanwhile: {message} was not stored")
            write(root_of(session, "r+"), known)
            snapshot = self._location.publish(self._repository, session, message, metadata)
        except (icechunk.IcechunkError, OSError) as error:
            if isinstance(error, StoreError):
                raise
            raise StoreError(f"{self._location}: {message} was not stored: {reason(error)}") from error
        self._attach(snapshot, known)
        self._commits += 1
        if self._commits % GIVE_BACK_EVERY == 0:
            give_back()

    def _write(self, root: Any, known: Known, tick: Tick, where: Place) -> None:
        write_rows(root.store, rows_of_tick(root, tick, where, self._packing, self._about.metrics), known)

    def _add_metrics(self, new: dict[str, str]) -> None:
        def write(root: Any, _: Known) -> None:
            for name, unit in new.items():
                add_metric(root["metrics"], name, unit)

        self._commit(write, f"metrics added: {', '.join(new)}", {})
        self._about, self._packing, self._tail = self._load()

    def _go_back(self) -> None:
        """Make the newest whole snapshot the newest one, and keep the event that says so."""
        self._repository.reset_branch(BRANCH, self._snapshot)
        events, self._lost = self._lost, ()
        note = Tick(events[0].time, events=events)
        self._commit(
            lambda root, known: self._write(root, known, note, Place(self._tail, None, events)),
            "went back to the newest whole snapshot",
            {},
        )

    def _note_takeover(self, holder: str) -> None:
        """Commit before anything else: a writer that was only asleep then finds a newer snapshot, and is refused."""
        when = self._tail.time if self._tail.time is not None else parse_instant(self._root.attrs["created"])
        event = Event(when, "note", f"store: taken over from a writer that did not let go of it ({holder})")
        note = Tick(when, events=(event,))
        self._commit(
            lambda root, known: self._write(root, known, note, Place(self._tail, None, (event,))), "taken over", {}
        )

    def _probe(self, session: Any) -> None:
        """Read what a whole snapshot must hold: all groups, and the newest row of every array."""
        root = root_of(session)
        schema = root.attrs.get("microrelief_schema")
        if not isinstance(schema, int):
            raise StoreError(f"{self._location}: is an Icechunk repository, but not a microrelief store")
        if schema > SCHEMA:
            raise StoreError(
                f"{self._location}: schema {schema} was made by a newer microrelief (this one reads {SCHEMA}): "
                "update it"
            )
        self._known = read_newest(session.store, whole=not self._location.writes_whole)

    def _attach(self, snapshot: str, known: Known) -> None:
        """Read from another snapshot from now on; what is not `known` of it is opened when it is asked for."""
        self._snapshot, self._known = snapshot, known
        self._session = self._repository.readonly_session(snapshot_id=snapshot)
        self._opened: Any = None

    @property
    def _root(self) -> Any:
        if self._opened is None:
            self._opened = root_of(self._session)
        return self._opened

    def _load(self) -> tuple[About, Packing, Tail]:
        """Read the store's facts, how it packs heights, and its tail."""
        attributes, height = dict(self._root.attrs), self._root["scans/height"]
        packing = Packing.of(height)
        about = About(
            location=str(self._location),
            site=attributes["site"],
            grid=grid_of(attributes),
            campaign=attributes["campaign"],
            campaign_hash=attributes["campaign_hash"],
            software=attributes["software"],
            schema=attributes["microrelief_schema"],
            snapshot="",
            metrics=metrics_of(self._root["metrics"]),
            step_mm=packing.step_mm,
        )
        return about, packing, tail_of(self._session.store, height.shape[0], self._known)

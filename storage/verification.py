"""Verifies a store: every chunk read and its checksum with it, every invariant checked; changes nothing."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from configs import StoreError
from pipelines import Calibration, format_instant

from .icechunk_store import IcechunkStore
from .layout import FOLD, SCHEMA, grid_of
from .ledger import Ledger, ledger_beside
from .packing import Packing
from .repository import root_of, short
from .stores import open_store
from .wholeness import faults

__all__ = ["Finding", "Verified", "verify"]

BLOCK_BYTES = 32e6
"""So much is read at once; where that fails, scan by scan."""

FLAT = 2.0
"""A commit's own files (manifests, snapshot) may grow by this factor over a store's life."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is not as it should be: what, where and what to do. A ``note`` is no damage."""

    level: Literal["damaged", "note"]
    where: str
    what: str
    mend: str

    def __str__(self) -> str:
        return f"{self.level}: {self.where}: {self.what}; {self.mend}"


@dataclass(frozen=True, slots=True)
class Verified:
    """What was verified, and what was found.

    Parameters
    ----------
    scans, snapshots, arrays : int
    cells_bytes : int
        Read, decoded.
    findings : tuple of Finding
    """

    scans: int
    snapshots: int
    arrays: int
    cells_bytes: int
    findings: tuple[Finding, ...]

    @property
    def damaged(self) -> bool:
        """Whether anything is damaged."""
        return any(finding.level == "damaged" for finding in self.findings)


def verify(path: str | Path, progress: Progress = lambda done, total: None) -> Verified:
    """Verify a store.

    Read: every chunk of every array, whose checksum is checked on the way (a store of schema 1 has none). Checked: the
    order of times and numbers, epochs and baselines, lengths and units, packing, sigma beside height, coarse means
    against the cells, calibrations by their id, files that no snapshot needs, snapshots whose files are gone, the
    ledger, and that commits stay as small as they were.

    Parameters
    ----------
    path : str or Path
    progress : callable
        Called with (arrays read, arrays in all).

    Raises
    ------
    StoreError
        If there is no store at `path`, or none of its snapshots is whole.
    """
    store = open_store(path)
    assert isinstance(store, IcechunkStore)
    root = root_of(store.session)
    found: list[Finding] = [
        Finding(
            "damaged",
            "store",
            event.text.removeprefix("store: "),
            "the next `microrelief run` goes on from there; check the disk",
        )
        for event in store.events
        if event in store.lost_now
    ]
    arrays = {path: each for path, each in root.members(max_depth=None) if hasattr(each, "chunks")}
    read = 0
    for done, (name, array) in enumerate(sorted(arrays.items())):
        progress(done, len(arrays))
        found += _read(name, array)
        read += array.nbytes
    progress(len(arrays), len(arrays))
    checks = [_schema, _lengths, _order, _units, _cells, _calibrations]
    broken = any(finding.level == "damaged" and finding.where != "store" for finding in found)
    for check in checks:
        try:
            found += check(root)
        except faults() as error:
            if not broken:  # else it is the damage that was found already
                found.append(Finding("damaged", "store", short(error), "restore it from a copy"))
    history = _History(store)
    found += history.findings()
    found += _ledger(store, path)
    return Verified(len(store), history.count, len(arrays), read, tuple(found))


def _rows_at_once(array: Any) -> int:
    row = max(int(np.prod(array.shape[1:])) * max(array.dtype.itemsize, 1), 1)
    chunk = int(array.chunks[0])
    return max(int(BLOCK_BYTES // row) // chunk, 1) * chunk


def _read(name: str, array: Any) -> Iterator[Finding]:
    """Read every chunk; name what cannot be read as closely as the chunks allow."""
    step, chunk = _rows_at_once(array), int(array.chunks[0])
    for first in range(0, array.shape[0], step):
        last = min(first + step, array.shape[0])
        try:
            array[first:last]
        except faults():
            for start in range(first, last, chunk):
                try:
                    array[start : start + chunk]
                except faults() as error:
                    end = min(start + chunk, last) - 1
                    what = array.metadata.dimension_names[0] or "row"
                    rows = f"{what} {start}" if start == end else f"{what} {start} to {end}"
                    yield Finding("damaged", f"{name}, {rows}", short(error), "restore that file from a copy")


def _schema(root: Any) -> Iterator[Finding]:
    schema = root.attrs["microrelief_schema"]
    if schema < SCHEMA:
        mend = "`microrelief store copy` makes one that has them"
        yield Finding("note", "store", f"schema {schema}: its chunks have no checksums", mend)


def _lengths(root: Any) -> Iterator[Finding]:
    count = root["scans/time"].shape[0]
    for name in ("scans", "change", "metrics"):
        for key, array in root[name].arrays():
            if array.metadata.dimension_names[0] == "time" and array.shape[0] != count:
                yield _damaged(f"{name}/{key}", f"holds {array.shape[0]} scans, scans/time {count}")
    if root["binned/time"].shape[0] != count:
        yield _damaged("binned/time", f"holds {root['binned/time'].shape[0]} scans, scans/time {count}")


def _order(root: Any) -> Iterator[Finding]:
    scans = root["scans"]
    times, numbers = scans["time"][:], scans["scan"][:]
    epochs, baselines = scans["epoch"][:], scans["baseline"][:]
    if not len(times):
        return
    for number in np.flatnonzero(np.diff(times) <= 0):
        what = f"is not newer than scan {number}: {_told(times[number + 1])} after {_told(times[number])}"
        yield _damaged(f"scans/time, scan {number + 1}", what)
    for number in np.flatnonzero(numbers != np.arange(len(numbers)))[:1]:
        yield _damaged(f"scans/scan, scan {number}", f"is numbered {numbers[number]}")
    for number in np.flatnonzero(np.diff(epochs) < 0)[:1]:
        yield _damaged(f"scans/epoch, scan {number + 1}", f"epoch {epochs[number + 1]} after {epochs[number]}")
    wrong = (baselines > numbers) | (baselines < 0) | (epochs[np.clip(baselines, 0, len(epochs) - 1)] != epochs)
    for number in np.flatnonzero(wrong)[:1]:
        yield _damaged(f"scans/baseline, scan {number}", f"baseline {baselines[number]} is not of its epoch")
    then = root["change/baseline_time"][:]
    measured = then != np.iinfo(np.int64).min
    for number in np.flatnonzero(measured & (then != times[np.clip(baselines, 0, len(times) - 1)]))[:1]:
        yield _damaged(f"change/baseline_time, scan {number}", f"is {_told(then[number])}, not its baseline's time")
    for name in ("change/time", "metrics/time", "binned/time"):
        if not np.array_equal(root[name][:], times):
            yield _damaged(name, "differs from scans/time")


def _units(root: Any) -> Iterator[Finding]:
    expected = {**dict.fromkeys(("scans/height", "scans/sigma", "change/dz", "change/lod"), "mm")}
    expected |= dict.fromkeys(("scans/x", "scans/y", "binned/height", "binned/dz"), "mm")
    expected |= dict.fromkeys(("scans/time", "change/time", "metrics/time"), "nanoseconds since 1970-01-01")
    for name, unit in expected.items():
        if root[name].attrs.get("units") != unit:
            yield _damaged(name, f"its unit is {root[name].attrs.get('units')!r}, not {unit!r}")
    step = root["scans/height"].attrs.get("scale_factor")
    for name in ("scans/height", "change/dz", "binned/height", "binned/dz"):
        scale = root[name].attrs.get("scale_factor")
        if scale != step or not step:
            yield _damaged(name, f"its scale_factor is {scale!r}, not the {step!r} of /scans/height")
    grid = grid_of(root.attrs)
    for name, values in (("scans/x", grid.x_mm), ("scans/y", grid.y_mm)):
        if not np.array_equal(root[name][:], values):
            yield _damaged(name, "differs from the grid of the store")


def _cells(root: Any) -> Iterator[Finding]:
    """Check each scan's cells against each other, and the coarse means against them."""
    heights, sigmas = root["scans/height"], root["scans/sigma"]
    elsewhere = root["scans/calibration"][:] == ""  # a map that was taken in may say no uncertainty
    packing, coarse_of = Packing.of(heights), _coarse_heights(root["binned"])
    for number in range(heights.shape[0]):
        try:
            height, sigma = heights[number], sigmas[number]
            coarse = coarse_of(number)
        except faults():
            continue  # found already
        measured = height != packing.fill
        wrong = np.isfinite(sigma) & ~measured if elsewhere[number] else measured != np.isfinite(sigma)
        bad = np.count_nonzero(wrong) + np.count_nonzero(sigma[measured] <= 0)
        if bad:
            yield _damaged(f"scans/sigma, scan {number}", f"{bad} cells have a height without a sigma, or the reverse")
        again = packing.pack_bins(packing.unpack(height), "height").astype(np.int64)
        apart = int(np.abs(again - coarse).max(initial=0))
        if apart > 1:  # the mean of rounded heights may round the other way
            yield _damaged(f"binned/height, scan {number}", f"differs from the cells by {apart * packing.step_mm:g} mm")


def _coarse_heights(binned: Any) -> Callable[[int], Any]:
    """Give what reads a scan's coarse heights; folded ones lie in chunks of many scans, each read once."""
    folded, block, held = binned["height"].shape[0], -1, None

    def read(number: int) -> Any:
        nonlocal block, held
        if number >= folded:
            return binned["height_tail"][number % FOLD].astype(np.int64)
        if number // FOLD != block:
            block = number // FOLD
            held = binned["height"][block * FOLD : (block + 1) * FOLD].astype(np.int64)
        assert held is not None
        return held[number % FOLD]

    return read


def _calibrations(root: Any) -> Iterator[Finding]:
    group = root["calibrations"]
    kept = [str(name) for name in group["id"][:]]
    for name, text in zip(kept, group["json"][:], strict=True):
        try:
            if Calibration.from_json(str(text)).id != name:
                yield _damaged(f"calibrations, {name}", "its content has another id")
        except (ValueError, json.JSONDecodeError) as error:
            yield _damaged(f"calibrations, {name}", f"cannot be read: {short(error)}")


class _History:
    """The snapshots, and the files beneath them."""

    def __init__(self, store: IcechunkStore) -> None:
        self._repository, self._location = store.repository, store.location
        self._snapshots = list(self._repository.ancestry(snapshot_id=store.about.snapshot))
        self.count = len(self._snapshots)

    def findings(self) -> Iterator[Finding]:
        """Give what is wrong with older snapshots, what nobody needs, and whether commits grow."""
        present = {
            name.removeprefix("manifests/"): size
            for name, size in self._location.sizes()
            if name.startswith("manifests/")
        }
        gone = [s for s in self._snapshots if any(present.get(m.id) != m.size_bytes for m in s.manifests)]
        if gone:
            mend = "`microrelief store expire` drops old snapshots; the newest is checked by itself"
            what = f"{len(gone)} of {self.count} miss files, the newest of {gone[0].written_at:%Y-%m-%dT%H:%M:%SZ}"
            yield Finding("damaged", "history", what, mend)
        try:
            orphans = self._repository.garbage_collect(datetime.now(UTC), dry_run=True)
        except faults() as error:
            yield Finding("damaged", "history", f"cannot be followed: {short(error)}", "`microrelief store copy`")
            return
        count = sum(
            getattr(orphans, f"{name}_deleted") for name in ("chunks", "manifests", "snapshots", "transaction_logs")
        )
        if count:
            what = f"{count} files, {orphans.bytes_deleted / 1e6:.1f} MB, that no snapshot needs"
            yield Finding("note", "files", what, "`microrelief store gc` removes them once they are a day old")
        yield from self._growth()

    def _growth(self) -> Iterator[Finding]:
        """Compare what the newest and the oldest commits of scans wrote beside their cells."""
        sizes = [
            self._own_size(snapshot, before)
            for snapshot, before in zip(self._snapshots, self._snapshots[1:], strict=False)
            if snapshot.message.startswith("scan")
        ]
        if len(sizes) < 200:
            return
        late, early = float(np.median(sizes[:50])), float(np.median(sizes[-50:]))
        if late > FLAT * early:
            what = f"a commit wrote {early / 1e3:.1f} kB beside its cells once, {late / 1e3:.1f} kB now"
            yield Finding("note", "growth", what, "please report it; `microrelief store compact` gives space back")

    def _own_size(self, snapshot: Any, before: Any) -> int:
        old = {manifest.id for manifest in before.manifests}
        return sum(manifest.size_bytes for manifest in snapshot.manifests if manifest.id not in old)


def _ledger(store: IcechunkStore, path: str | Path) -> Iterator[Finding]:
    """Compare the ledger's scans with the store's."""
    where = ledger_beside(path)
    if not where.exists():
        return
    try:
        ledger = Ledger(where, write=False)
    except StoreError as error:
        yield Finding("damaged", "ledger", str(error), "move it away: the next run makes another")
        return
    rows = [row for row in ledger.rows() if row.scan is not None]
    ledger.close()
    planned = root_of(store.session)["scans/planned"][:]
    mend = "the store is what counts; the ledger's row is wrong"
    for row in rows:
        assert row.scan is not None
        if row.scan >= len(planned):
            yield Finding("damaged", "ledger", f"scan {row.scan} of {format_instant(row.planned)} is not stored", mend)
        elif planned[row.scan] != row.planned.astype("datetime64[ns]").astype(np.int64):
            yield Finding("damaged", "ledger", f"scan {row.scan} was planned at another time in the store", mend)


def _damaged(where: str, what: str) -> Finding:
    return Finding("damaged", where, what, "restore the store from a copy, or leave that scan out")


def _told(nanoseconds: Any) -> str:
    return format_instant(np.datetime64(int(nanoseconds), "ns"))

"""``microrelief ingest``: height maps and clouds of other scanners into a store."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated
from zoneinfo import ZoneInfo

import numpy as np
from cyclopts import Parameter

from configs import Campaign, InputError, did_you_mean, parse_duration
from pipelines import Event, Grid, Instant, Scan, format_instant, instant, parse_instant
from storage import Store, create_store, fitting_packing, open_store, read_raster, scan_of, scan_table, store_exists

from .. import __version__
from ..alarms import Watches, resumed
from ..environment import Reading, make_sensor
from ..reprocess import campaign_of, rules_of
from ..visit import Rules, compare_with, judged

__all__ = ["ingest"]

METRICS = ("net_volume", "gained_volume", "lost_volume")


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the command line says of all files."""

    pitch_mm: float | None
    unit: str | None
    sigma_mm: float | None
    times: tuple[Instant, ...]
    zone: str | None


def ingest(
    store: str,
    *files: Path,
    time: str | None = None,
    every: str | None = None,
    zone: str | None = None,
    pitch_mm: float | None = None,
    unit: str | None = None,
    sigma_mm: float | None = None,
    metric: Annotated[Sequence[str], Parameter(negative="")] = (),
) -> int:
    """Take height maps and clouds of other scanners into a store, in the order of their time.

    Each file becomes a scan: it is compared with the baseline and measured as a visit of a campaign would be. A store
    that is not there is made on the first file's grid. Read are .npz, .nc, .tif, .gsf, the clouds .ply, .las, .laz,
    .xyz and .csv, and the files of some forty kinds of instruments such as .x3p and .sur (extra `instrument-files`).
    A map on another grid than the store's is interpolated onto it.

    Parameters
    ----------
    store
        The store's folder or address.
    files
        What to take in.
    time
        When the first file was measured, such as 2026-11-22T21:00:00Z; without it the files must say.
    every
        With --time: how long after each file the next was measured, such as 6 h.
    zone
        Time zone of times that name none, such as Europe/Berlin; without it the campaign's that the store keeps.
    pitch_mm
        Side of a cell of a new store; without it the first file's.
    unit
        Unit of a cloud's coordinates: mm (of LAS m) unless given.
    sigma_mm
        Standard uncertainty of the heights, where a file says none: levels of detection follow from it.
    metric
        Follow this metric in a new store; may be given several times.

    Examples
    --------
    microrelief ingest slope.icechunk 2026-11-*.tif --sigma-mm 0.02
    microrelief ingest crust.icechunk monday.x3p tuesday.x3p --time 2026-11-23T08:00:00Z --every "1 day"
    """
    if not files:
        raise InputError("FILES is missing; see `microrelief ingest --help`")
    wishes = _wishes(len(files), time, every, zone, pitch_mm, unit, sigma_mm)
    opened = open_store(store, write=True) if store_exists(store) else None
    if opened is not None and (pitch_mm is not None or metric):
        opened.close()
        raise InputError(f"{store}: is there already: --pitch-mm and --metric are for a new store, leave them out")
    grid = opened.about.grid if opened is not None else None
    campaign = campaign_of(opened) if opened is not None else None
    usual = campaign.site.zone if campaign is not None else None
    try:
        scans: list[tuple[Path, Scan]] = []
        for number, file in enumerate(files):  # all before the first is kept: a wrong one costs nothing
            scan = _read(file, number, wishes, grid, usual)
            grid = scan.grid
            scans.append((file, scan))
        scans.sort(key=lambda each: each[1].time)
        if opened is None:
            opened = _create(store, [scan for _, scan in scans], metric)
        else:
            _check_steps(opened, scans)
            scans = _new(opened, scans)
        with closing(opened):
            rules = rules_of(None, opened)
            watches: Watches = resumed(rules.alarms, opened, rules.environment)
            reading = _reading(campaign, opened)
            for file, scan in scans:
                told, watches = _kept(opened, file, scan, rules, watches, reading)
                print(told, flush=True)
    finally:
        if opened is not None:
            opened.close()
    return 0


def _new(store: Store, scans: list[tuple[Path, Scan]]) -> list[tuple[Path, Scan]]:
    """Leave out, and name, the scans whose times the store has already."""
    there = set(scan_table(store).times.tolist())
    for file, scan in scans:
        if scan.time.item() in there:
            print(f"{file}: the scan of {format_instant(scan.time)} is there already, left alone")
    return [(file, scan) for file, scan in scans if scan.time.item() not in there]


def _wishes(
    count: int,
    time: str | None,
    every: str | None,
    zone: str | None,
    pitch_mm: float | None,
    unit: str | None,
    sigma_mm: float | None,
) -> Wishes:
    for option, value in (("--pitch-mm", pitch_mm), ("--sigma-mm", sigma_mm)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(f"{option} {value}: must be a positive number")
    if zone is not None:
        try:
            ZoneInfo(zone)
        except (ValueError, OSError, KeyError):
            raise InputError(f"--zone {zone}: is not a time zone: use a name like Europe/Berlin or UTC") from None
    if every is not None and time is None:
        raise InputError("--every needs --time, when the first file was measured")
    times: tuple[Instant, ...] = ()
    if time is not None:
        if count > 1 and every is None:
            raise InputError(
                f"--time is one time, but there are {count} files: give --every too, or one file at a time"
            )
        try:
            start = parse_instant(time, zone)
            step = np.timedelta64(parse_duration(every), "ns") if every is not None else np.timedelta64(0, "ns")
        except ValueError as error:
            raise InputError(f"--time {time}: {error}" if every is None else f"--time or --every: {error}") from None
        times = tuple(start + number * step for number in range(count))
    return Wishes(pitch_mm, unit, sigma_mm, times, zone)


def _read(file: Path, number: int, wishes: Wishes, grid: Grid | None, usual_zone: str | None) -> Scan:
    raster = read_raster(file, grid=grid, pitch_mm=wishes.pitch_mm, unit=wishes.unit)
    if raster.note:
        print(raster.note)
    if wishes.times:
        when = wishes.times[number]
    elif raster.time is not None:
        when = raster.time
    elif raster.local is not None:
        zone = wishes.zone or usual_zone
        if zone is None and raster.local.tzinfo is None:
            raise InputError(
                f"{file}: was measured at {raster.local:%Y-%m-%d %H:%M:%S}, but in which zone? Give --zone or --time"
            )
        local = raster.local
        when = instant(local if local.tzinfo is not None else local.replace(tzinfo=ZoneInfo(zone or "UTC")))
    else:
        raise InputError(f"{file}: does not say when it was measured: give --time")
    if grid is None and wishes.pitch_mm is not None:
        own = raster.grid
        rows, columns = (int((count - 1) * own.pitch_mm / wishes.pitch_mm + 1e-9) + 1 for count in own.shape)
        grid = Grid(rows, columns, wishes.pitch_mm, own.x0_mm, own.y0_mm)
    scan = scan_of(raster, file, when, grid)
    if not np.isfinite(scan.height).any():
        raise InputError(f"{file}: holds no measured cell")
    if wishes.sigma_mm is not None:
        unknown = np.isnan(scan.sigma) & np.isfinite(scan.height)
        scan = replace(scan, sigma=np.where(unknown, np.float32(wishes.sigma_mm), scan.sigma))
    return scan


def _check_steps(store: Store, scans: Sequence[tuple[Path, Scan]]) -> None:
    """Refuse surfaces that would be flat in this store's steps."""
    step = store.about.step_mm
    for file, scan in scans:
        spread = float(np.nanstd(scan.height))
        if 0 < spread < step:
            raise InputError(
                f"{file}: its heights vary by {spread * 1e6:.3g} nm, but {store.about.location} keeps steps of "
                f"{step * 1e6:g} nm: ingest it into a new store, whose steps will be finer"
            )


def _create(path: str, scans: Sequence[Scan], names: Sequence[str]) -> Store:
    from pipelines.change import METRICS as KNOWN

    names = names or METRICS
    for name in names:
        if name not in KNOWN:
            raise InputError(f"--metric {name}: no such metric{did_you_mean(name, list(KNOWN))}")
    return create_store(
        path,
        site=re.sub(r"[-_]+", " ", Path(path).stem),
        grid=scans[0].grid,
        metrics={name: KNOWN[name].unit for name in names},
        software=f"microrelief {__version__}",
        packing=fitting_packing(scans),
    )


def _reading(campaign: Campaign | None, store: Store) -> Reading | None:
    """Give the logger's file of the campaign, which knows the past; an address or a broker knows only the present."""
    environment = campaign.environment if campaign is not None else None
    if campaign is None or environment is None or environment.csv is None:
        return None
    if not set(environment.fields) <= set(store.about.metrics):
        return None
    return Reading(environment, make_sensor(environment, campaign.site.zone))


def _kept(
    store: Store, file: Path, scan: Scan, rules: Rules, watches: Watches, reading: Reading | None
) -> tuple[str, Watches]:
    """Work a scan out as a visit does, and keep it; say so, and what the alarms remember."""
    last = store[-1] if len(store) else None
    baseline = store[last.baseline].scan if last is not None else None
    notes = (Event(scan.time, "note", f"imported from {file.name}"),)
    finding = compare_with(baseline, scan, rules)
    air = reading.at(scan.time) if reading is not None else {}
    result = judged(finding, rules, watches, scan.time, notes, air=air)
    number = store.append(reading.beside(result.tick) if reading is not None else result.tick)
    rejected = f", not compared: {result.cause}" if result.cause else ""
    return f"committed scan {number} {format_instant(scan.time)} from {file}{rejected}", result.watches

"""Stored scans worked out again: frames to heights where frames are kept, change, metrics and alarms for all."""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from threading import Lock

from configs import Campaign, InputError, StoreError, parse_campaign
from pipelines import ENVIRONMENT, Calibration, Event, Instant, Measurement, Scan
from storage import Rework, ScanTable, Spread, Store, open_store

from . import __version__
from .alarms import Watches, after_gap, after_scan, gaps_in, remembered_at, seen_in, states_of, told
from .loop import BEGAN, ENDED
from .recipe import campaign_hash, campaign_rules, read_pattern_set
from .visit import Finding, Rules, compare_with, judged, make_scan, remarks

__all__ = ["Outcome", "campaign_of", "process", "rules_of"]

FROM_FRAMES = "from frames"
NO_FRAMES = "no frames are kept"
BATCH_CELLS = 4_000_000
"""A task is as many scans as hold so many cells, at most 16: handing over a small scan costs more than its work."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What was done: how many scans, by how they came about; and since which scan, if earlier work was taken up."""

    tally: Mapping[str, int]
    first: int
    last: int
    resumed_at: int | None = None
    snapshot: str = ""
    unchanged: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """What every worker needs to know; `calibration` replaces those that the scans were made with."""

    store: str
    snapshot: str
    rules: Rules
    baseline: Scan | None
    remake: range
    calibration: Calibration | None


@dataclass(frozen=True, slots=True, eq=False)
class Remade:
    """One scan worked out again; `outcome` says from what, `failure` why not from its frames."""

    number: int
    planned: Instant
    finding: Finding
    notes: tuple[Event, ...]
    outcome: str
    calibration: Calibration | None = None


def campaign_of(store: Store) -> Campaign | None:
    """Read the campaign that a store keeps; None where it was made without one.

    The files that it names (patterns, calibration) may be anywhere, and are not looked for: what they gave is in the
    store, and in its hash of the settings. Those that go on, such as a logger's, are looked for beside the store.

    Raises
    ------
    ConfigError
        If it is not one that this version knows.
    """
    about = store.about
    if not about.campaign.strip():
        return None
    beside = Path() if "://" in about.location else Path(about.location).parent
    return parse_campaign(about.campaign, f"{about.location} (its campaign)", beside)


def rules_of(given: Campaign | None, store: Store) -> Rules:
    """Give the rules of a campaign, or else of the store's own: the metrics of both, so no column is of other heights.

    Raises
    ------
    InputError
        If the campaign's cells are of another size than the store's, or a polygon holds no cell.
    """
    from pipelines.change import METRICS

    grid = store.about.grid
    if grid is None:
        raise StoreError(f"{store.about.location}: has no grid")
    kept = tuple(name for name in store.about.metrics if name in METRICS)
    campaign = given if given is not None else campaign_of(store)
    if campaign is None:
        return Rules(grid, metrics=kept, noise=store.about.noise, settings=store.about.campaign_hash)
    pitch = campaign.grid.pitch_mm
    if pitch is not None and abs(pitch - grid.pitch_mm) > 1e-9:
        raise InputError(
            f"grid.pitch_mm is {pitch:g}, but the store has cells of {grid.pitch_mm:g} mm: "
            "scans are made again on the store's own grid, leave it out"
        )
    metrics = tuple(dict.fromkeys((*campaign.metrics, *kept)))
    settings = store.about.campaign_hash if given is None else campaign_hash(given, read_pattern_set(given))
    return replace(campaign_rules(campaign, grid), metrics=metrics, noise=store.about.noise, settings=settings)


def process(
    store: Store,
    rules: Rules,
    spread: Spread,
    *,
    first: int,
    last: int,
    now: Instant,
    calibration: Calibration | None = None,
    campaign_text: str = "",
    baseline: bool = False,
    step: Callable[[int, int], None] = lambda done, total: None,
) -> Outcome:
    """Work scans `first` to `last` out again, and whatever depends on them, and make the results the newest at once.

    A scan whose frames are kept is made again from them, with the calibration that it was made with unless another is
    given; one without keeps its heights to the bit. Change, metrics and alarms of all follow. Scans after `last` are
    compared again only where their baseline is new. Results are the same for any number of workers; one committer
    writes them.

    Parameters
    ----------
    store : Store
        Open to write; read by the workers under its location.
    rules : Rules
    spread : Spread
        Where the work is done, see `storage.engine`.
    first, last : int
    now : Instant
        Time of the note that says what was done.
    calibration : Calibration, optional
    campaign_text : str
        Kept in the store instead of its campaign, where all scans are worked out by it.
    baseline : bool
        Begin an epoch with `first`: it becomes the baseline of those after it, through the next epoch's. Heights stay.
    step : callable
        Told of (scans done, scans in all).
    """
    from pipelines.change import METRICS

    count, calibration_id = len(store), calibration.id if calibration is not None else ""
    work = (
        __version__,
        rules.settings,
        calibration_id,
        first,
        last,
        campaign_text,
        *(["baseline"] if baseline else ()),
        *((rules.noise.id,) if rules.noise is not None else ()),
    )
    key = hashlib.sha256(json.dumps(work).encode()).hexdigest()[:16]
    rework = store.rework(key, first, {name: METRICS[name].unit for name in rules.metrics})  # type: ignore[attr-defined]
    if rework is None:
        return Outcome({}, first, last, snapshot=store.about.snapshot, unchanged=True)
    resumed_at = rework.next if rework.resumed else None
    starts, old_events = _chosen_epochs(store), _events_by_time(store)
    table = rework.table()
    gaps = gaps_in(store.events, table)
    watches: Watches = remembered_at(rules.alarms, table, gaps, rework.next, rework.alarms(), rules.environment)
    if baseline:
        starts.add(first)
    again = range(first, first) if baseline else range(first, last + 1)
    job = Job(store.about.location, store.about.snapshot, rules, None, again, calibration)
    while rework.next < count and not (rework.next > last and rework.settled):
        for remade in _until_epoch(job, rework, spread, starts, count):
            watches = after_gap(rules.alarms, watches, gaps[remade.number], "no scan")
            kept = _environment(table, remade.number)
            watches = _write(rework, remade, rules, old_events, remade.number in starts, watches, kept)
            step(rework.next - first, max(last + 1, rework.next) - first)
            if remade.number > last and rework.settled:
                break
    _judge_again(rework, rules, table, gaps, watches)
    text = f"scan {first} is the new baseline of those after it" if baseline else ""
    return _finish(rework, rules, first, last, now, calibration_id, campaign_text, count, resumed_at, text)


def remake(job: Job, numbers: range) -> list[Remade]:
    """Work some scans out again; runs in the workers."""
    with _one_at_a_time:
        return [_remake(job, _reader(job.store, job.snapshot), number) for number in numbers]


_one_at_a_time = Lock()
"""A cluster's worker may run several tasks in threads of one process; one scan alone uses all the cores that it may."""


@lru_cache(maxsize=1)
def _reader(location: str, snapshot: str) -> Store:
    store = open_store(location)
    if store.about.snapshot != snapshot:
        raise StoreError(f"{location}: is written by another meanwhile: stop that writer, and start again")
    return store


def _remake(job: Job, store: Store, number: int) -> Remade:
    stored = store[number]
    scan, used = stored.scan, None
    notes: tuple[Event, ...] = ()
    frames = store.frames(number) if number in job.remake else None
    if frames is None:
        outcome = NO_FRAMES if number in job.remake else "compared with a new baseline"
    else:
        used = job.calibration or store.calibration(scan.calibration_id)
        try:
            found = remarks(frames)
            scan, notes, outcome = make_scan(frames, used, job.rules), found, FROM_FRAMES
        except ValueError as error:  # CaptureError is one
            outcome = f"frames give no height map ({error})"
            used = None
    finding = compare_with(job.baseline, scan, job.rules)
    return Remade(number, stored.planned, finding, notes, outcome, used)


def _until_epoch(job: Job, rework: Rework, spread: Spread, starts: set[int], count: int) -> Iterator[Remade]:
    """Give scans worked out against the baseline of the next one, through the one that starts another epoch."""
    tail = rework.tail
    work = replace(job, baseline=rework.baseline())
    end = job.remake.stop if rework.next < job.remake.stop else count
    end = min([end, *(number for number in starts if number > rework.next)])
    size = max(1, min(16, BATCH_CELLS // (job.rules.grid.rows * job.rules.grid.columns)))
    # an epoch's first scan alone: the others wait for it
    alone = rework.next in starts or tail.count == 0
    stop = rework.next + 1 if alone else end
    batches = [range(start, min(start + size, stop)) for start in range(rework.next, stop, size)]
    results = spread(remake, work, batches)
    try:
        for batch in results:
            for remade in batch:
                yield remade
                if remade.number in starts or remade.finding.scan.calibration_id != tail.calibration_id:
                    return
    finally:
        close = getattr(results, "close", None)
        if close is not None:
            close()


def _environment(table: ScanTable, number: int) -> dict[str, Measurement]:
    """Give what was read beside a scan: no pipeline makes it anew."""
    pairs = {name: table.metrics[name] for name in ENVIRONMENT if name in table.metrics}
    return {name: Measurement(float(values[number]), float(sigmas[number])) for name, (values, sigmas) in pairs.items()}


def _write(
    rework: Rework,
    remade: Remade,
    rules: Rules,
    old: Mapping[int, tuple[Event, ...]],
    chosen: bool,
    watches: Watches,
    air: Mapping[str, Measurement],
) -> Watches:
    scan, notes = remade.finding.scan, remade.notes
    before = old.get(int(scan.time.astype("int64")), ())
    remade_heights = remade.outcome == FROM_FRAMES
    if not remade_heights:
        notes = tuple(event for event in before if event.kind == "note" and event.text.startswith("capture: "))
        if remade.outcome.startswith("frames give"):
            notes = (*notes, Event(scan.time, "note", f"processed again: heights kept, {remade.outcome}"))
    if chosen:
        said = tuple(event for event in before if event.kind == "epoch")
        begins = Event(
            scan.time, "epoch", f"epoch {rework.tail.epoch + 1} begins: scan {remade.number} was chosen as baseline"
        )
        notes = (*(said or (begins,)), *notes)
    of_the_loop = tuple(event for event in before if event.kind == "note" and event.text.startswith((BEGAN, ENDED)))
    notes = (*of_the_loop, *notes)  # they may share a scan's time: on a simulated clock, as `microrelief demo` has it
    finding = Finding(scan) if chosen else remade.finding
    result = judged(finding, rules, watches, remade.planned, notes, air=air)
    tick = replace(result.tick, calibration=remade.calibration, metrics={**result.tick.metrics, **air})
    outcome = (
        remade.outcome if remade_heights or not remade.outcome.startswith("frames") else "frames give no height map"
    )
    rework.write(tick, keep_heights=not remade_heights, outcome=outcome)
    return result.watches


def _judge_again(rework: Rework, rules: Rules, table: ScanTable, gaps: list[int], watches: Watches) -> None:
    """Judge the alarms of the scans that stay as they are: what they look back on has changed."""
    for number, seen in enumerate(seen_in(table, rework.next) if rules.alarms else (), start=rework.next):
        before = after_gap(rules.alarms, watches, gaps[number], "no scan")
        watches = after_scan(rules.alarms, before, seen, rules.environment)
        changes = told(rules.alarms, before, watches, seen.time, seen)
        states = states_of(rules.alarms, watches)
        rework.judge(number, seen.time, states, tuple(change.event for change in changes))


def _finish(
    rework: Rework,
    rules: Rules,
    first: int,
    last: int,
    now: Instant,
    calibration_id: str,
    campaign_text: str,
    count: int,
    resumed_at: int | None,
    text: str = "",
) -> Outcome:
    parts = ", ".join(f"{number} {outcome}" for outcome, number in rework.tally.items())
    text = (
        text
        or f"scans {first} to {last} processed again by microrelief {__version__}, settings {rules.settings or 'none'}"
    )
    text += f", calibration {calibration_id}" if calibration_id else ""
    text += f", levels of detection by noise model {rules.noise.id}" if rules.noise is not None else ""
    attributes = {}
    if campaign_text and first == 0 and last == count - 1:
        attributes = {"campaign": campaign_text, "campaign_hash": rules.settings}
    tally = dict(rework.tally)
    snapshot = rework.finish(Event(now, "note", f"{text}: {parts}"), attributes)
    return Outcome(tally, first, last, resumed_at, snapshot)


def _chosen_epochs(store: Store) -> set[int]:
    """Give the scans that somebody chose as a new baseline: an epoch begins there under the same calibration."""
    chosen = set()
    window = store.window()
    epochs, calibrations = window["epoch"].values, window["calibration"].values
    for number in range(1, len(epochs)):
        if epochs[number] != epochs[number - 1] and calibrations[number] == calibrations[number - 1]:
            chosen.add(number)
    return chosen


def _events_by_time(store: Store) -> dict[int, tuple[Event, ...]]:
    found: dict[int, list[Event]] = defaultdict(list)
    for event in store.events:
        found[int(event.time.astype("int64"))].append(event)
    return {time: tuple(events) for time, events in found.items()}

"""From a campaign to its loop: the one way in which `run`, `scan`, `video` and `demo` take and keep scans."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from threading import Event as Flag
from typing import Any

import numpy as np

from configs import Campaign
from pipelines import Instant, PatternSet
from storage import (
    Inbox,
    Ledger,
    Store,
    ledger_beside,
    network_file_system,
    room_of,
)

from .adaptive import pace_of
from .area_visit import AreaRig, area_work
from .campaign_store import create, grid_of, open_existing, plan_of, units
from .clock import Clock, RealClock
from .companions import Companion, Companions
from .environment import Reading, make_sensor
from .frame_pool import FramePool
from .health_log import HealthKeeper, HealthLog, health_file
from .items import Item, Visit
from .line import Line, Stage, ThreadedLine
from .loop import LayLine, Loop, Taker, counts, one_after_another
from .notify import notifier_of
from .recipe import campaign_hash, make_recipe, read_calibration, read_pattern_set, rig_of, stage_of
from .reporter import reporter_of
from .resume import resume_slots
from .rigs import Rig
from .scheduler import grace_of
from .settled import Outcome, Settled
from .slot_rules import slot_rules_of
from .steady_process import SteadyProcess
from .tiles import TileWalk
from .visit import Recipe, Work, visit
from .warm_up import warm_up

__all__ = ["UNTRUSTED", "run_campaign"]

UNTRUSTED = "locks and syncs of a network folder cannot be trusted; keep the store on a local disk or on S3"

UNHURRIED_S = 60.0
"""Visits this far apart have time to load and compile what they need; closer ones must find it ready."""


def run_campaign(
    campaign: Campaign,
    *,
    clock: Clock,
    rig: Rig | None = None,
    store: Store | None = None,
    ledger: Ledger | None = None,
    on_settled: Callable[[Settled], None] | None = None,
    on_wait: Callable[[Instant], None] | None = None,
    on_stage: Callable[[str], None] | None = None,
    max_scans: int | None = None,
    stop: Flag | None = None,
    text: str = "",
    now: bool = False,
    companions: Sequence[Companion] = (),
    work: Work[Any] = visit,
    lay: LayLine | None = None,
    on_worked: Callable[[Visit, int], None] | None = None,
) -> Outcome:
    """Run a campaign until its schedule is over, or something stops it.

    What is not handed in is made from the campaign, and closed at the end. A store that is there is continued.

    Parameters
    ----------
    campaign : Campaign
    clock : Clock
        Real, or accelerated.
    rig : Rig, optional
    store : Store, optional
    ledger : Ledger, optional
        Must be given with `store`.
    on_settled : callable, optional
        Told of each slot once it is settled and, where it gave a scan, that scan is durable.
    on_wait : callable, optional
        Told of the next slot before it is waited for.
    on_stage : callable, optional
        Told in words what is being done before the first visit (calibrating takes its time).
    max_scans : int, optional
        Stop after this many visits, whether or not each yields a scan.
    stop : threading.Event, optional
        Set it (from a signal) to finish the scan under way and begin no other.
    text : str
        The campaign file's text, kept in the store.
    now : bool
        One visit at once, whatever the schedule says (`microrelief scan`).
    companions : sequence of Companion
        Who else is told of each slot, and may say what is to be noted in the store.
    work : Work
        What makes a tick of a capture.
    lay : callable, optional
        How the stages are joined; without it side by side for video, one after another for all else.
    on_worked : callable, optional
        Told of each visit once it is worked out, before it is durable, and how many were under way.

    Returns
    -------
    Outcome

    Raises
    ------
    InputError
        The campaign asks for what cannot be (a calibration file that is not there, another grid than the store's).
    StoreError
        The store cannot be opened, or another process writes it.
    DeviceUnavailable
        The rig does not open at the start; once running, an absent device costs single visits only.
    """
    tell = on_stage or (lambda what: None)
    with ExitStack() as stack:
        patterns = read_pattern_set(campaign)
        handed = rig is not None
        remote = network_file_system(campaign.store.path)
        if remote is not None:
            tell(f"{campaign.store.path} lies on {remote}: {UNTRUSTED}")
        if store is None:  # before the slow and the physical: a store that cannot be written ends it here
            store = open_existing(campaign)
            if store is not None:
                stack.callback(store.close)
        if isinstance(clock, RealClock) and store is not None and len(store):
            clock.go_on_from(store[-1].scan.time + np.timedelta64(1, "ms"))
        if now or campaign.schedule.video is not None:
            clock = clock.steady()
        steady = stack.enter_context(closing(SteadyProcess())) if campaign.schedule.video is not None else None
        rig = rig_of(campaign, store) if rig is None else rig
        walk = _walk_of(campaign, rig, patterns, clock)
        calibration = read_calibration(campaign, patterns, clock.now(), tell)
        plan = plan_of(campaign, calibration, store)
        tell("opening the rig")
        devices = rig if walk is None else walk
        stack.callback(devices.close)
        devices.open()
        if store is None:
            store = create(campaign, calibration, patterns, text)
            stack.callback(store.close)
        if ledger is None:
            ledger = Ledger(ledger_beside(campaign.store.path, campaign.store.beside))
            stack.callback(ledger.close)
        ledger.reconcile(store)
        recipe = replace(make_recipe(campaign, patterns, calibration, grid_of(store)), noise=store.about.noise)
        if not (handed or now) and _hurried(campaign):
            tell("warming up")
            _warm_up(rig, campaign, recipe, clock.now(), work, tell)
            rig.close()
            rig = rig_of(campaign, store)  # a fresh one: what the other captured, and how often, does not count
            rig.open()
            stack.callback(rig.close)
        pace = pace_of(campaign, store)
        notifier = notifier_of(campaign, store, clock.now)
        keeper = HealthKeeper(rig, HealthLog(health_file(campaign)), campaign.exposure, plan is not None)
        reporter = reporter_of(campaign, store)
        along = Companions([each for each in (pace, notifier, keeper, reporter, *companions) if each is not None])
        stack.callback(along.close)

        def told(settled: Settled) -> None:
            along.settled(settled)
            if steady is not None:
                steady.after_scan()
            if on_settled is not None:
                on_settled(settled)

        environment = campaign.environment
        sensor = make_sensor(environment, campaign.site.zone) if environment is not None else None
        if sensor is not None:
            sensor.open()
            stack.callback(sensor.close)
        slots, last = resume_slots(campaign, ledger.rows(), clock.now(), now, pace)
        pool = FramePool()
        pool.lend_to(rig)
        taker: Taker = keeper
        let_go: Callable[[Any], None] = pool.let_go
        if walk is not None and plan is not None:
            taker, work = AreaRig(replace(walk, rig=keeper), plan, recipe, pool.let_go), area_work(plan)
            let_go = _nothing  # each tile's frames are let go at once
        loop = Loop(
            slots,
            lambda slot: grace_of(campaign, slots, slot),
            recipe,
            taker,
            store,
            ledger,
            clock,
            last,
            told,
            on_wait or (lambda slot: None),
            stop or Flag(),
            work=work,
            told=_provenance(campaign, patterns, store),
            notes=not now,
            rig_is_open=True,
            room=room_of(campaign.store.path, store.about.grid, len(store), campaign.store.reserve_mb).shortage,
            reading=Reading(environment, sensor) if environment is not None and sensor is not None else None,
            inbox=Inbox(campaign.store.path, campaign.store.beside),
            commit_every_s=campaign.schedule.video.commit_every_s if campaign.schedule.video is not None else 0.0,
            rules=slot_rules_of(campaign),
            asides=along.asides,
            lay=lay or _lay_of(campaign),
            on_worked=on_worked or (lambda visit, under_way: None),
            let_go=let_go,
        )
        return loop.run(max_scans)


def _walk_of(campaign: Campaign, rig: Rig, patterns: PatternSet, clock: Clock) -> TileWalk | None:
    """What goes from tile to tile; None where one field of view is followed."""
    area = campaign.area
    if area is None:
        return None

    def wait(seconds: float) -> None:
        clock.wait_until(clock.now() + np.timedelta64(round(seconds * 1e9), "ns"), Flag())  # a stop finishes the visit

    return TileWalk(area, rig, stage_of(area, rig), patterns, wait)


def _nothing(capture: Any) -> None:
    pass


def _lay_of(campaign: Campaign) -> LayLine:
    """How a campaign's stages are joined."""
    video = campaign.schedule.video
    return one_after_another if video is None else partial(_side_by_side, limit=video.most_under_way)


def _side_by_side(stages: Sequence[Stage[Item]], stop: Flag, limit: int) -> Line[Item]:
    return ThreadedLine(stages, limit, counts, stop.set)


def _hurried(campaign: Campaign) -> bool:
    every = campaign.schedule.every
    soon = campaign.schedule.video is not None or (every is not None and every.total_seconds() < UNHURRIED_S)
    return soon and campaign.area is None  # no stage is moved for what counts for nothing


def _warm_up(
    rig: Rig,
    campaign: Campaign,
    recipe: Recipe,
    at: Instant,
    work: Work[Any],
    tell: Callable[[str], None],
) -> None:
    """Warm up; a recording begins without, rather than not at all."""
    try:
        warm_up(rig, recipe, units(campaign), campaign.store.kind, at, work)
    except Exception as error:  # noqa: BLE001 - what fails here fails in the visits too, and is recorded there
        tell(f"not warmed up, the first scans may be late: {type(error).__name__}: {error}")


def _provenance(campaign: Campaign, patterns: PatternSet, store: Store) -> str:
    """Say which settings the scans to come are made with, and whether they are those of the store's beginning."""
    settings, first = campaign_hash(campaign, patterns), store.about.campaign_hash
    noise = store.about.noise
    return (
        f"settings {settings}"
        + (f", changed since the store was made with {first}" if settings != first else "")
        + (f", levels of detection by noise model {noise.id}" if noise is not None else "")
    )

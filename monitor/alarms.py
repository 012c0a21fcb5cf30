"""The alarms of a campaign, from visit to visit: what each remembers, where it stands, and what is told of it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from configs import Alarm, Environment
from pipelines import AlarmChange, AlarmState, Event, Instant, Measurement, standing_alarms, unit_text, with_uncertainty
from pipelines.trends import AlarmRule, Limits, Watch, aired, remembered, silent, watched
from storage import ScanTable, Store, scan_table

__all__ = [
    "Seen",
    "Watches",
    "after_gap",
    "after_scan",
    "explained",
    "gaps_in",
    "resumed",
    "rule_of",
    "seen_in",
    "states_of",
    "told",
]

Watches = Mapping[str, Watch]
"""What each alarm remembers, by its name."""

UNKNOWN = Measurement(float("nan"), float("nan"))
NEW_BASELINE = "a new baseline: what follows is measured against it"


@dataclass(frozen=True, slots=True)
class Seen:
    """What alarms see of one scan: its metrics, with what the environment was beside them.

    `verdict` is that of its registration, empty for a baseline.
    """

    time: Instant
    verdict: str
    metrics: Mapping[str, Measurement]
    reason: str = ""


def rule_of(alarm: Alarm, air: Environment | None = None) -> AlarmRule:
    """Give an alarm's rule in an environment. Raises ValueError where its limits leave no value that is ok."""
    from pipelines.change import METRICS

    metric = METRICS.get(alarm.metric)
    value = (alarm.warn_above, alarm.alarm_above, alarm.warn_below, alarm.alarm_below)
    rate = (
        alarm.warn_rate_above_per_day,
        alarm.alarm_rate_above_per_day,
        alarm.warn_rate_below_per_day,
        alarm.alarm_rate_below_per_day,
    )
    return AlarmRule(
        limits=Limits(*value) if any(limit is not None for limit in value) else None,
        rate=Limits(*rate) if any(limit is not None for limit in rate) else None,
        window_days=alarm.window_days,
        within_days=alarm.within_days,
        chart=alarm.chart,
        model=alarm.chart_model or "level",
        false_alarm_every=alarm.false_alarm_every_scans or 400.0,
        drivers=tuple(air.fields) if air is not None and alarm.chart is not None else (),
        max_lag_hours=air.max_lag_hours if air is not None else 0.0,
        confirm=alarm.confirm,
        clear_by=alarm.clear_by,
        no_data_after=alarm.no_data_after_slots,
        unit=unit_text(metric.unit) if metric is not None else alarm.unit or "",
    )


def explained(alarm: Alarm, air: Environment | None = None) -> str:
    """Say an alarm in one line, as `run --dry-run` and `doctor` do."""
    from dashboards import rule_words
    from pipelines.change import METRICS

    unit = unit_text(METRICS[alarm.metric].unit)
    limits = []
    for name, value in (
        ("warning above", alarm.warn_above),
        ("alarm above", alarm.alarm_above),
        ("warning below", alarm.warn_below),
        ("alarm below", alarm.alarm_below),
    ):
        if value is not None:
            limits.append(f"{name} {value:g} {unit}".rstrip())
    taken_out = [f"{' and '.join(air.fields)} taken out"] if air is not None and alarm.chart is not None else []
    return f"{alarm.name} ({alarm.metric}): {'; '.join((*limits, *rule_words(alarm.model_dump()), *taken_out))}"


def states_of(alarms: Sequence[Alarm], watches: Watches) -> dict[str, AlarmState]:
    """Where each alarm stands."""
    return {alarm.name: watches[alarm.name].state if alarm.name in watches else "ok" for alarm in alarms}


def after_scan(
    alarms: Sequence[Alarm], before: Watches, scan: Seen, air: Environment | None = None
) -> dict[str, Watch]:
    """Judge the alarms by a scan.

    A baseline begins anew. A scan whose registration is doubtful or failed raises and clears nothing: it is a slot
    without a value, of which enough in a row are "no data".
    """
    after = {}
    quantities = {name: measurement.value for name, measurement in scan.metrics.items()}
    for alarm in alarms:
        rule = rule_of(alarm, air)
        watch = aired(rule, before.get(alarm.name, Watch()), scan.time, quantities)
        if not scan.verdict:
            after[alarm.name] = Watch()
        elif scan.verdict != "good":
            cause = f"registration {scan.verdict}" + (f": {scan.reason}" if scan.reason else "")
            after[alarm.name] = silent(rule, watch, 1, cause)
        else:
            value = scan.metrics.get(alarm.metric, UNKNOWN)
            after[alarm.name] = watched(rule, watch, scan.time, value.value, value.sigma)
    return after


def after_gap(alarms: Sequence[Alarm], before: Watches, slots: int, cause: str) -> dict[str, Watch]:
    """Let slots pass that gave no scan."""
    return {alarm.name: silent(rule_of(alarm), before.get(alarm.name, Watch()), slots, cause) for alarm in alarms}


def told(
    alarms: Sequence[Alarm], before: Watches, after: Watches, time: Instant, scan: Seen | None = None
) -> tuple[AlarmChange, ...]:
    """What is told: one change for each alarm that stands elsewhere than before; a first state other than ok is one."""
    changes = []
    for alarm in alarms:
        old, new = before.get(alarm.name, Watch()).state, after[alarm.name]
        if new.state == old:
            continue
        words = [new.why] if new.why else []
        value = scan.metrics.get(alarm.metric) if scan is not None and scan.verdict == "good" else None
        if value is not None:
            words.insert(0, f"{alarm.metric.replace('_', ' ')} {_with_unit(alarm.metric, value)}")
        elif scan is not None and not scan.verdict:
            words.append(NEW_BASELINE)
        changes.append(AlarmChange(time, alarm.name, old, new.state, ", ".join(words)))
    return tuple(changes)


def _with_unit(metric: str, measurement: Measurement) -> str:
    from pipelines.change import METRICS

    return with_uncertainty(measurement, METRICS[metric].unit)


def resumed(alarms: Sequence[Alarm], store: Store, air: Environment | None = None) -> dict[str, Watch]:
    """What each alarm remembers after all that a store holds: as if it had been watched from its baseline on.

    Past values are taken in, not judged: where an alarm stands is what the store says of it.
    """
    if not alarms:
        return {}
    table = scan_table(store)
    gaps = gaps_in(store.events, table)
    newest: dict[str, AlarmState] = store[-1].alarms if len(table) else {}
    standing = standing_alarms(newest, table.times[-1] if len(table) else None, store.events)
    first = len(table) - int((table.epochs == table.epochs[-1]).sum()) if len(table) else 0
    watches = {
        alarm.name: _remembered(rule_of(alarm, air), alarm.metric, table, gaps, first, len(table)) for alarm in alarms
    }
    for name, watch in watches.items():
        if name in standing:
            watches[name] = replace(watch, state=standing[name].state, why=standing[name].why)
    return watches


def _remembered(rule: AlarmRule, metric: str, table: ScanTable, gaps: Sequence[int], first: int, stop: int) -> Watch:
    """Take in the values of the scans of one epoch, from its baseline to before `stop`, and the gaps after each."""
    watch = Watch()
    values, sigmas = table.metrics.get(metric, (None, None))
    for number in range(first, stop):
        if table.verdicts[number]:
            air = {name: float(table.metrics[name][0][number]) for name in rule.drivers if name in table.metrics}
            watch = aired(rule, watch, table.times[number], air)
        if table.verdicts[number] == "good" and values is not None and sigmas is not None:
            value, sigma = float(values[number]), float(sigmas[number])
            watch = remembered(rule, watch, table.times[number], value, sigma)
        elif table.verdicts[number]:
            watch = replace(watch, silent=watch.silent + 1)
        if gaps[number + 1]:
            watch = replace(watch, silent=watch.silent + gaps[number + 1])
    return watch if len(table) else replace(watch, silent=gaps[0])


def remembered_at(
    alarms: Sequence[Alarm],
    table: ScanTable,
    gaps: Sequence[int],
    number: int,
    states: Mapping[str, AlarmState],
    air: Environment | None = None,
) -> dict[str, Watch]:
    """What each alarm remembers before scan `number`, where the scan before left them in `states`."""
    if not number:
        return {}
    first = int((table.epochs[:number] != table.epochs[number - 1]).sum())
    # the gap after the last scan is let pass by whoever goes on from here
    held = [*gaps[:number], 0]
    return {
        alarm.name: replace(
            _remembered(rule_of(alarm, air), alarm.metric, table, held, first, number),
            state=states.get(alarm.name, "ok"),
        )
        for alarm in alarms
    }


def gaps_in(events: Iterable[Event], table: ScanTable) -> list[int]:
    """Count the slots without a scan before each scan, and after the last: shape (scans + 1,)."""
    import numpy as np

    scans = set(table.times.astype(np.int64).tolist())
    gaps = [0] * (len(table) + 1)
    for event in events:
        # a scan that was rejected is a scan: its event has its time
        if event.kind in ("failed", "missed", "rejected") and int(event.time.astype(np.int64)) not in scans:
            gaps[int(np.searchsorted(table.times, event.time))] += _slots(event)
    return gaps


def _slots(event: Event) -> int:
    """How many slots an event is about: ``missed 4 slots, FIRST to LAST: cause``, ``2 not stored, ...``, or one."""
    count = re.match(r"missed (\d+) slots?, |(\d+) not stored, ", event.text)
    return int(count[1] or count[2]) if count is not None else 1


def seen_in(table: ScanTable, first: int = 0) -> Iterator[Seen]:
    """Give what alarms saw of the scans of a table, from one of them on."""
    for number in range(first, len(table)):
        metrics = {
            name: Measurement(float(values[number]), float(sigmas[number]))
            for name, (values, sigmas) in table.metrics.items()
        }
        yield Seen(table.times[number], table.verdicts[number], metrics)

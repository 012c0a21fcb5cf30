"""What a campaign will do: the coming visits, and the disk that they take. Needs neither rig nor store."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np

from configs import Campaign, InputError, format_duration
from pipelines import Instant, PatternSet, as_datetime, format_instant
from storage import BYTES_PER_CELL, used_bytes

from .alarms import explained
from .area_forecast import SIMULATED_MM, area_lines, foreseen
from .environment import source_of
from .outputs import nearest_there
from .recipe import read_pattern_set, simulated_calibration_file
from .resume import resume_point
from .scheduler import Slots, grace_of, slots_between

__all__ = ["bytes_per_scan", "forecast_lines", "full_on", "next_slots", "stored_bytes"]

SHOWN = 6
DAY = np.timedelta64(86400 * 10**9, "ns")
CENTURY_DAYS = 36525


def forecast_lines(campaign: Campaign, now: Instant) -> list[str]:
    """Tell what `run` would do from `now` on.

    Raises
    ------
    InputError
        If a file that the campaign names is not there.
    """
    patterns = read_pattern_set(campaign)
    slots, last = resume_point(campaign, now)
    coming = next_slots(slots, max(last, now - np.timedelta64(1, "ns")), SHOWN)
    lines = [f"{campaign.site.name}: {_schedule(campaign)}, rig {campaign.rig.name}, {patterns_told(patterns)}"]
    zone = ZoneInfo(campaign.site.zone)
    for slot in coming:
        local = f" ({as_datetime(slot).astimezone(zone):%a %H:%M %Z})" if campaign.site.zone != "UTC" else ""
        lines.append(f"  scan due {format_instant(slot)}{local}")
    if not coming:
        lines.append("  no scan is due: the schedule is over")
    else:
        grace = format_seconds(grace_of(campaign, slots, coming[0]))
        lines.append(f"  a scan may begin {grace} late, then it is missed")
    lines += _rates(campaign)
    if campaign.area is not None:
        lines += area_lines(campaign.area, campaign, patterns, coming)
    lines += _disk(campaign, patterns, slots, now)
    lines.append(_calibration(campaign, patterns))
    lines += [f"  alarm {explained(alarm, campaign.environment)}" for alarm in campaign.alarms]
    if campaign.environment is not None:
        lines.append(f"  environment {', '.join(campaign.environment.fields)} from {source_of(campaign.environment)}")
    return lines


def next_slots(slots: Slots, after: Instant, count: int) -> list[Instant]:
    """Give the first `count` slots later than `after`."""
    return list(islice(slots_between(slots, after, after + 3650 * DAY), count))


def bytes_per_scan(campaign: Campaign, patterns: PatternSet) -> tuple[float, bool]:
    """Give what a scan takes on the disk, bytes, and whether that was measured on this campaign's store."""
    raw = 0.0
    columns, rows = camera_size(campaign)
    if campaign.retain.raw_frames != "off":
        raw = columns * rows * len(patterns.roles) * 0.6
    measured = stored_bytes(campaign.store.path)
    if measured is not None:
        return measured, True
    cells = columns * rows * 1.3  # the footprint is wider than the image of its middle, at the pixel's own pitch
    plan = foreseen(campaign.area, campaign, patterns) if campaign.area is not None else None
    if plan is not None:
        cells = float(plan.grid.rows * plan.grid.columns)
    elif campaign.grid.pitch_mm is not None and campaign.rig.name == "simulated":
        cells = SIMULATED_MM[0] * SIMULATED_MM[1] / campaign.grid.pitch_mm**2
    return cells * BYTES_PER_CELL + raw, False


def camera_size(campaign: Campaign) -> tuple[int, int]:
    """Give the camera's columns and rows as the rig's options say, or the paper's 2560x1440."""
    size = campaign.rig.options.get("camera", (960, 720) if campaign.rig.name == "simulated" else (2560, 1440))
    if isinstance(size, Sequence) and len(size) == 2:
        return int(size[0]), int(size[1])
    return 2560, 1440


def stored_bytes(store: str | Path) -> float | None:
    """Give the mean bytes per scan of a store on this machine; None where there is none, or no scan in it."""
    store = Path(store)
    if not store.is_dir():
        return None
    from storage import open_store

    count = len(open_store(store))
    return used_bytes(store) / count if count else None


def patterns_told(patterns: PatternSet) -> str:
    """Tell a pattern set in a few words."""
    return f"{len(patterns.roles)} {patterns.kind} frames for a {patterns.size[0]}x{patterns.size[1]} projector"


def format_seconds(seconds: float) -> str:
    """Write a length of time in the largest fitting units."""
    from datetime import timedelta

    return format_duration(timedelta(seconds=seconds))


def format_bytes(count: float) -> str:
    """Write a number of bytes: 3.2 MB."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def _schedule(campaign: Campaign) -> str:
    schedule = campaign.schedule
    if schedule.video is not None:
        length = f" for {format_duration(schedule.video.for_)}" if schedule.video.for_ is not None else ""
        return f"video at {schedule.video.rate_hz:g} Hz{length}"
    if schedule.cron is not None:
        text = f"cron {schedule.cron!r} in {campaign.site.zone}"
    else:
        assert schedule.every is not None
        text = f"every {format_duration(schedule.every)}"
    if schedule.within is not None:
        keys = schedule.within.model_dump(mode="json", exclude_defaults=True)
        text += " within " + " and ".join(
            name if name == "daylight" else f"{name} {value}" for name, value in keys.items()
        )
    return text


def _rates(campaign: Campaign) -> list[str]:
    """Say between which bounds the rate follows the alarms."""
    rule, every = campaign.schedule.adaptive, campaign.schedule.every
    if rule is None or every is None:
        return []
    cause = f"{', '.join(rule.alarms) or 'any alarm'} is in {rule.raise_on}"
    text = f"  rate: every {format_duration(rule.burst)} while {cause}"
    if rule.calm is not None:
        text += f", every {format_duration(rule.calm)} in a long calm"
    return [f"{text}; {rule.calm_after} scans without cause lower it by a step"]


def _disk(campaign: Campaign, patterns: PatternSet, slots: Slots, now: Instant) -> list[str]:
    size, measured = bytes_per_scan(campaign, patterns)
    per_day = size * _per_day(campaign, slots, now)
    if campaign.schedule.video is not None:
        text = f"  disk: {format_bytes(per_day / 24)} an hour"
    else:
        text = f"  disk: {format_bytes(per_day)} a day"
    text += f" ({format_bytes(size)} a scan, {'as measured in the store' if measured else 'estimated'})"
    if not isinstance(campaign.store.path, Path):
        return [text]
    free = shutil.disk_usage(nearest_there(campaign.store.beside)).free
    if per_day > 0:
        text += f"; {format_bytes(free)} free, enough for {_long(free / per_day)}"
    lines = [text]
    full = full_on(campaign, now, free, per_day)
    if full is not None:
        lines.append(f"  the disk is full on {format_instant(full)[:10]}")
    rule, every = campaign.schedule.adaptive, campaign.schedule.every
    if rule is not None and every is not None and per_day > 0:
        often = per_day * (every / rule.burst)
        full = full_on(campaign, now, free, often)
        day = f", and it is full on {format_instant(full)[:10]}" if full is not None else ""
        lines.append(f"  in a burst that lasts: {format_bytes(often)} a day{day}")
    return lines


def _long(days: float) -> str:
    """Give a length of time as people say it: days, then years, and no more than a century."""
    if days < 10:
        return f"{days:.1f} days"
    years = days / 365.25
    return f"{days:.0f} days" if years < 2 else f"{years:.0f} years" if years < 100 else "more than a century"


def full_on(campaign: Campaign, now: Instant, free: float, per_day: float) -> Instant | None:
    """Give the day the disk is full; None where the schedule ends before, or a century goes by."""
    if per_day <= 0 or not free / per_day < CENTURY_DAYS:
        return None
    full: Instant = now + np.timedelta64(round(free / per_day * 86400), "s")
    return full if campaign.until is None or as_datetime(full) < campaign.until else None


def _per_day(campaign: Campaign, slots: Slots, now: Instant) -> float:
    """Slots a day, in the mean of the next four weeks; of very many those of one day are counted, or reckoned."""
    schedule = campaign.schedule
    if schedule.video is not None:
        return schedule.video.rate_hz * 86400
    every = schedule.every.total_seconds() if schedule.every is not None else 60.0
    if every < 60 and schedule.within is None:
        return 86400 / every
    days = 28 if every >= 60 else 1
    return sum(1 for _ in slots_between(slots, now, now + days * DAY)) / days


def _calibration(campaign: Campaign, patterns: PatternSet) -> str:
    file = campaign.calibration.file
    if file is None:
        kept = simulated_calibration_file(campaign, patterns)
        return f"  calibration: {'kept in ' + kept.name if kept.exists() else 'the first run makes it (simulated rig)'}"
    if not file.is_file():
        raise InputError(
            f"no calibration {file}: make it with "
            f"`microrelief calibrate POSE_DIR... --board COLUMNSxROWS --square-mm MM --out {file}`"
        )
    return f"  calibration: {file}"

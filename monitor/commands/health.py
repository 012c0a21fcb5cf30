"""The command `health`."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from configs import InputError
from pipelines import format_instant
from pipelines.trends import Trend

from ..check import load_checked
from ..health_log import Health, HealthLog, health_file, lamp_trends

__all__ = ["health"]

SHOWN = 5
LOOKED_AT = 2000
WORDS = {"lamp": "lamp's light for the same exposure", "dark": "dark against white (dust, stray light)"}


def health(campaign: Path, *, as_json: Annotated[bool, Parameter(name="--json", negative="")] = False) -> int:
    """Say how a campaign's rig is: timings, exposure and light of its newest visits, and how lamp and lens age.

    Visits that failed or were rejected are there too.

    Parameters
    ----------
    campaign
        Campaign file.
    as_json
        Print JSON: the newest visits, and trends as a part per day with their 95 % interval.

    Examples
    --------
    microrelief health soil.yaml
    """
    visits = HealthLog(health_file(load_checked(campaign).campaign)).newest(LOOKED_AT)
    if not visits:
        raise InputError(f"{campaign}: nothing is known of its health yet: `microrelief run` keeps it with each visit")
    trends = lamp_trends(visits)
    if as_json:
        told = [{name: _json(value) for name, value in asdict(each).items()} for each in visits[-SHOWN:]]
        lines = {name: {"per_day": t.slope_per_day, "low": t.low, "high": t.high} for name, t in trends.items()}
        print(json.dumps({"visits": told, "trends": lines}, indent=1))
        return 0
    print("\n".join([*(_line(each) for each in visits[-SHOWN:]), *(_trend(name, t) for name, t in trends.items())]))
    return 0


def _line(each: Health) -> str:
    parts = [f"{format_instant(each.time)} {each.state}"]
    for text, value, form in (
        ("late", each.lag_s, "{:.3f} s"),
        ("capture", each.capture_s, "{:.2f} s"),
        ("work", each.work_s, "{:.2f} s"),
        ("worked out after", each.latency_s, "{:.2f} s"),
        ("exposure", each.exposure_ms, "{:.2f} ms"),
        ("light", each.light, "{:.0%}"),
        ("saturated", each.saturated, "{:.2%}"),
        ("temperature", each.temperature_c, "{:.1f} °C"),
    ):
        if math.isfinite(value):
            parts.append(f"{text} {form.format(value)}")
    parts += [f"registration {each.verdict}"] if each.verdict else []
    return ", ".join([*parts, *([f"{each.dropped} dropped after it"] if each.dropped else [])])


def _trend(name: str, line: Trend) -> str:
    month = [f"{30 * value:+.2%}" for value in (line.slope_per_day, line.low, line.high)]
    sure = "" if line.significant else ", no trend is certain"
    return f"{WORDS[name]}: {month[0]} a month (95 %: {month[1]} to {month[2]}{sure})"


def _json(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value

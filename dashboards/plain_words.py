"""What happened to the surface, in words for somebody who has never seen a height map."""

from __future__ import annotations

import numpy as np

from pipelines import Measurement
from pipelines.trends import trend

from .findings import Findings
from .metric_names import Named
from .quantities import day_and_time, span, with_uncertainty

__all__ = ["in_plain_words", "said_of_volume"]

_TOLD = {
    "crack_opening": ("The cracks are {size} wide on average", "They are still opening.", "They are closing."),
    "edge_lift": (
        "The edges along the cracks have {lifted|sunk} by {size}",
        "They are still lifting.",
        "They are sinking.",
    ),
}
"""Metrics that a sentence can tell: what they say, and what goes on where the newer half rises or falls."""


def in_plain_words(findings: Findings) -> tuple[str, ...]:
    """Say how long the surface was watched, what it lost or gained, what opened and lifted, and whether that goes on.

    Only what is larger than its own uncertainty (95 %) is told as something that happened.
    """
    if findings.last is None or not len(findings.times):
        return ()
    first, last = findings.times[0], findings.times[-1]
    missed = sum(visit.state != "taken" for visit in findings.visits)
    gaps = {0: "no planned visit was lost", 1: "one planned visit gave none"}.get(
        missed, f"{missed} planned visits gave none"
    )
    scans = "1 scan" if findings.scans == 1 else f"{findings.scans} scans"
    watched = f"Watched for {span(last - first)}" if last > first else "Watched once"
    told = [f"{watched}, until {day_and_time(last)}: {scans}, {gaps}."]
    named = {metric.name: metric for metric in findings.metrics}
    if "net_volume" in named:
        told += said_of_volume(findings.newest("net_volume"), "since the first scan")
    for name in _TOLD:
        if name in named:
            told += _grown(findings, named[name])
    if len(told) > 1:
        told.append("Behind ± stands one standard uncertainty: two in three true values lie within it.")
    return tuple(told)


def said_of_volume(volume: Measurement, since: str) -> list[str]:
    """Say what a net volume means; nothing where it was not measured."""
    if not np.isfinite(volume.value):
        return []
    if not abs(volume.value) > 1.96 * volume.sigma:
        return [f"As much material rose as sank {since}, as far as the scans can tell."]
    size = with_uncertainty(Measurement(abs(volume.value), volume.sigma), "mm3")
    balance = "More material sank or went than rose" if volume.value < 0 else "More material rose or came than sank"
    return [f"{balance} {since}: {size} in balance."]


def _grown(findings: Findings, metric: Named) -> list[str]:
    """Say how large something is, and whether it still moves."""
    newest = findings.newest(metric.name)
    if not np.isfinite(newest.value):
        return []
    sentence, rising, falling = _TOLD[metric.name]
    up, _, down = sentence.partition("{")[2].partition("}")[0].partition("|")
    if down:
        if not abs(newest.value) > 1.96 * newest.sigma:
            return [f"{sentence.partition(' have')[0]} have not moved, as far as the scans can tell."]
        sentence = sentence.replace(f"{{{up}|{down}}}", up if newest.value > 0 else down)
    size = with_uncertainty(Measurement(abs(newest.value), newest.sigma), metric.unit)
    since = findings.since_baseline
    values, sigmas = (array[since] for array in findings.measured(metric.name))
    half = len(values) // 2
    recent = trend(findings.times[since][half:], values[half:], sigmas[half:])
    onward = ""
    if np.isfinite(recent.slope_per_day):
        onward = " No movement is certain in the newer half of the scans."
        if recent.significant:
            onward = f" {rising if recent.slope_per_day > 0 else falling}"
    return [f"{sentence.format(size=size)}.{onward}"]

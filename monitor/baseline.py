"""Baseline: what a first scan must be worth before all others are compared with it."""

from __future__ import annotations

from pipelines import Event, Scan

__all__ = ["unfit"]

LEAST_COVERAGE = 0.1
"""Part of the grid. The grid is laid over all that the camera sees at the reference plane, so even a small sample in
the middle of the image covers more; a lens cap that was left half on, or a projector that is not yet warm, does not."""


def unfit(scan: Scan, events: tuple[Event, ...] = ()) -> str:
    """Say why a scan cannot be the baseline of an epoch; empty where it can.

    Parameters
    ----------
    scan : Scan
    events : tuple of Event
        Of its tick. A capture that `diagnose` would use with care only is good enough to be compared, not to be
        compared with.
    """
    if scan.coverage < LEAST_COVERAGE:
        return (
            f"not good enough for a baseline: {scan.coverage:.0%} of the grid was measured, {LEAST_COVERAGE:.0%} are "
            "needed; mend what hides the sample, or give a smaller grid"
        )
    doubts = [event.text for event in events if event.kind == "note" and event.text.startswith("capture: ")]
    return f"not good enough for a baseline: {doubts[0]}" if doubts else ""

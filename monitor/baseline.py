"""Baseline: what a first scan must be worth before all others are compared with it."""

from __future__ import annotations

from pipelines import Event, Scan

__all__ = ["unfit"]

DISTURBED = ("moved", "ambient", "interrupted")
"""Causes of `diagnose` that moved heights in this one capture: a later one is free of them. The others that it flags
(saturation, faint light, lamp flicker, blur) are the rig's and the sample's own: the next capture has them too, they
cost cells and sigma and move no height, and to wait for them to go would be to wait for ever. Faults of the frames'
order are rejected anyway."""


def unfit(scan: Scan, events: tuple[Event, ...] = ()) -> str:
    """Say why a scan cannot be the baseline of an epoch; empty where it can.

    How much of the grid was measured does not count, as long as registration can hold on to it: a small sample in a
    large image covers little in every scan (docs/decisions/0024).

    Parameters
    ----------
    scan : Scan
    events : tuple of Event
        Of its tick. A capture that was disturbed is good enough to be compared, not to be compared with.
    """
    import numpy as np

    from pipelines.change import LEAST_CELLS
    from pipelines.reconstruction import CAUSES

    cells = int(np.count_nonzero(np.isfinite(scan.height)))
    if cells < min(LEAST_CELLS, scan.height.size):  # a grid of still fewer cells must be measured whole
        return (
            f"not good enough for a baseline: {cells} cells of the grid were measured, no later scan could be "
            f"registered to fewer than {LEAST_CELLS}; mend what hides the sample, or give a finer grid"
        )
    told = tuple(f"capture: {CAUSES[cause].title}" for cause in DISTURBED)
    doubts = [event.text for event in events if event.kind == "note" and event.text.startswith(told)]
    return f"not good enough for a baseline: {doubts[0]}" if doubts else ""

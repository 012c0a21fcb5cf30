"""Maps: what the surface looks like, and where it changed."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipelines import Change

from ..findings import Findings
from ..maps import Outlines, camera_picture, change_map, height_map, rate_map
from ..places import Polygon
from ..quantities import day_and_time, plain
from ..raster import change_limit, height_ends
from ..section import Figure, Section

__all__ = ["maps"]


def maps(findings: Findings) -> Section | None:
    """Show heights at the baseline and now, and a strip of changes, each kind on one scale."""
    first, last = findings.first, findings.last
    if first is None or last is None:
        return None
    text = [
        "Seen from the camera, x to the right and y upwards. In a height map dark is low and yellow is high, in mm "
        "above the reference plane."
    ]
    outlines, said = _outlines(findings)
    text += said
    heights = [first, last] if last.number != first.number else [last]
    span = height_ends(np.concatenate([stored.scan.height.ravel() for stored in heights]))
    figures = [
        Figure(
            height_map(
                stored.scan, span, f"Height map of scan {stored.number}, {day_and_time(stored.scan.time)}.", outlines
            ),
            f"Height, scan {stored.number}{' (baseline)' if stored.number == first.number else ''}, "
            f"{day_and_time(stored.scan.time)}",
        )
        for stored in heights
    ]
    figures.append(
        Figure(
            camera_picture(last.scan, f"The camera's picture of scan {last.number}."),
            f"What the camera saw, scan {last.number}, {day_and_time(last.scan.time)}",
        )
    )
    moved = [stored for stored in findings.between if stored.epoch == last.epoch and stored.change is not None]
    if moved:
        text.append(
            "A change map shows how far each spot has moved since the baseline: blue came towards the camera, red sank "
            "away. Spots whose change is smaller than what the scans can tell (their level of detection) stay pale; "
            "the two ends of the scale also stand for more."
        )
        limit = change_limit(np.concatenate([each.change.dz.ravel() for each in moved if each.change is not None]))
        for stored in moved:
            change = stored.change
            assert change is not None  # filtered above
            share, measured_by = _how_much(change)
            words = f"Change, scan {stored.number}, {day_and_time(stored.scan.time)}: {share}"
            figures.append(Figure(change_map(stored.scan, change, limit, f"{words}.", outlines), words + measured_by))
    rates = findings.rates
    if rates is not None:
        text.append(
            f"The map of rates fits a straight line through {rates.scans} well registered scans since the baseline at "
            "each spot; spots whose rate may be chance (95 %) stay pale."
        )
        limit_per_day = change_limit(rates.rate)
        sure = 100 * float((np.abs(rates.rate) > 1.96 * rates.sigma).sum()) / max(int(np.isfinite(rates.rate).sum()), 1)
        typical = float(np.nanmedian(rates.sigma))
        words = f"Rate per day: {plain(sure, 3)}\N{NO-BREAK SPACE}% of the spots move for certain"
        figures.append(
            Figure(
                rate_map(last.scan, rates.rate, rates.sigma, limit_per_day, f"{words}.", outlines),
                f"{words} (standard uncertainty {plain(1000 * typical, 2)} µm per day in the median)",
            )
        )
    return Section("maps", "Height and change maps", text=tuple(text), figures=tuple(figures))


def _outlines(findings: Findings) -> tuple[Outlines, list[str]]:
    """Give the polygons that are drawn on maps, and what is to be said of them."""
    places, asked = findings.places, findings.region
    counted = asked.corners if asked is not None else places.region
    said = []
    if asked is not None:
        said.append("The outline is the region that this report is about.")
    elif counted:
        said.append("The outline is the campaign's region: what lies inside counts in its metrics.")
    if places.stable:
        said.append("Dashed lines go around what holds still, by which scans are laid on each other.")
    outlines: list[tuple[Literal["region", "stable"], Polygon]] = [("stable", each) for each in places.stable]
    if counted:
        outlines.append(("region", counted))
    return outlines, said


def _how_much(change: Change) -> tuple[str, str]:
    """Say how much of a map changed, and by what measure."""
    known = np.isfinite(change.lod) & np.isfinite(change.dz)
    if not known.any():  # maps of other scanners, as a rule
        return "the scans say no uncertainty", ", so nobody can tell how much of it is certain"
    share = 100 * float(change.significant.sum()) / int(np.isfinite(change.dz).sum())
    lod = float(np.nanmedian(change.lod))
    return (
        f"{plain(share, 3)}\N{NO-BREAK SPACE}% of the cells changed",
        f" by more than their level of detection (median {plain(1000 * lod, 2)} µm)",
    )

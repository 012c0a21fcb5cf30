"""How microrelief's objects show themselves in a notebook: ``%load_ext dashboards``, and a scan is a picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape
from typing import Any

import numpy as np

from pipelines import Calibration, Change, Frames, Grid, Measurement, PatternSet, Scan, with_uncertainty
from storage import Store, Stored

from .maps import change_map, height_map
from .quantities import day_and_time, plain, span
from .raster import change_limit, height_ends

__all__ = ["SHOWN", "load_ipython_extension", "show"]

_STYLE = (
    ".microrelief svg{width:340px;max-width:100%;height:auto;background:#fff}"
    ".microrelief svg text{font:12px sans-serif;fill:#444} .microrelief td{text-align:left}"
    ".microrelief .frame{fill:none;stroke:#bbb} .microrelief .bar{fill:none;stroke:#000;stroke-width:1.6}"
)
"""Reaches nothing outside of what is shown."""


def load_ipython_extension(shell: Any) -> None:
    """Teach a notebook (``%load_ext dashboards``) to show our objects."""
    formatter = shell.display_formatter.formatters["text/html"]
    for kind, tell in SHOWN.items():
        formatter.for_type(kind, tell)
    for module, name in (("icechunk_store", "IcechunkStore"), ("memory_store", "MemoryStore")):
        formatter.for_type_by_name(f"storage.{module}", name, show)


def show(thing: object) -> str:
    """Give an object as HTML, as a notebook shows it.

    Raises
    ------
    TypeError
        If it is none that we know how to show.
    """
    for kind, tell in SHOWN.items():
        if isinstance(thing, kind):
            return tell(thing)
    raise TypeError(f"no picture of a {type(thing).__name__}: there is one of {', '.join(k.__name__ for k in SHOWN)}")


def _scan(scan: Scan) -> str:
    known = scan.height[np.isfinite(scan.height)]
    ends = height_ends(known)
    sigma = scan.sigma[np.isfinite(scan.sigma)]
    facts = {
        "Time": day_and_time(scan.time),
        "Grid": _size(scan.grid),
        "Measured": f"{100 * scan.coverage:.1f} % of the cells",
        "Heights": f"{plain(ends.low, 3)} to {plain(ends.high, 3)} mm (2 to 98 %)" if known.size else "none",
        "Uncertainty": f"{plain(1000 * float(np.median(sigma)), 2)} µm (median)" if sigma.size else "not known",
        "Calibration": scan.calibration_id or "none: from elsewhere",
    }
    return _shown("Scan", facts, height_map(scan, ends, f"Height map of {day_and_time(scan.time)}."))


def _change(change: Change, scan: Scan | None = None) -> str:
    share = 100 * float(change.significant.sum()) / max(int(np.isfinite(change.dz).sum()), 1)
    levels = change.lod[np.isfinite(change.lod)]
    facts = {
        "Since": day_and_time(change.baseline_time),
        "Changed": f"{plain(share, 3)} % of the cells, for certain (95 %)",
        "Level of detection": f"{plain(1000 * float(np.median(levels)), 2)} µm (median)"
        if levels.size
        else "not known",
        "Registration": f"{change.motion.verdict} {change.motion.reason}".strip(),
    }
    ground = scan if scan is not None else _flat(change)
    return _shown(
        "Change", facts, change_map(ground, change, change_limit(change.dz), "Change map: blue rose, red sank.")
    )


def _stored(stored: Stored) -> str:
    told = _scan(stored.scan)
    if stored.change is not None:
        told += _change(stored.change, stored.scan)
    alarms = ", ".join(f"{name}: {state}" for name, state in stored.alarms.items()) or "none set"
    facts = {"Number": f"{stored.number}, epoch {stored.epoch}, baseline scan {stored.baseline}", "Alarms": alarms}
    return _shown("Stored scan", facts) + told


def _store(store: Store) -> str:
    about = store.about
    facts = {"Site": about.site or "not named", "Where": about.location, "Scans": str(len(store))}
    if len(store):
        first, last = store[0].scan.time, store[-1].scan.time
        facts |= {"From": day_and_time(first), "To": f"{day_and_time(last)} ({span(last - first)})"}
    if about.grid is not None:
        facts["Grid"] = _size(about.grid)
    facts |= {"Metrics": ", ".join(about.metrics) or "none", "Snapshot": about.snapshot}
    return _shown("Store", facts) + (_stored(store[-1]) if len(store) else "")


def _grid(grid: Grid) -> str:
    x_low, x_high, y_low, y_high = grid.extent_mm
    facts = {"Cells": _size(grid), "x": f"{x_low:.3g} to {x_high:.3g} mm", "y": f"{y_low:.3g} to {y_high:.3g} mm"}
    return _shown("Grid", facts)


def _measurement(measurement: Measurement) -> str:
    return f'<span class="microrelief">{escape(with_uncertainty(measurement))}</span>'


def _calibration(calibration: Calibration) -> str:
    facts = {
        "Id": calibration.id,
        "Camera": f"{calibration.camera.size[0]} x {calibration.camera.size[1]} px",
        "Projector": f"{calibration.projector.size[0]} x {calibration.projector.size[1]} px",
        "Residual (rms)": ", ".join(f"{name} {value:.3f} px" for name, value in calibration.rms_px.items()),
        "Poses": str(len(calibration.poses)),
    }
    return _shown("Calibration", facts)


def _frames(frames: Frames) -> str:
    count, rows, columns = frames.stack.shape
    facts = {
        "Time": day_and_time(frames.time),
        "Frames": f"{count} of {columns} x {rows} px, {8 * frames.stack.dtype.itemsize} bit",
        "Exposure": f"{plain(frames.exposure_ms)} ms" if np.isfinite(frames.exposure_ms) else "not known",
        "Patterns": _kind(frames.patterns),
    }
    return _shown("Capture", facts)


def _patterns(patterns: PatternSet) -> str:
    return _shown("Patterns", {"Kind": _kind(patterns), "Images": str(len(patterns.roles))})


SHOWN: Mapping[type, Callable[[Any], str]] = {
    Scan: _scan,
    Change: _change,
    Stored: _stored,
    Store: _store,
    Grid: _grid,
    Measurement: _measurement,
    Calibration: _calibration,
    Frames: _frames,
    PatternSet: _patterns,
}
"""What shows itself, and how."""


def _kind(patterns: PatternSet) -> str:
    return f"{patterns.kind}, {patterns.size[0]} x {patterns.size[1]}"


def _size(grid: Grid) -> str:
    size = f"{plain(grid.columns * grid.pitch_mm)} x {plain(grid.rows * grid.pitch_mm)} mm"
    return f"{grid.columns} x {grid.rows} cells of {plain(1000 * grid.pitch_mm)} µm ({size})"


def _flat(change: Change) -> Scan:
    """Give a scan of nothing on a change's grid: a map takes its places from one."""
    nothing = np.full(change.grid.shape, np.nan, dtype=np.float32)
    blank = np.zeros(change.grid.shape, dtype=np.uint8)
    return Scan(change.grid, change.baseline_time, nothing, nothing, blank, blank)


def _shown(what: str, facts: Mapping[str, str], picture: str = "") -> str:
    rows = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in facts.items())
    return (
        f'<div class="microrelief"><style>{_STYLE}</style><table><caption>{escape(what)}</caption>{rows}</table>'
        f"{picture}</div>"
    )

"""One scan, change or event, as arrays of a store and back."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any, cast

import numpy as np

from pipelines import Calibration, Change, Event, Grid, Measurement, Motion, Scan, Tick
from pipelines.change import Verdict

from .layout import CELLS_OF_CHANGE, CELLS_OF_SCAN, NO_TIME
from .order import Place, Tail
from .packing import Packing, pack_sigmas
from .rows import Known, Rows, read_row, row, texts

__all__ = [
    "read_change",
    "read_events",
    "read_scan",
    "rows_of_change",
    "rows_of_events",
    "rows_of_metrics",
    "rows_of_scan",
    "tail_of",
]


def rows_of_scan(where: Place, tick: Tick, packing: Packing) -> list[Rows]:
    """Give a scan's rows at its place."""
    scan, number = tick.scan, where.number
    assert scan is not None
    assert number is not None
    values = {
        "height": packing.pack(scan.height, "height"),
        "sigma": pack_sigmas(scan.sigma, packing.step_mm),
        "texture": scan.texture,
        "level": scan.level,
        "time": scan.time.astype(np.int64),
        "scan": np.int64(number),
        "epoch": np.int32(where.tail.epoch),
        "baseline": np.int64(where.tail.baseline),
        "planned": tick.planned.astype(np.int64),
        "calibration": scan.calibration_id,
        "alarms": json.dumps(dict(tick.alarms), sort_keys=True),
    }
    return [row(f"scans/{name}", number, value) for name, value in values.items()]


def read_scan(store: Any, number: int, grid: Grid, packing: Packing, known: Known | None = None) -> Scan:
    """Read a scan back from a Zarr store."""
    found = read_row(store, "scans", number, ("time", *CELLS_OF_SCAN, "calibration"), known)
    return Scan(
        grid=grid,
        time=np.datetime64(int(found["time"]), "ns"),
        height=packing.unpack(found["height"]),
        sigma=found["sigma"],
        texture=found["texture"],
        level=found["level"],
        calibration_id=str(found["calibration"]),
    )


def tail_of(store: Any, count: int, known: Known | None = None) -> Tail:
    """Give the tail of the first `count` scans of a Zarr store."""
    if not count:
        return Tail()
    last = read_row(store, "scans", count - 1, ("time", "epoch", "baseline", "calibration"), known)
    baseline = int(last["baseline"])
    return Tail(
        count=count,
        time=np.datetime64(int(last["time"]), "ns"),
        epoch=int(last["epoch"]),
        baseline=baseline,
        baseline_time=np.datetime64(int(read_row(store, "scans", baseline, ("time",), known)["time"]), "ns"),
        calibration_id=str(last["calibration"]),
    )


def rows_of_change(number: int, tick: Tick, packing: Packing) -> list[Rows]:
    """Give a change's rows; without a change, only its time."""
    assert tick.scan is not None
    change = tick.change
    values: dict[str, Any] = dict.fromkeys(("dz", "lod", "baseline_time", "motion", "verdict", "reason"))
    values["time"] = tick.scan.time.astype(np.int64)
    if change is not None:
        motion = change.motion
        terms = (motion.residual_mm, motion.overlap, motion.conditioning, motion.sigma_z_mm, motion.sigma_xy_mm)
        values |= {
            "dz": packing.pack(change.dz, "change"),
            "lod": pack_sigmas(change.lod),
            "baseline_time": change.baseline_time.astype(np.int64),
            "motion": np.concatenate([motion.matrix.ravel(), terms]),
            "verdict": motion.verdict,
            "reason": motion.reason,
        }
    return [row(f"change/{name}", number, value) for name, value in values.items()]


def rows_of_calibration(root: Any, calibration: Calibration) -> list[Rows]:
    """Give a calibration's rows; none where it is kept already."""
    ids = [str(name) for name in root["calibrations/id"][:]]
    if calibration.id in ids:
        return []
    values = {"id": calibration.id, "json": calibration.to_json()}
    return [row(f"calibrations/{name}", len(ids), value) for name, value in values.items()]


def read_change(store: Any, number: int, grid: Grid, packing: Packing, known: Known | None = None) -> Change | None:
    """Read a change back from a Zarr store; None where there is none."""
    baseline_time = int(read_row(store, "change", number, ("baseline_time",), known)["baseline_time"])
    if baseline_time == NO_TIME:
        return None
    found = read_row(store, "change", number, (*CELLS_OF_CHANGE, "motion", "verdict", "reason"), known)
    residual, overlap, conditioning, sigma_z, sigma_xy = (float(term) for term in found["motion"][16:])
    verdict = cast(Verdict, str(found["verdict"]))
    matrix, reason = found["motion"][:16].reshape(4, 4), str(found["reason"])
    motion = Motion(matrix, residual, overlap, conditioning, sigma_z, sigma_xy, verdict, reason)
    return Change(
        grid=grid,
        baseline_time=np.datetime64(baseline_time, "ns"),
        dz=packing.unpack(found["dz"]),
        lod=found["lod"],
        motion=motion,
    )


def rows_of_metrics(number: int, tick: Tick, names: Iterable[str]) -> list[Rows]:
    """Give the rows of all of a store's metrics; NaN for one that was not measured."""
    assert tick.scan is not None
    rows = [row("metrics/time", number, tick.scan.time.astype(np.int64))]
    nothing = Measurement(np.nan, np.nan)
    for name in names:
        measured = tick.metrics.get(name, nothing)
        rows += [row(f"metrics/{name}", number, measured.value), row(f"metrics/{name}_sigma", number, measured.sigma)]
    return rows


def rows_of_events(count: int, events: Sequence[Event]) -> list[Rows]:
    """Give the rows of events that follow `count` others."""
    if not events:
        return []
    columns = {
        "time": np.array([event.time for event in events], dtype="datetime64[ns]").astype(np.int64),
        "kind": texts([event.kind for event in events]),
        "text": texts([event.text for event in events]),
    }
    return [Rows(f"events/{name}", count, len(events), values) for name, values in columns.items()]


def read_events(group: Any) -> tuple[Event, ...]:
    """Read all events, in the order of their time."""
    times = group["time"][:].astype("datetime64[ns]")
    events = [
        Event(time, str(kind), str(text))
        for time, kind, text in zip(times, group["kind"][:], group["text"][:], strict=True)
    ]
    return tuple(sorted(events, key=lambda event: event.time))

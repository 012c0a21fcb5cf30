"""One scan, change, event or capture, as arrays of a store and back."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, cast

import numpy as np

from pipelines import Change, Event, Frames, Grid, Motion, Scan, Tick
from pipelines.change import Verdict

from .layout import NO_TIME, TABLE_CHUNK
from .order import Place
from .packing import STEP_MM, pack_heights, pack_sigmas, unpack_heights

__all__ = [
    "put",
    "read_change",
    "read_events",
    "read_scan",
    "write_change",
    "write_events",
    "write_frames",
    "write_scan",
]


def put(array: Any, number: int, value: Any) -> None:
    """Write one scan's value, which may be the next one."""
    if array.shape[0] <= number:
        array.resize((number + 1, *array.shape[1:]))
    if value is not None:
        array[number] = value


def write_scan(group: Any, where: Place, tick: Tick) -> None:
    """Write a scan at its place."""
    scan, number = tick.scan, where.number
    assert scan is not None
    assert number is not None
    put(group["height"], number, pack_heights(scan.height, str(group["height"].dtype), "height"))
    put(group["sigma"], number, pack_sigmas(scan.sigma, STEP_MM))
    put(group["texture"], number, scan.texture)
    put(group["level"], number, scan.level)
    put(group["time"], number, scan.time.astype(np.int64))
    put(group["scan"], number, number)
    put(group["epoch"], number, where.tail.epoch)
    put(group["baseline"], number, where.tail.baseline)
    put(group["planned"], number, tick.planned.astype(np.int64))
    put(group["calibration"], number, scan.calibration_id)
    put(group["alarms"], number, json.dumps(dict(tick.alarms), sort_keys=True))


def read_scan(group: Any, number: int, grid: Grid) -> Scan:
    """Read a scan back."""
    return Scan(
        grid=grid,
        time=np.datetime64(int(group["time"][number]), "ns"),
        height=unpack_heights(group["height"][number]),
        sigma=group["sigma"][number],
        texture=group["texture"][number],
        level=group["level"][number],
        calibration_id=str(group["calibration"][number]),
    )


def write_change(group: Any, number: int, tick: Tick) -> None:
    """Write a change; without one, only lengthen the arrays: cells that hold nothing cost nothing."""
    assert tick.scan is not None
    put(group["time"], number, tick.scan.time.astype(np.int64))
    change = tick.change
    if change is None:
        for name in ("dz", "lod", "baseline_time", "motion", "verdict", "reason"):
            put(group[name], number, None)
        return
    motion = change.motion
    terms = (motion.residual_mm, motion.overlap, motion.conditioning, motion.sigma_z_mm, motion.sigma_xy_mm)
    put(group["dz"], number, pack_heights(change.dz, str(group["dz"].dtype), "change"))
    put(group["lod"], number, pack_sigmas(change.lod))
    put(group["baseline_time"], number, change.baseline_time.astype(np.int64))
    put(group["motion"], number, np.concatenate([motion.matrix.ravel(), terms]))
    put(group["verdict"], number, motion.verdict)
    put(group["reason"], number, motion.reason)


def read_change(group: Any, number: int, grid: Grid) -> Change | None:
    """Read a change back; None where there is none."""
    baseline_time = int(group["baseline_time"][number])
    if baseline_time == NO_TIME:
        return None
    terms = group["motion"][number]
    residual, overlap, conditioning, sigma_z, sigma_xy = (float(term) for term in terms[16:])
    verdict = cast(Verdict, str(group["verdict"][number]))
    matrix = terms[:16].reshape(4, 4)
    reason = str(group["reason"][number])
    motion = Motion(matrix, residual, overlap, conditioning, sigma_z, sigma_xy, verdict, reason)
    return Change(
        grid=grid,
        baseline_time=np.datetime64(baseline_time, "ns"),
        dz=unpack_heights(group["dz"][number]),
        lod=group["lod"][number],
        motion=motion,
    )


def write_events(group: Any, events: Sequence[Event]) -> None:
    """Add events after those that are there."""
    if not events:
        return
    count = group["time"].shape[0]
    columns = {
        "time": np.array([event.time for event in events], dtype="datetime64[ns]").astype(np.int64),
        "kind": np.array([event.kind for event in events], dtype=np.dtypes.StringDType()),
        "text": np.array([event.text for event in events], dtype=np.dtypes.StringDType()),
    }
    for name, values in columns.items():
        group[name].resize((count + len(events),))
        group[name][count:] = values


def read_events(group: Any) -> tuple[Event, ...]:
    """Read all events, in the order of their time."""
    times = group["time"][:].astype("datetime64[ns]")
    events = [
        Event(time, str(kind), str(text))
        for time, kind, text in zip(times, group["kind"][:], group["text"][:], strict=True)
    ]
    return tuple(sorted(events, key=lambda event: event.time))


def write_frames(root: Any, number: int | None, frames: Frames) -> None:
    """Keep raw frames in ``/raw/KIND``: one group for each shape, depth and pattern set; scan -1 where none came of it.

    A group per capture would make every commit list them all.
    """
    patterns = json.dumps(asdict(frames.patterns), sort_keys=True)
    shape, dtype = frames.stack.shape, frames.stack.dtype
    kind = hashlib.sha256(f"{shape}{dtype}{patterns}".encode()).hexdigest()[:12]
    raw = root.require_group("raw")
    if kind not in raw:
        from zarr.codecs import BloscCodec

        compressor = BloscCodec(cname="zstd", clevel=1, shuffle="bitshuffle")
        group = raw.create_group(kind, attributes={"patterns": json.loads(patterns)})
        group.create_array(
            "frames",
            shape=(0, *shape),
            chunks=(1, 1, *shape[1:]),
            dtype=dtype,
            compressors=compressor,
            dimension_names=("time", "frame", "row", "column"),
        )
        tables = {
            "time": ("int64", "nanoseconds since 1970-01-01"),
            "scan": ("int64", "1"),
            "exposure_ms": ("float64", "ms"),
        }
        for name, (table_type, unit) in tables.items():
            group.create_array(
                name,
                shape=(0,),
                chunks=(TABLE_CHUNK,),
                dtype=table_type,
                dimension_names=("time",),
                attributes={"units": unit},
            )
    group = raw[kind]
    at = group["time"].shape[0]
    put(group["frames"], at, frames.stack)
    put(group["time"], at, frames.time.astype(np.int64))
    put(group["scan"], at, -1 if number is None else number)
    put(group["exposure_ms"], at, frames.exposure_ms)

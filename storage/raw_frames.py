"""Raw frames in a store: kept without loss beside the scan that came of them, found by its number, let go when old."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from pipelines import Frames, Instant, PatternSet

from .layout import NO_TIME, TIME, codecs, table_of
from .rows import Rows, delete_below, row

__all__ = ["LET_GO", "lay_out_frames", "let_go", "read_frames", "rows_of_frames"]

CHUNK_BYTES = 16 * 2**20
"""Several whole frames to a chunk: a chunk each would be 42 files a scan."""

LET_GO = "let_go"
"""Attribute of a kind of capture: how many of its oldest captures have been let go."""

Stack = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


def rows_of_frames(root: Any, number: int | None, frames: Frames) -> list[Rows]:
    """Give the rows of raw frames in ``/raw/KIND``: a group for each shape, depth and pattern set, made if new.

    A group per capture would make every commit list them all. Scan -1 where no scan came of the frames.
    """
    patterns = json.dumps(asdict(frames.patterns), sort_keys=True)
    name = _array_of(frames.stack.dtype)
    kind = hashlib.sha256(f"{name}{frames.stack.shape}{frames.stack.dtype}{patterns}".encode()).hexdigest()[:12]
    raw = root.require_group("raw")
    if kind not in raw:
        lay_out_frames(raw, kind, name, frames.stack.shape, frames.stack.dtype, json.loads(patterns))
    at = raw[kind]["time"].shape[0]
    values = {
        name: _differences(frames.stack) if name == "differences" else frames.stack,
        "time": frames.time.astype(np.int64),
        "scan": np.int64(-1 if number is None else number),
        "exposure_ms": frames.exposure_ms,
    }
    return [row(f"raw/{kind}/{each}", at, value) for each, value in values.items()]


def read_frames(root: Any, number: int) -> Frames | None:
    """Read the frames that scan `number` was made of; None where they were not kept, or were let go."""
    for _, group in _kinds(root):
        first = _first(group)
        found = np.flatnonzero(group["scan"][first:] == number)
        if len(found):
            at = first + int(found[-1])
            if "differences" in group:
                stack: Stack = np.cumsum(group["differences"][at], axis=-1, dtype=np.uint8)
            else:
                stack = group["frames"][at]
            patterns = PatternSet.from_mapping(group.attrs["patterns"])
            time = np.datetime64(int(group["time"][at]), "ns")
            return Frames(stack, time, patterns, float(group["exposure_ms"][at]))
    return None


def let_go(root: Any, before: Instant) -> None:
    """Let go of the captures taken before an instant.

    Their pixels leave the store's newest snapshot. The disk has its space back once no snapshot that is still kept
    holds them (`microrelief store expire`, then `gc`).
    """
    for kind, group in _kinds(root):
        first = _first(group)
        count = int(np.searchsorted(group["time"][first:], before.astype("datetime64[ns]").astype(np.int64)))
        if count:
            name = "differences" if "differences" in group else "frames"
            delete_below(root.store, [f"raw/{kind}/{name}/c/{at}" for at in range(first, first + count)])
            group.attrs[LET_GO] = first + count


def lay_out_frames(
    raw: Any, kind: str, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike, patterns: dict[str, Any]
) -> Any:
    """Make the arrays of one kind of capture, empty; `name` is one of `layout.FRAMES`, `shape` (frame, row, column)."""
    from zarr.codecs import BloscCodec

    group = raw.create_group(kind, attributes={"patterns": patterns, LET_GO: 0})
    about = "captured frames"
    if name == "differences":
        about += ": each pixel less its left neighbour, modulo 256; cumsum(axis=-1, dtype=uint8) gives the frames"
    frame_bytes = int(np.prod(shape[1:])) * np.dtype(dtype).itemsize
    # differences are entropy-coded byte by byte; of 12 bits in 16, bit planes hold less
    packed = BloscCodec(cname="zstd", clevel=1, shuffle="noshuffle" if name == "differences" else "bitshuffle")
    group.create_array(
        name,
        shape=(0, *shape),
        chunks=(1, max(1, min(shape[0], CHUNK_BYTES // frame_bytes)), *shape[1:]),
        dtype=dtype,
        compressors=[packed, *codecs()[1:]],
        dimension_names=("time", "frame", "row", "column"),
        attributes={"units": "1", "long_name": about},
    )
    table_of(group, "time", "int64", NO_TIME, {**TIME, "long_name": "time of the capture"})
    table_of(group, "scan", "int64", -1, {"units": "1", "long_name": "scan that came of it; -1 where none did"})
    table_of(group, "exposure_ms", "float64", np.nan, {"units": "ms", "long_name": "exposure of a frame"})
    return group


def _kinds(root: Any) -> list[tuple[str, Any]]:
    return list(root["raw"].groups()) if "raw" in root else []


def _first(group: Any) -> int:
    return int(group.attrs.get(LET_GO, 0))


def _array_of(depth: np.dtype[Any]) -> str:
    """Say how frames of a depth are stored: what was measured smallest (`tests.benchmarks.bench_raw_frames`)."""
    return "differences" if depth == np.uint8 else "frames"


def _differences(stack: Stack) -> Stack:
    """Subtract from each pixel its left neighbour, modulo 256: what remains is noise and the stripes' edges."""
    result: Stack = np.empty_like(stack)
    result[..., 0] = stack[..., 0]
    np.subtract(stack[..., 1:], stack[..., :-1], out=result[..., 1:])
    return result

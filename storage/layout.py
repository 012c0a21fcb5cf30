"""What is in a store: its groups and arrays, their chunks, units and attributes. Schema 2.

    /             attrs: microrelief_schema, site, campaign, campaign_hash, software, created, grid; noise_model (JSON)
    /scans        height sigma texture level (time, y, x); scan epoch baseline planned calibration alarms (time)
    /change       dz lod (time, y, x); baseline_time motion verdict reason (time)
    /binned       height dz: means of 8x8 cells; see `binned.rows_of_bins`
    /metrics      NAME and NAME_sigma (time)
    /events       time kind text (event)
    /calibrations id json (calibration)
    /raw          one group per kind of capture, only where frames are kept; see `raw_frames`

Cells lie in chunks of one scan; what is one number per scan lies in chunks of `TABLE_CHUNK` scans: a chunk per scan
would make a thousand reads of a series. Every chunk ends in a CRC-32C of its bytes, which whoever reads it checks.

Schema 1 had no checksums and fewer attributes. Its stores are read and continued as they are; a copy of one
(`storage.copying`) has the present schema.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from pipelines import Grid
from pipelines.change import NoiseModel

from .packing import BIN, Packing

__all__ = [
    "CELLS_OF_CHANGE",
    "CELLS_OF_SCAN",
    "FOLD",
    "FRAMES",
    "MOTION_TERMS",
    "NOISE",
    "NO_TIME",
    "SCHEMA",
    "TABLE_CHUNK",
    "TIME",
    "add_metric",
    "codecs",
    "grid_of",
    "lay_out",
    "metrics_of",
    "noise_of",
    "root_attributes",
    "split_sizes",
    "table_of",
]

SCHEMA = 2
TABLE_CHUNK = 128
MOTION_CHUNK = 16
"""Scans per chunk of motions, 21 numbers each: a commit rewrites 1.4 kB of them, of a table's chunk it would be 11."""

TINY_CELLS = 1500
"""Up to so many cells compress to less than `repository.INLINE_BYTES`."""

FRAMES = ("frames", "differences")
"""Names of the arrays that hold captured pixels, for 16 and for 8 bits."""

CELL_CHUNK = 1024
"""Longest side of a chunk of cells: a scan of 1440 x 2560 is read a third faster from 6 chunks than from 15, and 36
files a tick are synced instead of 90; who reads one place through time decodes twice as many cells."""

NOISE = "noise_model"
FOLD = 64
"""Scans per chunk of ``/binned``."""

NO_TIME = int(np.iinfo(np.int64).min)
"""What numpy calls NaT."""

BLOCK_BYTES = 2**20
SHUFFLES = {"sigma": "shuffle", "lod": "shuffle", "texture": "noshuffle"}
"""How the bits of cells are sorted before they are compressed; bit by bit unless said here. Steps of height: 8.7 bits a
cell, 9.0 by byte; sigma's rounded floats by byte 7.1 for 7.8, for half their bytes are zero; texture, whose noise fills
its low bits, unsorted 7.4 for 7.8."""

CELLS_OF_SCAN = ("height", "sigma", "texture", "level")
CELLS_OF_CHANGE = ("dz", "lod")
MOTION_TERMS = (
    *(f"m{row}{column}" for row in range(4) for column in range(4)),
    "residual_mm",
    "overlap",
    "conditioning",
    "sigma_z_mm",
    "sigma_xy_mm",
)

TIME = {
    "units": "nanoseconds since 1970-01-01",
    "calendar": "proleptic_gregorian",
    "units_metadata": "leap_seconds: none",  # as POSIX and numpy count
}
"""Attributes of an array of instants."""


def root_attributes(site: str, grid: Grid, campaign: str, campaign_hash: str, software: str, created: str) -> Any:
    """Give the root's attributes: where the data come from."""
    return {
        "microrelief_schema": SCHEMA,
        "Conventions": "CF-1.11",
        "title": f"microrelief: height maps of {site}",
        "site": site,
        "campaign": campaign,
        "campaign_hash": campaign_hash,
        "software": software,
        "created": created,
        "grid": asdict(grid),
    }


def grid_of(attributes: Mapping[str, Any]) -> Grid:
    """Read the grid from the root's attributes."""
    return Grid(**attributes["grid"])


def split_sizes(grid: Grid) -> dict[str, dict[str, int]]:
    """Chunks in one manifest along a dimension, by a pattern of the array's name; the first that matches holds.

    Every commit rewrites the newest manifest of each array, and in the snapshot a list of all manifests, 25 bytes for
    each (Icechunk's format 1): the more a manifest holds, the less a commit grows with the scans that there are. What
    fills no more than a block of the disk, 4 kB, costs no room. So: of cells, whose chunks are files, 23 bytes for each
    chunk; of tables, whose chunks lie in the manifest, up to 870 bytes for numbers, 640 for times, some 100 for what
    rarely changes; of tiny grids' cells and of `level`, which compresses well, a chunk's bytes.
    """
    chunks = -(-grid.rows // CELL_CHUNK) * -(-grid.columns // CELL_CHUNK)
    tiny = grid.rows * grid.columns <= TINY_CELLS
    of_cells = 32 if tiny or chunks > 8 else 64 if chunks > 1 else 128
    cells = "|".join((*CELLS_OF_SCAN, *CELLS_OF_CHANGE))
    rarely = "scan|epoch|baseline|calibration|alarms|baseline_time|verdict|reason"
    return {
        "^level$": {"time": min(of_cells, 64)},
        f"^({cells})$": {"time": of_cells, "folded": 64},
        f"^({'|'.join(FRAMES)})$": {"time": 64},
        "^motion$": {"time": 2048 // MOTION_CHUNK},
        f"^({rarely})$": {"time": 2048 // TABLE_CHUNK},
        "": {"time": 512 // TABLE_CHUNK, "event": 512 // TABLE_CHUNK, "tail": 8, "calibration": 8},
    }


def _chunk(rows: int, columns: int) -> tuple[int, int]:
    """Give the sides of chunks of cells, equal but for a cell: a cut one at the edge would be stored whole."""
    down, across = (-(-count // -(-count // CELL_CHUNK)) for count in (rows, columns))
    return down, across


def lay_out(root: Any, grid: Grid, packing: Packing, metrics: Mapping[str, str]) -> None:
    """Make all groups and arrays, empty."""
    history = f"{root.attrs['created']}: made by {root.attrs['software'] or 'microrelief'}"
    about = {"Conventions": "CF-1.11", "history": history}
    scans = root.create_group("scans", attributes={**about, "title": "height maps"})
    _coordinates(scans, grid)
    height = {"units": "mm", "long_name": "height above the reference plane", "ancillary_variables": "sigma"}
    _cells(scans, "height", grid, packing, height)
    _cells(scans, "sigma", grid, "float32", {"units": "mm", "long_name": "standard uncertainty of height"})
    _cells(scans, "texture", grid, "uint8", {"units": "1", "long_name": "brightness under full light, 0 to 255"})
    _cells(scans, "level", grid, "uint8", {"units": "1", "long_name": "coarseness of the stripes resolved; 255 none"})
    table_of(scans, "scan", "int64", 0, {"units": "1", "long_name": "scan number"})
    table_of(scans, "epoch", "int32", 0, {"units": "1", "long_name": "epoch: grows with a new calibration or baseline"})
    table_of(scans, "baseline", "int64", 0, {"units": "1", "long_name": "number of the scan that change is against"})
    table_of(scans, "planned", "int64", NO_TIME, {**TIME, "long_name": "slot of the schedule", "_FillValue": NO_TIME})
    table_of(scans, "calibration", "str", "", {"long_name": "id of the calibration"})
    table_of(scans, "alarms", "str", "{}", {"long_name": "state of each alarm after the scan, JSON"})

    change = root.create_group("change", attributes={**about, "title": "change since the baseline"})
    _coordinates(change, grid)
    _cells(change, "dz", grid, packing, {"units": "mm", "long_name": "height now minus height then"})
    _cells(change, "lod", grid, "float32", {"units": "mm", "long_name": "level of detection at 95 %"})
    then = {**TIME, "long_name": "time of the baseline", "_FillValue": NO_TIME}
    table_of(change, "baseline_time", "int64", NO_TIME, then)
    table_of(change, "verdict", "str", "", {"long_name": "good, doubtful or failed; empty where there is no change"})
    table_of(change, "reason", "str", "", {"long_name": "why the verdict is not good"})
    change.create_array(
        "motion",
        shape=(0, len(MOTION_TERMS)),
        chunks=(MOTION_CHUNK, len(MOTION_TERMS)),
        dtype="float64",
        fill_value=np.nan,
        compressors=codecs(),
        dimension_names=("time", "motion_term"),
        attributes={"long_name": "rigid motion, scan to baseline, row by row; then its quality", "terms": MOTION_TERMS},
    )

    _lay_out_binned(root, grid, packing, about)
    table = root.create_group("metrics", attributes={**about, "title": "metrics", "metrics": "{}"})
    table_of(table, "time", "int64", NO_TIME, {**TIME, "standard_name": "time", "axis": "T"})
    for name, unit in metrics.items():
        add_metric(table, name, unit)
    title = "failures, missed runs, alarms, epochs, remarks"
    events = root.create_group("events", attributes={**about, "title": title})
    table_of(events, "time", "int64", NO_TIME, {**TIME, "long_name": "when it happened"}, along="event")
    table_of(events, "kind", "str", "", {"long_name": "what kind of event"}, along="event")
    table_of(events, "text", "str", "", {"long_name": "what happened, in words"}, along="event")
    title = "calibrations by id, as calibration.json"
    calibrations = root.create_group("calibrations", attributes={**about, "title": title})
    for name in ("id", "json"):
        calibrations.create_array(
            name,
            shape=(0,),
            chunks=(1,),
            dtype="str",
            compressors=codecs("str"),
            dimension_names=("calibration",),
            attributes={"long_name": {"id": "id of a calibration", "json": "calibration.json"}[name]},
        )


def add_metric(table: Any, name: str, unit: str) -> None:
    """Make a metric's two arrays, NaN for the scans that are already there."""
    count = int(table["time"].shape[0])
    table.attrs["metrics"] = json.dumps({**metrics_of(table), name: unit})  # text: NetCDF attributes hold no mapping
    for array, what in ((name, "value"), (f"{name}_sigma", "standard uncertainty")):
        table_of(table, array, "float64", np.nan, {"units": unit, "long_name": f"{name}: {what}"}, count=count)


def metrics_of(table: Any) -> dict[str, str]:
    """Give the unit of each metric of a ``/metrics`` group; schema 1 kept a mapping, not its JSON."""
    kept = table.attrs["metrics"]
    return dict(json.loads(kept) if isinstance(kept, str) else kept)


def noise_of(attributes: Any) -> NoiseModel | None:
    """Give the newest noise model; None where none was kept."""
    return NoiseModel.from_json(attributes[NOISE]) if NOISE in attributes else None


def _lay_out_binned(root: Any, grid: Grid, packing: Packing, about: Mapping[str, str]) -> None:
    rows, columns = -(-grid.rows // BIN), -(-grid.columns // BIN)
    title = f"height and dz as means of {BIN}x{BIN} cells, folded every {FOLD} scans"
    binned = root.create_group("binned", attributes={**about, "title": title})
    coarse = Grid(
        rows,
        columns,
        grid.pitch_mm * BIN,
        grid.x0_mm + grid.pitch_mm * (BIN - 1) / 2,
        grid.y0_mm + grid.pitch_mm * (BIN - 1) / 2,
    )
    _coordinates(binned, coarse)
    for name in ("height", "dz"):
        attributes = {"units": "mm", **packing.attributes}
        binned.create_array(
            name,
            shape=(0, rows, columns),
            chunks=(FOLD, min(64, rows), min(64, columns)),
            dtype=packing.kind,
            fill_value=packing.fill,
            compressors=codecs(),
            dimension_names=("folded", "y", "x"),
            attributes={"long_name": f"mean {name} of the first scans, as many as were folded", **attributes},
        )
        binned.create_array(
            f"{name}_tail",
            shape=(FOLD, rows, columns),
            chunks=(1, *_chunk(rows, columns)),
            dtype=packing.kind,
            fill_value=packing.fill,
            compressors=codecs(),
            dimension_names=("tail", "y", "x"),
            attributes={
                "long_name": f"mean {name} of the scans after those of {name}; scan n in n % {FOLD}",
                **attributes,
            },
        )


def _coordinates(group: Any, grid: Grid) -> None:
    table_of(group, "time", "int64", NO_TIME, {**TIME, "standard_name": "time", "axis": "T"})
    for name, values in (("y", grid.y_mm), ("x", grid.x_mm)):
        group.create_array(
            name,
            data=values,
            chunks=values.shape,
            compressors=codecs(),
            dimension_names=(name,),
            attributes={
                "units": "mm",
                "axis": name.upper(),
                "standard_name": f"projection_{name}_coordinate",  # CF's name of a place on a plane that is no map
                "long_name": f"cell centre along {name}, site frame",
            },
        )


def _cells(group: Any, name: str, grid: Grid, kind: str | Packing, attributes: dict[str, Any]) -> None:
    fill: float = np.nan if kind == "float32" else 255 if name == "level" else 0
    if isinstance(kind, Packing):
        fill, attributes, kind = kind.fill, {**attributes, **kind.attributes}, kind.kind
    group.create_array(
        name,
        shape=(0, *grid.shape),
        chunks=(1, *_chunk(*grid.shape)),
        dtype=kind,
        fill_value=fill,
        compressors=codecs(kind, SHUFFLES.get(name, "bitshuffle")),
        dimension_names=("time", "y", "x"),
        attributes=attributes,
    )


def table_of(
    group: Any,
    name: str,
    kind: str,
    fill: Any,
    attributes: dict[str, Any],
    *,
    along: str = "time",
    count: int = 0,
) -> None:
    """Make an array of one number or text per scan, or per whatever lies `along` it."""
    group.create_array(
        name,
        shape=(count,),
        chunks=(TABLE_CHUNK,),
        dtype=kind,
        fill_value=fill,
        compressors=codecs(kind),
        dimension_names=(along,),
        attributes=attributes,
    )


def codecs(kind: str = "", shuffle: Any = "bitshuffle") -> list[Any]:
    """Give what turns values into a chunk's bytes: compression, then a checksum of what is stored.

    Measured on rough soil (`tests/benchmarks/bench_store_layout.py`): in blocks of a megabyte a scan takes 5 % less
    than in those that Blosc chooses, and a third less time. How bits are sorted: see `SHUFFLES`.
    """
    from zarr.codecs import BloscCodec, Crc32cCodec, ZstdCodec

    if kind == "str":
        return [ZstdCodec(level=0), Crc32cCodec()]
    return [BloscCodec(cname="zstd", clevel=1, shuffle=shuffle, blocksize=BLOCK_BYTES), Crc32cCodec()]

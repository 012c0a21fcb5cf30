"""What is on the disk: units and names by the CF conventions, a checksum behind every chunk; older layouts."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
import zarr
from zarr.codecs import Crc32cCodec

from configs import StoreError
from pipelines import Grid, Tick
from storage import Store, create_store, open_store
from storage.layout import SCHEMA

from .ticks import GRID, METRICS, at, calibration, failure, surface, tick

SCHEMA_1 = Path(__file__).parent / "golden" / "schema-1.tar.xz"
"""A store that the first layout's code wrote: scan, scan, failure, scan of another calibration, scan against that."""


def _arrays(store: Store) -> Iterator[Any]:
    root = zarr.open_group(store.session.store, mode="r")  # type: ignore[attr-defined]  # Icechunk
    for _, member in root.members(max_depth=None):
        if isinstance(member, zarr.Array):
            yield member


def _read_all(store: Store) -> None:
    for array in _arrays(store):
        array[:]


def _made(folder: Path, grid: Grid = GRID, scans: int = 3) -> Store:
    store = create_store(folder, site="x", grid=grid, metrics=METRICS, software="microrelief 1")
    for number in range(scans):
        store.append(replace(tick(number), scan=surface(number, grid), change=None, calibration=calibration()))
    store.close()
    return open_store(folder)


def test_every_chunk_ends_in_a_checksum_and_a_turned_bit_is_noticed(tmp_path: Path) -> None:
    grid = Grid(80, 80, 0.05)
    store = _made(tmp_path / "s", grid)
    for array in _arrays(store):
        if array.ndim and not array.path.endswith(("/x", "/y")):
            assert isinstance(array.compressors[-1], Crc32cCodec), array.path
    for chunk in sorted((tmp_path / "s" / "chunks").iterdir()):
        whole = bytearray(chunk.read_bytes())
        whole[len(whole) // 2] ^= 1
        chunk.write_bytes(whole)
        with pytest.raises((StoreError, ValueError), match=r"[Cc]hecksum"):
            _read_all(store)
        whole[len(whole) // 2] ^= 1
        chunk.write_bytes(whole)


def test_every_array_says_what_it_is_in_which_unit(tmp_path: Path) -> None:
    for array in _arrays(_made(tmp_path / "s")):
        attributes = dict(array.attrs)
        assert "long_name" in attributes or "standard_name" in attributes, array.path
        if array.dtype.kind in "iuf" and not array.path.endswith("motion"):
            assert "units" in attributes, array.path
        assert array.metadata.dimension_names[0], array.path


@pytest.mark.parametrize("group", ["scans", "change", "binned", "metrics", "events"])
def test_compliance_checker_finds_no_fault(tmp_path: Path, group: str) -> None:
    """The IOOS checker for CF 1.11, strict, on the group as xarray exports it."""
    program = shutil.which("compliance-checker", path=str(Path(sys.executable).parent)) or shutil.which(
        "compliance-checker"
    )
    if program is None:
        pytest.skip("compliance-checker is not installed: pip install compliance-checker")
    pytest.importorskip("netCDF4")
    store = _made(tmp_path / "s")
    data = xr.open_zarr(store.session.store, group=group, consolidated=False, chunks=None)  # type: ignore[attr-defined]  # Icechunk
    exported = {name: {"_FillValue": None} for name in ("x", "y") if name in data}
    data.to_netcdf(tmp_path / "group.nc", encoding=exported)
    done = subprocess.run(
        [program, "--test", "cf:1.11", "--criteria", "strict", str(tmp_path / "group.nc")],
        capture_output=True,
        text=True,
    )
    faults = [line for line in done.stdout.splitlines() if line.startswith("* ")]
    # a matrix per scan has an axis that is neither space nor time; CF recommends to put it first, and xarray needs time
    assert [line for line in faults if not line.startswith("* motion's spatio-temporal")] == [], done.stdout


def test_int32_where_the_grid_is_wide_and_the_rounding_is_in_sigma(tmp_path: Path) -> None:
    for grid, kind, reach in ((Grid(8, 8, 4.0), "int16", 16.0), (Grid(8, 8, 5.0), "int32", 1e6)):
        store = create_store(tmp_path / kind, site="x", grid=grid)
        exact = replace(surface(0, grid), height=np.zeros(grid.shape, np.float32), sigma=np.full(grid.shape, 1e-4, "f"))
        store.append(Tick(at(0), exact))
        # 0.5 um / sqrt 12 = 0.144 um beside 0.1 um: 0.176 um, within the 8 bits of a stored sigma
        np.testing.assert_allclose(store[0].scan.sigma, np.hypot(1e-4, 0.0005 / np.sqrt(12)), rtol=0.004)
        assert next(array for array in _arrays(store) if array.path == "scans/height").dtype == kind
        with pytest.raises(StoreError, match="does not fit"):
            store.append(Tick(at(1), replace(surface(1, grid), height=exact.height + np.float32(1.1 * reach))))
        store.close()


def test_a_store_of_the_schema_before_is_read_and_continued(tmp_path: Path) -> None:
    with tarfile.open(SCHEMA_1) as archive:
        archive.extractall(tmp_path, filter="data")
    path = tmp_path / "old.icechunk"
    old = open_store(path)
    assert (old.about.schema, len(old), old.about.metrics) == (1, 4, METRICS)
    assert [old[number].epoch for number in range(4)] == [0, 0, 1, 1]
    np.testing.assert_array_equal(old[1].scan.texture, surface(1).texture)
    assert [event.kind for event in old.events] == ["epoch", "failed", "epoch"]
    assert old.events[1] == failure(2).events[0]
    writer = open_store(path, write=True, metrics={"porosity": "1"})
    assert writer.append(tick(5, baseline=3, calibration="second")) == 4
    writer.close()
    again = open_store(path)
    assert (again.about.schema, len(again), again.about.metrics) == (1, 5, {**METRICS, "porosity": "1"})
    assert again[-1].planned == at(5)
    assert SCHEMA == 2

"""What we write, read by programs that are not ours: exact heights, holes, units and places."""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines import Scan
from storage import write_change, write_height_map

from .ticks import GRID, change_of, surface

NODE_MODULES = Path(__file__).resolve().parents[2] / ".cache" / "loaders.gl" / "node_modules"
"""Where `.ci/node-packages` puts them."""

SCAN = surface(3)
CELLS = SCAN.height[::-1].astype(np.float64)
"""mm, the top row first, as images are."""


def client(name: str, package: str) -> str:
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"needs {name} (Debian's {package})")
    return found


def run(*command: str, **environment: str) -> str:
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=120, check=False, env={**os.environ, **environment}
    )
    return done.stdout or done.stderr


def written(folder: Path, suffix: str, scan: Scan = SCAN) -> Path:
    file = folder / f"map{suffix}"
    write_height_map(scan, file)
    return file


def gwy(content: bytes, at: int = 0, end: int | None = None) -> dict[str, Any]:
    """Read the components of a .gwy container (its documented layout: name, type letter, value, little-endian)."""
    found: dict[str, Any] = {}
    end = len(content) if end is None else end
    sizes = {"b": "<?", "i": "<i", "q": "<q", "d": "<d", "c": "<c"}
    while at < end:
        stop = content.index(b"\0", at)
        name, kind, at = content[at:stop].decode(), chr(content[stop + 1]), stop + 2
        if kind in sizes:
            (found[name],) = struct.unpack_from(sizes[kind], content, at)
            at += struct.calcsize(sizes[kind])
        elif kind == "s":
            stop = content.index(b"\0", at)
            found[name], at = content[at:stop].decode(), stop + 1
        elif kind == "D":
            (count,) = struct.unpack_from("<I", content, at)
            found[name], at = np.frombuffer(content, "<f8", count, at + 4), at + 4 + 8 * count
        elif kind == "o":
            stop = content.index(b"\0", at)
            (size,) = struct.unpack_from("<I", content, stop + 1)
            found[name], at = gwy(content, stop + 5, stop + 5 + size), stop + 5 + size
        elif kind == "S":
            (count,), at = struct.unpack_from("<I", content, at), at + 4
            for _ in range(count):
                at = content.index(b"\0", at) + 1
        else:
            raise AssertionError(f"{name}: unexpected type {kind}")
    return found


@pytest.mark.parametrize("suffix", [".gsf", ".x3p"])
def test_gwyddion_reads_heights_holes_and_sizes(tmp_path: Path, suffix: str) -> None:
    program = client("gwyddion", "gwyddion")
    back = tmp_path / "back.gwy"
    told = run(program, f"--convert-to-gwy={back}", str(written(tmp_path, suffix)), HOME=str(tmp_path))
    assert back.exists(), told
    content = back.read_bytes()
    assert content[:4] == b"GWYP"
    field = gwy(content, len(b"GWYP" + b"GwyContainer\0") + 4)
    data, mask = field["/0/data"], field.get("/0/mask")
    assert (data["xres"], data["yres"]) == (GRID.columns, GRID.rows)
    assert data["xreal"] == pytest.approx(GRID.columns * GRID.pitch_mm / 1000, rel=1e-9)
    assert data["yreal"] == pytest.approx(GRID.rows * GRID.pitch_mm / 1000, rel=1e-9)
    assert data["si_unit_xy"]["unitstr"] == data["si_unit_z"]["unitstr"] == "m"
    heights = data["data"].reshape(GRID.shape) * 1000
    holes = np.isnan(heights) if mask is None else mask["data"].reshape(GRID.shape) > 0
    np.testing.assert_array_equal(holes, np.isnan(CELLS))
    np.testing.assert_allclose(heights[~holes], CELLS[~holes], rtol=2e-7)


@pytest.mark.parametrize("suffix", [".tif", ".nc"])
def test_gdal_reads_heights_holes_and_places(tmp_path: Path, suffix: str) -> None:
    translate, info = client("gdal_translate", "gdal-bin"), client("gdalinfo", "gdal-bin")
    file = written(tmp_path, suffix)
    source = str(file) if suffix == ".tif" else f'NETCDF:"{file}":height'
    told = json.loads(run(info, "-json", source))
    per_mm = 0.001 if suffix == ".tif" else 1.0
    left, _, _, top = GRID.extent_mm
    bounds = told["geoTransform"]
    assert bounds[0] == pytest.approx(left * per_mm, rel=1e-9)
    assert bounds[3] == pytest.approx(top * per_mm, rel=1e-9)
    assert (bounds[1], -bounds[5]) == pytest.approx((GRID.pitch_mm * per_mm,) * 2, rel=1e-9)
    assert told["bands"][0]["unit"] == ("m" if suffix == ".tif" else "mm")
    if suffix == ".tif":
        assert 'LENGTHUNIT["metre",1' in told["coordinateSystem"]["wkt"]
        assert told["metadata"][""]["TIME"] == "2026-11-23T15:00:01.500000007Z"
    run(translate, "-q", "-of", "XYZ", source, str(tmp_path / "out.xyz"))
    heights = np.loadtxt(tmp_path / "out.xyz")[:, 2].reshape(GRID.shape) / per_mm
    np.testing.assert_array_equal(np.isnan(heights), np.isnan(CELLS))
    np.testing.assert_allclose(heights, CELLS, rtol=1e-6, atol=1e-7)


def test_cloudcompare_reads_the_mesh_as_it_is(tmp_path: Path) -> None:
    program = client("CloudCompare", "cloudcompare")
    out = tmp_path / "out.asc"
    words = ("-SILENT", "-AUTO_SAVE", "OFF", "-O", str(written(tmp_path, ".ply")), "-EXTRACT_VERTICES")
    save = ("-C_EXPORT_FMT", "ASC", "-PREC", "9", "-SAVE_CLOUDS", "FILE", str(out))
    told = run(program, *words, *save, QT_QPA_PLATFORM="offscreen", HOME=str(tmp_path))
    assert out.exists(), told
    found = np.loadtxt(out)
    measured = np.isfinite(SCAN.height)
    x, y = np.meshgrid(GRID.x_mm, GRID.y_mm)
    np.testing.assert_allclose(found[:, 0], x[measured], atol=1e-7)
    np.testing.assert_allclose(found[:, 1], y[measured], atol=1e-7)
    np.testing.assert_allclose(found[:, 2], SCAN.height[measured], rtol=1e-6, atol=1e-9)


LOADERS = """
import {load} from '@loaders.gl/core'; import {LASLoader} from '@loaders.gl/las'; import fs from 'fs';
const bytes = fs.readFileSync(process.argv[2]);
const data = await load(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length), LASLoader,
  {worker: false, las: {fp64: true}});
console.log(JSON.stringify(Array.from(data.attributes.POSITION.value)));
"""


def test_loaders_gl_reads_las(tmp_path: Path) -> None:
    node = client("node", "nodejs")
    if not (NODE_MODULES / "@loaders.gl" / "las").is_dir():
        pytest.skip("needs npm's @loaders.gl/core and @loaders.gl/las: sh .ci/node-packages")
    (tmp_path / "node_modules").symlink_to(NODE_MODULES)
    (tmp_path / "read.mjs").write_text(LOADERS)
    places = np.array(json.loads(run(node, str(tmp_path / "read.mjs"), str(written(tmp_path, ".las"))))).reshape(-1, 3)
    measured = np.isfinite(SCAN.height)
    x, y = np.meshgrid(GRID.x_mm, GRID.y_mm)
    truth = np.stack([x[measured], y[measured], SCAN.height[measured].astype(np.float64)], axis=1)
    np.testing.assert_allclose(places * 1000, truth, atol=0.51e-6)  # steps of 1 nm


@pytest.mark.parametrize("what", ["scan", "change"])
def test_the_cf_checker_has_nothing_to_say(tmp_path: Path, what: str) -> None:
    pytest.importorskip("compliance_checker")
    file = tmp_path / "map.nc"
    if what == "scan":
        write_height_map(SCAN, file)
    else:
        write_change(change_of(SCAN, surface(0)), SCAN.time, file)
    # in a process of its own: the checker's libraries warn
    program = Path(sys.executable).with_name("compliance-checker")
    told = run(str(program), "--test=cf:1.11", "--criteria", "strict", str(file))
    assert "All tests passed!" in told, told

"""Real terrain and its blurred, shifted copy: the offset that others publish, 3 columns and 5 rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipelines import Scan
from pipelines.change import register
from storage import read_raster
from tests.pipelines.change.scans import scan_of

CELL = 90.0
"""Metres, as the published offset counts them; the files are in degrees."""


def terrain(file: Path) -> Scan:
    """Rows from the north down, as both files begin in one corner; heights in metres, good to one."""
    height = read_raster(file).height[::-1] / 1000
    return scan_of(height[:995, :997], CELL, sigma=1.0, texture=np.zeros((995, 997)))


def test_the_published_offset_is_found(shared_data: Path) -> None:
    folder = shared_data / "change" / "srtm"
    before, after = (terrain(folder / f"{name}.tif") for name in ("srtm_ref", "srtm_blurred_and_shifted"))
    motion = register(after, before)
    middle = np.array([CELL * 997 / 2, CELL * 995 / 2, float(before.height.mean()), 1.0])
    x, y, z = (motion.matrix @ middle - middle)[:3]
    print(f"srtm: {x / CELL:.5f} columns, {y / CELL:.5f} rows, {z:.4f} m; {motion.verdict} {motion.reason}")
    assert motion.verdict != "failed"
    assert abs(x / CELL - 3) <= 0.01
    assert abs(y / CELL - 5) <= 0.01
    assert abs(z - -0.01765) <= 0.002  # xdem 0.2.3's LZD on the same cells: -0.01787


def test_degrees_are_taken_as_metres_on_the_ellipsoid(shared_data: Path) -> None:
    raster = read_raster(shared_data / "change" / "srtm" / "srtm_ref.tif")
    # 3 arc seconds at 39.5833 degrees north by pyproj's Geod(ellps="WGS84").inv, in metres
    assert raster.pitch_mm[0] == pytest.approx(71592.17851752057, rel=1e-6)
    assert raster.pitch_mm[1] == pytest.approx(92522.1970066478, rel=1e-6)
    assert "lies in degrees" in raster.note

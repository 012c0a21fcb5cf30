"""Height maps of other programs: real instruments' published roughness, clouds laid onto cells, every format back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from configs import InputError
from pipelines import Grid
from storage import read_height_map, read_raster, scan_of, write_change, write_height_map

from .ticks import GRID, change_of, surface

PUBLISHED = [
    # file, rms height in m as published with it, side of a cell in mm
    ("al3d-1.al3d", 7.688265843e-06, 4.38027e-4),
    ("bcrf-1.bcrf", 24.5602107e-9, 1777404.0e-6 / 960),
    ("matrix-3.txt", 3.5222919e-08, 10e-3 / 256),
    ("tmd-1.tmd", 0.0743413e-3, 18.956600189 / 300),
    ("x3p-2.x3p", 7.728e-08, 1.27656509837e-4),
]


@pytest.mark.parametrize(("name", "rms_m", "pitch_mm"), PUBLISHED)
def test_real_instruments_give_their_published_rms_height(
    shared_data: Path, name: str, rms_m: float, pitch_mm: float
) -> None:
    pytest.importorskip("SurfaceTopography")
    raster = read_raster(shared_data / "surfaces" / name)
    digits = len(f"{rms_m:.12g}".split("e")[0].replace(".", "").rstrip("0").lstrip("0"))
    rms = float(np.sqrt(np.mean((raster.height - raster.height.mean()) ** 2))) / 1000
    assert rms == pytest.approx(rms_m, rel=0.51 * 10.0 ** (1 - digits))
    assert raster.pitch_mm[0] == pytest.approx(pitch_mm, rel=1e-6)
    assert (raster.time, raster.local) == (None, None)  # the one date among them, 1970, is no time


def test_cells_that_are_no_squares_become_squares_of_their_smaller_side(shared_data: Path) -> None:
    pytest.importorskip("SurfaceTopography")
    file = shared_data / "surfaces" / "x3p-2.x3p"
    scan, raster = read_height_map(file), read_raster(file)
    assert scan.grid.pitch_mm == raster.pitch_mm[0] < raster.pitch_mm[1]
    assert scan.grid.columns == 650
    assert scan.grid.rows == pytest.approx(649 * raster.pitch_mm[1] / raster.pitch_mm[0] + 1, abs=0.5)
    # rows of the file lie between rows of the grid: each cell lies between its neighbours in the file
    row = (scan.grid.y_mm[700] - raster.corner_mm[1]) / raster.pitch_mm[1]
    near = raster.height[int(row) : int(row) + 2]
    assert (scan.height[700] <= near.max(axis=0) + 1e-9).all()
    assert (scan.height[700] >= near.min(axis=0) - 1e-9).all()


@pytest.mark.parametrize("suffix", [".gsf", ".x3p", ".las", ".ply"])
def test_what_we_write_comes_back(tmp_path: Path, suffix: str) -> None:
    if suffix == ".x3p":
        pytest.importorskip("SurfaceTopography")
    scan = surface(3)
    write_height_map(scan, tmp_path / f"map{suffix}")
    raster = read_raster(tmp_path / f"map{suffix}", grid=GRID)
    back = scan_of(raster, tmp_path, scan.time, GRID if suffix != ".x3p" else None)  # X3P's reader drops the place
    assert back.grid.shape == GRID.shape
    assert back.grid.pitch_mm == pytest.approx(GRID.pitch_mm, rel=1e-9)
    np.testing.assert_array_equal(np.isnan(back.height), np.isnan(scan.height))
    np.testing.assert_allclose(back.height, scan.height, atol=0.6e-6, rtol=2e-7)
    if suffix != ".x3p":
        assert raster.time == scan.time


@pytest.mark.parametrize("suffix", [".npz", ".nc", ".tif", ".gsf", ".las", ".ply", ".x3p"])
def test_a_change_comes_back_as_heights(tmp_path: Path, suffix: str) -> None:
    if suffix == ".x3p":
        pytest.importorskip("SurfaceTopography")
    change = change_of(surface(3), surface(0))
    write_change(change, surface(3).time, tmp_path / f"dz{suffix}")
    back = read_raster(tmp_path / f"dz{suffix}", grid=GRID)
    np.testing.assert_allclose(back.height, change.dz, atol=0.6e-6, rtol=2e-7)


@pytest.mark.parametrize(
    ("unit", "per_mm", "separator", "head"),
    [("mm", 1.0, " ", ""), ("m", 1e-3, ",", "x,y,z\n"), ("um", 1e3, "\t", "# a\n")],
)
def test_a_cloud_in_text_is_the_mean_of_the_points_in_each_cell(
    tmp_path: Path, unit: str, per_mm: float, separator: str, head: str
) -> None:
    rng = np.random.default_rng(5)
    grid = Grid(6, 8, 0.5, -1.0, 2.0)
    x, y = rng.uniform(-1.24, 2.74, 2000), rng.uniform(1.76, 4.74, 2000)
    z = 0.2 * x + rng.normal(0, 0.01, 2000)
    lines = (separator.join(f"{value * per_mm:.9g}" for value in point) for point in zip(x, y, z, strict=True))
    (tmp_path / "cloud.xyz").write_text(head + "\n".join(lines))
    raster = read_raster(tmp_path / "cloud.xyz", grid=grid, unit=unit)
    inside = (np.abs(x - 0.5) < 0.25) & (np.abs(y - 3.0) < 0.25)
    assert raster.height[2, 3] == pytest.approx(z[inside].mean(), abs=1e-7)
    assert raster.layers["sigma"][2, 3] == pytest.approx(z[inside].std(ddof=1) / np.sqrt(inside.sum()), rel=1e-5)
    own = read_raster(tmp_path / "cloud.xyz", unit=unit)
    # by itself the cells are the next of 1, 2, 5 above the spacing of the points
    assert own.pitch_mm[0] == pytest.approx(0.1)
    assert np.isfinite(own.height).mean() > 0.5


def test_a_map_on_another_grid_is_interpolated_and_holes_grow_rather_than_shrink(tmp_path: Path) -> None:
    scan = surface(0)
    plane = 0.3 * GRID.x_mm[None, :] - 0.1 * GRID.y_mm[:, None]
    height = np.where(np.isnan(scan.height), np.nan, plane).astype(np.float32)
    np.savez(tmp_path / "a.npz", height=height, pitch_mm=GRID.pitch_mm, x0_mm=GRID.x0_mm, y0_mm=GRID.y0_mm)
    grid = Grid(31, 40, 0.03, GRID.x0_mm + 0.011, GRID.y0_mm + 0.007)
    laid = scan_of(read_raster(tmp_path / "a.npz"), tmp_path, scan.time, grid)
    truth = 0.3 * grid.x_mm[None, :] - 0.1 * grid.y_mm[:, None]
    found = np.isfinite(laid.height)
    np.testing.assert_allclose(laid.height[found], np.broadcast_to(truth, grid.shape)[found], atol=1e-6)
    assert found.mean() > 0.85
    in_hole = (grid.y_mm[:, None] < GRID.y_mm[3]) & (grid.x_mm[None, :] < GRID.x_mm[4])
    np.testing.assert_array_equal(~found, in_hole)
    with pytest.raises(InputError, match="lies beside the store's cells"):
        scan_of(read_raster(tmp_path / "a.npz"), tmp_path, scan.time, Grid(4, 4, 0.1, 50.0, 50.0))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("map.gsf", b"Gwyddion", "is no Gwyddion Simple Field"),
        ("cloud.xyz", b"a b c\n", "holds no line of x y z"),
        ("cloud.ply", b"plx\n", "is no readable .ply"),
        ("cloud.las", b"LASX", "is no readable .las"),
        ("map.sur", b"none", "is no instrument file that can be read"),
        ("cloud.csv", b"1,2,3\n", "its points lie on a line: give --pitch-mm"),
    ],
)
def test_files_that_are_not_what_their_name_says(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    if name == "map.sur":
        pytest.importorskip("SurfaceTopography")
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_raster(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_netcdf_4(tmp_path: Path) -> None:
    pytest.importorskip("h5netcdf")
    import xarray as xr

    write_height_map(surface(0), tmp_path / "three.nc")
    with xr.open_dataset(tmp_path / "three.nc", engine="scipy") as data:
        data.load().to_netcdf(tmp_path / "four.nc", engine="h5netcdf")
    np.testing.assert_array_equal(read_raster(tmp_path / "four.nc").height, surface(0).height)

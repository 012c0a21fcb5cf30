"""Files for other programs: written, read back, and read by the libraries that those programs use."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tifffile
import xarray as xr

from configs import InputError
from pipelines import PointMap, Shared
from storage import create_store, read_height_map, read_points, write_height_map, write_points, write_series

from .ticks import GRID, METRICS, surface, tick


@pytest.mark.parametrize("suffix", [".npz", ".nc", ".tif", ".tiff"])
def test_a_height_map_comes_back(tmp_path: Path, suffix: str) -> None:
    scan = surface(3)
    write_height_map(scan, tmp_path / f"map{suffix}")
    back = read_height_map(tmp_path / f"map{suffix}")
    assert back.grid.shape == GRID.shape
    for name in ("pitch_mm", "x0_mm", "y0_mm"):
        assert getattr(back.grid, name) == pytest.approx(getattr(GRID, name), abs=1e-9)
    np.testing.assert_allclose(back.height, scan.height, rtol=2e-7)
    assert (back.time, back.calibration_id) == (scan.time, "first")
    if not suffix.startswith(".tif"):
        np.testing.assert_array_equal(back.sigma, scan.sigma)
        np.testing.assert_array_equal(back.texture, scan.texture)
        np.testing.assert_array_equal(back.level, scan.level)
    assert [path.name for path in tmp_path.iterdir()] == [f"map{suffix}"]


def test_npz_holds_what_the_design_says(tmp_path: Path) -> None:
    write_height_map(surface(0), tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz") as data:
        np.testing.assert_array_equal(data["height"], surface(0).height)
        assert float(data["pitch_mm"]) == 0.05


def test_netcdf_is_cf(tmp_path: Path) -> None:
    write_height_map(surface(0), tmp_path / "map.nc")
    with xr.open_dataset(tmp_path / "map.nc", engine="scipy") as data:
        assert data.attrs["Conventions"] == "CF-1.11"
        assert data["height"].dims == ("y", "x")
        assert {data[name].attrs["units"] for name in ("height", "sigma", "x", "y")} == {"mm"}
        assert abs(data["time"].values - surface(0).time) < np.timedelta64(1, "us")
        data.load()


def test_geotiff_is_north_up_in_metres(tmp_path: Path) -> None:
    scan = surface(0)
    write_height_map(scan, tmp_path / "map.tif")
    with tifffile.TiffFile(tmp_path / "map.tif") as tiff:
        page = tiff.pages.first
        tags = page.geotiff_tags
        assert tags is not None
        values = page.asarray()
    assert values.dtype == np.float32
    assert tags["ModelPixelScale"][:2] == pytest.approx([5e-5, 5e-5])
    assert tags["ModelTiepoint"][3:5] == pytest.approx([-0.725e-3, (-0.4 + 19.5 * 0.05) * 1e-3])
    np.testing.assert_allclose(values[-1], scan.height[0] / 1000, rtol=1e-6)


def test_ply_is_a_mesh_with_the_hole_left_open(tmp_path: Path) -> None:
    import open3d

    scan = surface(0)
    write_height_map(scan, tmp_path / "map.ply")
    mesh = open3d.io.read_triangle_mesh(tmp_path / "map.ply")
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    measured = np.isfinite(scan.height)
    assert len(vertices) == measured.sum()
    np.testing.assert_allclose(vertices[:, 2], scan.height[measured], rtol=1e-6)
    np.testing.assert_allclose(np.asarray(mesh.vertex_colors)[:, 0] * 255, scan.texture[measured], atol=0.5)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()
    # all cells less the hole of 3 x 4 in a corner, and the triangle across the corner that the hole leaves
    area = normals[:, 2].sum() / 2
    assert area == pytest.approx((19 * 29 - 3 * 4) * 0.05**2, rel=1e-5)


def _points() -> PointMap:
    rng = np.random.default_rng(0)
    xyz = rng.normal(size=(6, 8, 3)).astype(np.float32)
    sigma = np.full((6, 8), 0.01, np.float32)
    xyz[0], sigma[0] = np.nan, np.nan
    byte = np.arange(48, dtype=np.uint8).reshape(6, 8)
    return PointMap(xyz, sigma, rng.uniform(0, 500, (6, 8, 2)).astype(np.float32), byte, byte, Shared(2e-7, 3e-8))


def test_points(tmp_path: Path) -> None:
    import open3d

    points = _points()
    write_points(points, tmp_path / "points.npz")
    with np.load(tmp_path / "points.npz") as data:
        assert set(data.files) == {"xyz", "sigma_z", "projector", "level", "texture", "shared"}
        np.testing.assert_array_equal(data["xyz"], points.xyz)
        np.testing.assert_array_equal(data["projector"], points.projector)
        np.savez(tmp_path / "older.npz", **{name: data[name] for name in data.files if name != "shared"})
    assert read_points(tmp_path / "points.npz").shared == points.shared
    assert read_points(tmp_path / "older.npz").shared == Shared()
    write_points(points, tmp_path / "points.ply")
    cloud = open3d.io.read_point_cloud(tmp_path / "points.ply")
    np.testing.assert_array_equal(np.asarray(cloud.points), points.xyz[points.valid])


def test_series(tmp_path: Path) -> None:
    store = create_store("memory", site="x", grid=GRID, metrics=METRICS, kind="memory")
    for number in range(3):
        store.append(tick(number))
    series = store.series()
    write_series(series, tmp_path / "series.csv")
    lines = (tmp_path / "series.csv").read_text().splitlines()
    assert lines[0] == ("time,scan,net_volume [mm3],net_volume_sigma [mm3],edge_lift [mm],edge_lift_sigma [mm]")
    assert lines[2] == "2026-11-23T03:00:01.500000007Z,1,-1.5,0.25,0.01,"
    write_series(series, tmp_path / "series.parquet")
    back = pd.read_parquet(tmp_path / "series.parquet")
    pd.testing.assert_frame_equal(back, series)
    assert back.attrs["units"] == METRICS


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("map.npz", None, "no such file"),
        ("map.jpg", b"x", "cannot be read from '.jpg': give one of .npz"),
        ("map.npz", b"not a zip file", "map.npz: is no readable"),
        ("map.nc", b"not a netcdf file", "map.nc: is no readable"),
        ("map.nc", b"\x89HDF and so on", "map.nc: is no readable"),
        ("map.tif", b"not a tiff file", "map.tif: is no readable"),
    ],
)
def test_files_that_are_no_height_map(tmp_path: Path, name: str, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_height_map(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_files_that_lack_something(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", height=surface(0).height)
    with pytest.raises(InputError, match="holds no 'pitch_mm'"):
        read_height_map(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", height=np.zeros(5), pitch_mm=1.0)
    with pytest.raises(InputError, match="must be \\(row, column\\)"):
        read_height_map(tmp_path / "a.npz")
    tifffile.imwrite(tmp_path / "plain.tif", np.zeros((4, 5), np.float32))
    with pytest.raises(InputError, match="no pixel scale"):
        read_height_map(tmp_path / "plain.tif")
    data = xr.Dataset({"height": (("y", "x"), np.zeros((3, 4)))}, coords={"x": [0.0, 1, 2, 4], "y": [0.0, 2, 4]})
    (tmp_path / "odd.nc").write_bytes(data.to_netcdf(engine="scipy"))
    with pytest.raises(InputError, match="not of one size"):
        read_height_map(tmp_path / "odd.nc")


def test_a_foreign_netcdf_in_metres_with_y_downward(tmp_path: Path) -> None:
    metres = {"units": "m"}
    data = xr.Dataset(
        {"elevation": (("y", "x"), np.arange(6.0).reshape(3, 2), metres)},
        coords={"x": ("x", [0.001, 0.002], metres), "y": ("y", [0.003, 0.002, 0.001], metres)},
    )
    (tmp_path / "dem.nc").write_bytes(data.to_netcdf(engine="scipy"))
    scan = read_height_map(tmp_path / "dem.nc")
    assert (scan.grid.pitch_mm, scan.grid.x0_mm, scan.grid.y0_mm) == pytest.approx((1.0, 1.0, 1.0))
    np.testing.assert_allclose(scan.height, [[4000, 5000], [2000, 3000], [0, 1000]])
    assert np.isnan(scan.sigma).all()


def test_nowhere_to_write(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist: make it first"):
        write_height_map(surface(0), tmp_path / "nowhere" / "map.npz")
    with pytest.raises(InputError, match=r"choose one of \.npz, \.nc"):
        write_height_map(surface(0), tmp_path / "map.docx")


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "map.npz"
    write_height_map(surface(0), file)
    before = file.read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(InputError, match=r"map.npz: cannot be written: No space left"):
        write_height_map(replace(surface(0), calibration_id="x"), file)
    assert file.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["map.npz"]

"""Scans, changes and points as clouds and meshes: PLY in mm, LAS 1.2 in metres."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pipelines import PointMap, format_instant

from .exported import MM_PER_M, Exported

__all__ = ["las", "mesh", "points_ply"]


def las(exported: Exported, file: Path) -> None:
    """Write the measured cells as LAS 1.2: metres in steps of 1 nm (larger beyond 2 m), sigma as an extra dimension.

    LAS knows days only: time, pitch and calibration are JSON in a record of user ``microrelief``.
    """
    import laspy

    grid = exported.grid
    measured = np.isfinite(exported.cells)
    x, y = np.meshgrid(grid.x_mm, grid.y_mm)
    places = np.stack([x[measured], y[measured], exported.cells[measured].astype(np.float64)], axis=1) / MM_PER_M
    reach = float(np.abs(places).max(initial=0.0))
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales = np.full(3, 10.0 ** max(-9, int(np.ceil(np.log10(max(reach, 1e-9) / 2e9)))))
    header.generating_software = "microrelief"
    header.creation_date = exported.time.astype("datetime64[D]").item()
    header.add_extra_dim(laspy.ExtraBytesParams("sigma", "f4", "standard uncertainty, m"))
    about = {
        "time": format_instant(exported.time),
        "pitch_mm": grid.pitch_mm,
        "calibration_id": exported.calibration_id,
        "what": exported.title,
    }
    header.vlrs.append(laspy.VLR("microrelief", 1, "JSON", json.dumps(about).encode()))
    data = laspy.LasData(header)
    data.x, data.y, data.z = places.T
    data.intensity = exported.texture[measured].astype(np.uint16) * 257
    data.sigma = exported.sigma[measured] / np.float32(MM_PER_M)
    with file.open("wb") as handle:
        data.write(handle, do_compress=False)


def mesh(exported: Exported, file: Path) -> None:
    """Write triangles between measured neighbours: a hole stays a hole."""
    measured = np.isfinite(exported.cells)
    x, y = np.meshgrid(exported.grid.x_mm, exported.grid.y_mm)
    number = np.full(measured.shape, -1, dtype=np.int32)
    number[measured] = np.arange(np.count_nonzero(measured), dtype=np.int32)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    lower = (a >= 0) & (b >= 0) & (d >= 0)
    upper = (a >= 0) & (d >= 0) & (c >= 0)
    faces = np.concatenate(
        [np.stack([a[lower], b[lower], d[lower]], axis=1), np.stack([a[upper], d[upper], c[upper]], axis=1)]
    )
    xyz = np.stack([x[measured], y[measured], exported.cells[measured]], axis=1)
    _ply(file, xyz, exported.texture[measured], exported.sigma[measured], faces, format_instant(exported.time))


def points_ply(points: PointMap, file: Path) -> None:
    """Write the measured points, mm, camera frame."""
    valid = points.valid
    _ply(file, points.xyz[valid], points.texture[valid], points.sigma_z[valid])


def _ply(
    file: Path,
    xyz: npt.NDArray[Any],
    texture: npt.NDArray[np.uint8],
    sigma: npt.NDArray[np.float32],
    faces: npt.NDArray[np.int32] | None = None,
    when: str = "",
) -> None:
    """Binary PLY: x y z mm, grey as colour, sigma as `quality` (the name that CloudCompare and MeshLab show)."""
    vertex = np.empty(len(xyz), dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3), ("quality", "<f4")])
    vertex["xyz"], vertex["rgb"], vertex["quality"] = xyz, texture[:, np.newaxis], sigma
    lines = ["ply", "format binary_little_endian 1.0", "comment microrelief, mm"]
    lines += [f"comment time {when}"] if when else []
    lines += [f"element vertex {len(xyz)}"]
    lines += [f"property float {name}" for name in "xyz"]
    lines += [f"property uchar {name}" for name in ("red", "green", "blue")]
    lines.append("property float quality")
    if faces is not None:
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    with file.open("wb") as handle:
        handle.write("\n".join([*lines, "end_header", ""]).encode())
        handle.write(vertex.tobytes())
        if faces is not None:
            face = np.empty(len(faces), dtype=[("count", "u1"), ("vertices", "<i4", 3)])
            face["count"], face["vertices"] = 3, faces
            handle.write(face.tobytes())

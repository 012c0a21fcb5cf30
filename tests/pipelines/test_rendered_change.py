"""The rendered captures, calibrated from their own poses: what changed between t0 and t1, against exact truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from pipelines import Scan, parse_instant
from pipelines.change import Comparison, compare, crack_mask, crack_openings, find_deposits, rim_slope
from pipelines.change.curl import EDGE_BAND_MM, crack_distance
from pipelines.reconstruction import Board, calibrate, footprint_grid, reconstruct, to_scan
from storage import read_capture, read_patterns

Floats = npt.NDArray[np.float64]


class Rendered:
    """Both epochs compared, and where the site frame lies in the world of the truth."""

    def __init__(self, folder: Path) -> None:
        patterns = read_patterns(folder / "patterns.yaml")
        poses = [read_capture(folder / "calib" / f"pose{k}", patterns) for k in (0, 2, 4, 6, 8)]
        calibration = calibrate(poses, Board((15, 8), 0.85))
        grid = footprint_grid(calibration)
        scans: list[Scan] = []
        for epoch in (0, 1):
            points = reconstruct(read_capture(folder / f"t{epoch}", patterns), calibration)
            scans.append(to_scan(points, calibration, grid, parse_instant(f"2026-01-01T0{epoch}:00:00Z")))
        camera = json.loads((folder / "rig_truth.json").read_text(encoding="utf-8"))["camera"]
        rotation, shift = np.array(camera["R_world_to_device"]), np.array(camera["t_mm"])
        to_camera = np.linalg.inv(np.vstack([calibration.reference, [0, 0, 0, 1]]))
        to_world = np.eye(4)
        to_world[:3, :3], to_world[:3, 3] = rotation.T, -rotation.T @ shift
        self.to_world = to_world @ to_camera
        self.before, self.after = scans
        x, y = np.meshgrid(grid.x_mm, grid.y_mm)
        wx, wy = self.world(x.ravel(), y.ravel(), np.nan_to_num(self.before.height.ravel()))
        self.plate = ((wx > 2.6) & (wx < 7.9) & (np.abs(wy) < 4.3)).reshape(grid.shape)
        self.ground = ((wx > 7) & (np.abs(wy) < 4.3)).reshape(grid.shape)
        self.comparison: Comparison = compare(self.after, self.before, self.ground)

    def world(self, x: Floats, y: Floats, z: Floats | float = 0.0) -> tuple[Floats, Floats]:
        return self.place(x, y, z)[:2]

    def place(self, x: Floats, y: Floats, z: Floats | float) -> tuple[Floats, Floats, Floats]:
        found = self.to_world @ np.stack([x, y, np.broadcast_to(z, x.shape), np.ones_like(x)])
        return found[0], found[1], found[2]


@pytest.fixture(scope="module")
def rendered(shared_data: Path) -> Rendered:
    return Rendered(shared_data / "rendered")


def test_the_rig_did_not_move(rendered: Rendered) -> None:
    motion = rendered.comparison.change.motion
    assert motion.verdict == "good", motion.reason
    assert np.hypot(*motion.shift_mm[:2]) < 0.003
    assert abs(motion.shift_mm[2]) < 0.003


def test_both_deposits_are_found_within_two_percent(rendered: Rendered) -> None:
    found = find_deposits(rendered.comparison.change, rendered.plate, rendered.ground)
    assert len(found) == 2
    for deposit, (volume, x, y) in zip(found, ((0.6434, 5.2, 1.6), (-0.3186, 5.4, -2.3)), strict=True):
        assert deposit.volume.value == pytest.approx(volume, rel=0.02)
        assert abs(deposit.volume.value - volume) < 3 * deposit.volume.sigma
        wx, wy = rendered.world(np.array([deposit.x_mm]), np.array([deposit.y_mm]))
        assert wx[0] == pytest.approx(x, abs=0.15)  # the calibrated scale and origin are in it
        assert wy[0] == pytest.approx(y, abs=0.15)


def test_the_crack_widens_as_it_did(rendered: Rendered, shared_data: Path) -> None:
    """Gap along x, row by row over |y| < 4.2 mm, as the truth's plan_gap; the mean of both, and their difference."""
    along_x = rendered.to_world[:3, :3].T @ [1.0, 0.0, 0.0]
    rows = np.linspace(-4.2, 4.2, 421)  # a cell wide
    profiles, truths = [], []
    for epoch, scan in enumerate((rendered.before, rendered.comparison.scan)):
        found = crack_openings(scan, crack_mask(scan), across=(float(along_x[0]), float(along_x[1])))
        _, y = rendered.world(found.x_mm, found.y_mm)
        at = np.where(np.isfinite(found.opening_mm), np.digitize(y, rows), 0)
        here = [found.opening_mm[at == k] for k in range(1, rows.size)]
        profiles.append(np.array([np.median(gaps) if gaps.size else np.nan for gaps in here]))
        with np.load(shared_data / "rendered" / f"t{epoch}" / "truth_crack.npz") as kept:
            truths.append(np.interp((rows[1:] + rows[:-1]) / 2, kept["y"], kept["plan_gap"]))
    for profile, truth in zip(profiles, truths, strict=True):
        off = (profile - truth)[np.isfinite(profile)]
        rms, bias = float(np.sqrt(np.mean(off**2))), float(off.mean())
        print(f"{off.size} rows: {1000 * rms:.1f} um rms, {1000 * bias:+.1f} um in the mean")
        assert off.size > 0.9 * profile.size
        assert rms < 0.02  # a cell
        assert abs(bias) < 0.01
    change = profiles[1] - profiles[0]
    both = np.isfinite(change)
    wider = float((truths[1] - truths[0]).mean())
    assert wider == pytest.approx(0.176, abs=0.001)
    print(f"wider by {change[both].mean():.4f} mm, the truth is {wider:.4f}")
    assert change[both].mean() == pytest.approx(wider, abs=0.005)


def test_the_left_edge_turns_up_as_it_did(rendered: Rendered, shared_data: Path) -> None:
    """Slope of the edge band of the left plate, piece by piece of 0.4 mm, against the truth's tip angle.

    The mean over the edge is right; a piece has the slopes of its own grains, too, as the true surface has.
    """
    grid = rendered.before.grid
    x, y = np.meshgrid(grid.x_mm, grid.y_mm)
    for epoch, scan in enumerate((rendered.before, rendered.comparison.scan)):
        seen = np.isfinite(scan.height)
        wx, wy, wz = (
            axis.reshape(grid.shape)
            for axis in rendered.place(x.ravel(), y.ravel(), np.nan_to_num(scan.height).ravel().astype(np.float64))
        )
        with np.load(shared_data / "rendered" / f"t{epoch}" / "truth_crack.npz") as kept:
            middle = np.interp(wy, kept["y"], (kept["left_tip_x"] + kept["right_edge_x"]) / 2)
            angle = np.interp(wy, kept["y"], kept["tip_angle_deg"])
        crack = crack_mask(scan)
        distance = crack_distance(crack, grid.pitch_mm)
        rim = seen & ~crack & (wx < middle) & (distance > EDGE_BAND_MM[0]) & (distance < EDGE_BAND_MM[1])
        off = []
        for low in np.arange(-4.2, 4.15, 0.4):
            here = rim & (wy >= low) & (wy < low + 0.4)
            off.append(rim_slope(wz[here], distance[here]) - float(angle[here].mean()))
        print(f"epoch {epoch}: {np.mean(off):+.2f} degrees in the mean, {np.std(off):.1f} from piece to piece")
        assert len(off) == 21
        assert abs(np.mean(off)) < 1.5

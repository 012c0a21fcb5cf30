"""A registration that cannot be trusted is flagged, always; one on a surface that mostly changes finds what stands."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from pipelines.change import compare, register
from pipelines.change.drift import lateral_drift
from storage import read_height_map
from tests.pipelines.change.scans import bumps, sampled, scan_of, soil_scan

SHAPE = (160, 200)


def other_surface(seed: int) -> npt.NDArray[np.float64]:
    return sampled(bumps(seed=seed), *SHAPE)


@settings(max_examples=12, deadline=None)
@given(
    st.sampled_from(["flat", "no overlap", "everything moved", "noise", "heaved", "one direction"]),
    st.integers(0, 2**31),
)
def test_it_is_flagged(case: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    noise = random.normal(0, 0.002, (2, *SHAPE))
    before = other_surface(seed % 1000)
    after = before.copy()
    if case == "flat":
        before = after = np.zeros(SHAPE)
    elif case == "no overlap":
        after[:, 50:] = np.nan
    elif case == "everything moved":
        after = other_surface(seed % 1000 + 1)
    elif case == "noise":
        after = random.normal(0, 0.05, SHAPE)
    elif case == "heaved":
        heave = ndimage.gaussian_filter(random.normal(size=SHAPE), 25)
        after = before + 0.1 * heave / heave.std()
    else:
        before = after = sampled(lambda x, _: 0.05 * np.sin(2 * np.pi * x / 0.3), *SHAPE)
    motion = register(scan_of(after + noise[1], hour=1), scan_of(before + noise[0]))
    assert motion.verdict != "good", case
    assert motion.reason


@pytest.mark.parametrize("seed", [174, 190, 192, 201])
def test_no_shift_is_made_of_noise(seed: int) -> None:
    """Flat surfaces whose noise by chance agrees best at one shift, more than half as well again as at any other."""
    before, after = np.random.default_rng(seed).normal(0, 0.002, (2, *SHAPE))
    drift = lateral_drift(scan_of(after, hour=1), scan_of(before), np.ones(SHAPE, np.bool_))
    assert np.isnan([drift.dx_mm, drift.dy_mm]).all()
    assert drift.conditioning == 0


def test_what_stands_is_found_on_soil_that_changes(shared_data: Path) -> None:
    """Real curl and cracks of `soils/a`, t0 to t1, a rig that drifted, all but the frame settled by 40 um."""
    before, _, _ = soil_scan(shared_data, "a", 0)
    after, _, _ = soil_scan(shared_data, "a", 1)
    pitch = before.grid.pitch_mm
    frame = np.ones(before.grid.shape, dtype=np.bool_)
    margin = before.grid.rows // 8
    frame[margin:-margin, margin:-margin] = False
    assert frame.mean() <= 0.5
    height = np.where(frame, before.height, after.height - 0.04)
    shift = 1.7, -2.4  # cells along y and x
    height = ndimage.shift(np.nan_to_num(height), shift, order=3, mode="nearest")
    height += np.random.default_rng(0).normal(0, 0.003, height.shape) + 0.1
    found = compare(scan_of(height, pitch, sigma=0.003, hour=1), before, frame).change
    assert found.motion.verdict != "failed", found.motion.reason
    x, y, _ = found.motion.shift_mm
    print(f"lateral {x / pitch + shift[1]:+.3f}, {y / pitch + shift[0]:+.3f} px")
    assert abs(x / pitch + shift[1]) <= 0.1
    assert abs(y / pitch + shift[0]) <= 0.1
    hidden = float(np.nanmedian(found.dz[~frame])) - float(
        np.nanmedian(after.height[~frame] - 0.04 - before.height[~frame])
    )
    print(f"settlement hidden: {1000 * hidden:+.2f} um")
    assert abs(hidden) <= 0.002


def test_what_stands_is_found_on_a_measured_surface_that_changes(shared_data: Path) -> None:
    """Relief of a GelSight scan, texture of a photograph; over more than half a soil's curl, cracks and settlement."""
    real = read_height_map(shared_data / "surfaces" / "tmd-1.tmd")
    pitch, (rows, columns) = real.grid.pitch_mm, real.grid.shape
    relief = real.height.astype(np.float64)
    photo = cv2.imread(str(shared_data / "kamino410" / "capture_0" / "graycode_40.png"), cv2.IMREAD_GRAYSCALE)
    assert photo is not None
    texture = photo[200 : 200 + rows, 300 : 300 + columns].astype(np.float64)
    _, _, truth = soil_scan(shared_data, "b", 1)
    change = (truth["height_t1"] - truth["height_t0"])[::2, ::2][:rows, :columns] - 0.04
    moving = np.zeros((rows, columns), np.bool_)
    margin = rows // 7
    moving[margin:-margin, margin:-margin] = True
    assert moving.mean() >= 0.5
    assert np.ptp(change) >= 0.1
    after = relief + np.where(moving, change, 0.0)
    shift = -1.35, 2.6  # cells along y and x
    random = np.random.default_rng(1)
    seen = [ndimage.shift(each, shift, order=3, mode="nearest") for each in (after, texture)]
    scans = [
        scan_of(height + random.normal(0, 0.002, height.shape) + lift, pitch, sigma=0.002, texture=light, hour=hour)
        for height, light, lift, hour in ((relief, texture, 0.0, 0), (*seen, 0.3, 1))
    ]
    found = compare(scans[1], scans[0], ~moving).change
    x, y, _ = found.motion.shift_mm
    off = x / pitch + shift[1], y / pitch + shift[0]
    inside = np.zeros_like(moving)
    inside[margin + 4 : -margin - 4, margin + 4 : -margin - 4] = True
    hidden = float(np.nanmean(found.dz[inside]) - change[inside].mean())
    print(f"{found.motion.verdict}: lateral {off[0]:+.3f}, {off[1]:+.3f} px, settlement hidden {1000 * hidden:+.2f} um")
    assert found.motion.verdict == "good", found.motion.reason
    assert max(np.abs(off)) <= 0.1
    assert abs(hidden) <= 0.002

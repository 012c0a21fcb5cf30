"""Resolution on charts whose blur is known in closed form: within 5 %, by edges and by bars."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines import Frames, PatternSet, parse_instant
from pipelines.reconstruction import (
    ContrastCurve,
    depth_of_field,
    edge_contrast,
    find_edge,
    object_pixel_um,
    stripe_contrast,
    usaf_contrast,
    usaf_line_um,
)

from .charts import bars, edge, transfer, true_resolution_um
from .exact_rig import make_rig

NOON = parse_instant("2026-11-22T12:00:00Z")


@pytest.mark.parametrize("sigma", [1.2, 2.0, 4.0, 6.0])
@pytest.mark.parametrize(("tilt", "lying"), [(3.0, False), (-7.0, True), (12.0, False), (-5.0, False)])
def test_an_edge_tells_the_resolution(sigma: float, tilt: float, lying: bool) -> None:
    curve = edge_contrast(edge((160, 150), sigma, tilt, lying=lying), 3.9, (10, 10, 130, 140))
    assert curve.resolution_um() == pytest.approx(true_resolution_um(sigma, 3.9), rel=0.05)
    assert curve.reaches()
    assert curve.tilt_deg == pytest.approx(abs(tilt), abs=0.1)
    assert np.abs(curve.contrast - transfer(curve.line_um, sigma, 3.9)).max() < 0.02


def test_a_higher_threshold_is_a_wider_line() -> None:
    curve = edge_contrast(edge((160, 160), 2.5, 5.0), 10.0, (0, 0, 160, 160))
    for threshold in (0.05, 0.2, 0.5):
        expected = true_resolution_um(2.5, 10.0, threshold)
        assert curve.resolution_um(threshold) == pytest.approx(expected, rel=0.03)
        assert curve.at(expected) == pytest.approx(threshold, abs=0.02)
    assert np.isnan(curve.at(1.0))


def test_noise_is_told_as_uncertainty() -> None:
    found = [
        edge_contrast(edge((160, 160), 2.0, 6.0, noise=3.0, seed=seed), 10.0, (0, 0, 160, 160)) for seed in range(12)
    ]
    widths = [curve.resolution_um(0.05) for curve in found]
    told = float(np.median([curve.uncertainty_um(0.05) for curve in found]))
    assert np.mean(widths) == pytest.approx(true_resolution_um(2.0, 10.0, 0.05), rel=0.05)
    assert told == pytest.approx(np.std(widths), rel=0.6)  # a deviation from 12 draws is itself good to 20 %


def test_a_sharp_image_is_limited_by_its_pixels() -> None:
    curve = edge_contrast(edge((120, 120), 0.4, 8.0), 5.0, (0, 0, 120, 120))
    assert curve.resolution_um() == 5.0
    assert not curve.reaches()
    assert np.isnan(curve.uncertainty_um())


@pytest.mark.parametrize("lying", [False, True])
def test_the_edge_is_found_in_a_picture(lying: bool) -> None:
    picture = np.random.default_rng(3).normal(60, 1.0, (420, 560))
    picture[230:390, 300:460] = edge((160, 160), 1.5, 6.0, lying=lying)
    picture[20:60, 20:200] = np.where(np.arange(180) // 9 % 2, 200, 30)  # straight bars are no slanted edge
    picture[100:104, 100:104] = 255
    column, row, width, height = find_edge(picture.astype(np.uint8))
    assert column >= 290
    assert column + width <= 470
    assert row >= 220
    assert row + height <= 400
    curve = edge_contrast(picture.astype(np.uint8), 10.0)
    assert curve.roi == (column, row, width, height)
    assert curve.resolution_um() == pytest.approx(true_resolution_um(1.5, 10.0), rel=0.05)


def test_pictures_without_such_an_edge() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (200, 200)).astype(np.uint8)
    for picture in (noise, np.full((200, 200), 90, np.uint8), edge((200, 200), 1.5, 0.0)):
        with pytest.raises(ValueError, match="found no straight edge"):
            find_edge(picture)
    with pytest.raises(ValueError, match=r"tilted by 0\.\d degrees only"):
        edge_contrast(edge((100, 100), 1.5, 0.2), 10.0, (0, 0, 100, 100))
    with pytest.raises(ValueError, match="no straight edge in the box"):
        edge_contrast(noise, 10.0, (0, 0, 100, 100))
    with pytest.raises(ValueError, match="leaves the image of 200x200"):
        edge_contrast(noise, 10.0, (150, 0, 100, 100))
    with pytest.raises(ValueError, match="needs 20 px"):
        edge_contrast(noise, 10.0, (0, 0, 10, 100))


@pytest.mark.parametrize("negative", [False, True])
@pytest.mark.parametrize(("sigma", "noise"), [(2.0, 0.3), (2.5, 1.5), (4.0, 1.5)])
def test_bars_tell_the_resolution(sigma: float, noise: float, negative: bool) -> None:
    image, elements = bars(sigma, 3.0, noise, negative=negative)
    curve = usaf_contrast(image, elements, 3.0)
    assert curve.resolution_um() == pytest.approx(true_resolution_um(sigma, 3.0), rel=0.05)
    assert np.abs(curve.contrast - transfer(curve.line_um, sigma, 3.0)).max() < 0.05


def test_bars_and_edge_agree() -> None:
    image, elements = bars(3.0, 3.9)
    by_bars = usaf_contrast(image, elements, 3.9).resolution_um()
    by_edge = edge_contrast(edge((160, 160), 3.0, 5.0), 3.9).resolution_um()
    assert by_bars == pytest.approx(by_edge, rel=0.05)


def test_levels_of_an_image_without_large_areas() -> None:
    image, elements = bars(2.0, 3.0)
    few = {name: elements[name] for name in [*elements][-8:]}
    cut = image.copy()
    cut[:140, :140] = 190  # the only large dark area is gone
    known = usaf_contrast(cut, few, 3.0, (40.0, 190.0))
    assert np.allclose(known.contrast, usaf_contrast(image, few, 3.0, (40.0, 190.0)).contrast)
    assert np.abs(known.contrast - transfer(known.line_um, 2.0, 3.0)).max() < 0.05


def test_line_widths_of_the_usaf_chart() -> None:
    assert usaf_line_um(0, 1) == 500
    assert usaf_line_um(5, 2) == pytest.approx(13.92, abs=0.01)  # the paper rounds it to 15
    assert usaf_line_um(5, 1) == pytest.approx(15.625)
    with pytest.raises(ValueError, match=r"not 5\.7"):
        usaf_line_um(5, 7)


def test_boxes_that_cannot_be() -> None:
    image, elements = bars(2.0, 3.0)
    with pytest.raises(ValueError, match=r"element 4\.1: its box must be 52 px"):
        usaf_contrast(image, {(4, 1): (10, 10, 40, 80)}, 3.0)
    with pytest.raises(ValueError, match="narrower than one pixel"):
        usaf_contrast(image, {(9, 6): (10, 10, 40, 40)}, 3.0)
    with pytest.raises(ValueError, match="no contrast at all"):
        usaf_contrast(np.full((100, 100), 7, np.uint8), {(5, 1): (10, 10, 60, 60)}, 3.0)
    assert elements


def test_depth_of_field_of_a_focus_series() -> None:
    aperture, pixel_um, line_um = 0.006, 4.0, 15.0
    heights = [-6.0, -5.0, -4.0, -2.0, 0.0, 2.0, 4.0, 5.0, 6.0]

    def sigma(z: float) -> float:  # a disc of 2 z NA has a quarter of that as its standard deviation
        return float(np.hypot(1.0, 500 * abs(z) * aperture / pixel_um))

    contrasts = [edge_contrast(edge((160, 160), sigma(z), 6.0), pixel_um).at(line_um) for z in heights]
    found = depth_of_field(heights, contrasts, 0.02)
    assert found is not None
    blur_at_end = np.sqrt(-2 * np.log(0.02)) * line_um / np.pi / pixel_um
    true_half = np.sqrt(blur_at_end**2 - 1) * pixel_um / (500 * aperture)
    assert found.high_mm == pytest.approx(true_half, rel=0.06)
    assert found.low_mm == pytest.approx(-true_half, rel=0.06)
    assert not found.open_low


@settings(max_examples=40, deadline=None)
@given(st.permutations([-3.0, -1.5, 0.0, 2.0]))
def test_a_focus_series_comes_in_any_order(order: list[float]) -> None:
    contrast = {-3.0: 0.0, -1.5: 0.1, 0.0: 0.3, 2.0: 0.1}
    found = depth_of_field(order, [contrast[z] for z in order], 0.05)
    assert found is not None
    assert found.low_mm == pytest.approx(-2.25)
    assert found.high_mm == 2.0
    assert (found.open_low, found.open_high) == (False, True)
    assert depth_of_field(order, [contrast[z] for z in order], 0.5) is None


def test_a_series_of_one_place_is_none() -> None:
    with pytest.raises(ValueError, match="two or more different z"):
        depth_of_field([1.0, 1.0], [0.1, 0.2], 0.02)


def test_a_curve_that_rises_again_counts_to_its_first_fall() -> None:
    line = np.array([100.0, 50.0, 25.0, 20.0])
    curve = ContrastCurve(line, np.array([0.9, 0.01, 0.3, 0.2]), np.zeros(4), 1.0, (0, 0, 9, 9))
    assert 50 < curve.resolution_um() < 100
    with pytest.raises(ValueError, match="line widths that fall"):
        replace(curve, line_um=line[::-1])


def test_the_pixel_comes_from_the_calibration() -> None:
    rig = make_rig()
    assert object_pixel_um(rig) == pytest.approx(50_000 / 2048, rel=1e-3)  # 50 mm off, focal length 2048 px
    assert object_pixel_um(rig, 5.0) == pytest.approx(45_000 / 2048, rel=1e-3)


@pytest.mark.parametrize("lying", [False, True])
def test_stripes_that_noise_hides_are_told_apart_when_integrated(lying: bool) -> None:
    patterns = PatternSet("gray", (64, 64), bits=(6, 0))
    random = np.random.default_rng(2)
    place = np.broadcast_to(np.arange(240) * 64 / 240, (200, 240))
    stack = []
    for role in patterns.roles:
        if role.what == "bit":
            period = 64 / 2**role.index if role.index else 128.0
            depth = 0.05 if role.index == 5 else 1.0
            sign = -1 if role.inverted else 1
            stack.append(30 + 75 * (1 + sign * depth * np.sign(np.sin(2 * np.pi * (place + 0.01) / period))))
        else:
            stack.append(np.full(place.shape, 180.0 if role.what == "white" else 30.0))
    frames = np.clip(np.rint(np.array(stack) + random.normal(0, 6.0, (len(stack), 200, 240))), 0, 255).astype(np.uint8)
    frames = np.ascontiguousarray(frames.transpose(0, 2, 1)) if lying else frames
    found = stripe_contrast(Frames(frames, NOON, patterns))
    assert [each.index for each in found] == [0, 1, 2, 3, 4, 5]
    assert found[1].single == pytest.approx(1.0, abs=0.02)
    finest = found[-1]
    assert finest.integrated == pytest.approx(0.05, abs=0.006)
    assert finest.noise > finest.integrated  # one pixel cannot tell
    assert finest.integrated > 3 * finest.noise_integrated  # 15 along the stripe can

"""The geometry calculator against closed forms, the paper's figures, chance and its own contradictions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipelines.reconstruction import PAPER_SETUP, OpticsSetup, conflicts, work_out
from pipelines.reconstruction.optics import FORMULAS
from pipelines.reconstruction.optics_limits import diffraction_contrast, disc_contrast, overlap_area_mm2

WHOLE = replace(PAPER_SETUP, lens_radius_mm=20.0, filter_mm=2.0, wavelength_nm=550.0, camera_pitch_um=3.0)


def value(setup: OpticsSetup, name: str) -> float:
    found = work_out(setup)[name].value
    assert found is not None
    return found


def said(setup: OpticsSetup) -> str:
    return "\n".join(conflicts(setup, work_out(setup)))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("largest_lens_radius", 27.73),  # the paper's lenses must be smaller
        ("height_over_object", 96.36),
        ("least_theta", 2 * math.degrees(math.atan(0.2))),
        ("lens_gap", 2 * (100 * 0.267238 - 20 * 0.963630)),
        ("free_height", 98 * 0.963630 - 20 * 0.267238),
        ("camera_pixel", 10_000 / 1440),
        ("projector_pixel", 10_000 / 608),
        ("depth_per_camera_pixel", 10_000 / 1440 / 0.600861),
        ("depth_per_projector_pixel", 10_000 / 608 * 0.857167 / 0.515038),
        ("depth_sd_whole_columns", 10_000 / 608 * 0.857167 / 0.515038 / math.sqrt(12)),
        ("cut_off_period", 2.75),
        ("finest_stripe_period", 1.1),
        ("least_na_for_line", 0.009167),
        ("camera_blur", 600.0),
        ("projector_blur", 1500.0),
        ("largest_na_projector", 2 * 10 / 608 / 6),
        ("depth_of_field_by_na", 0.055 + 10 / 1440 / 0.1),
        ("projected_width", 0.3456),
        ("imaged_width", 3.84),
    ],
)
def test_figures_of_the_paper(name: str, expected: float) -> None:
    assert value(WHOLE, name) == pytest.approx(expected, rel=2e-4)


def test_the_papers_nine_centimetres() -> None:
    # 9.64 cm less the rim of the lens and the filter is 9 cm for a lens of 16.6 mm, well below the 27.7 mm that fit
    assert value(replace(WHOLE, lens_radius_mm=16.6), "free_height") == pytest.approx(90, abs=0.05)


@settings(max_examples=50, deadline=None)
@given(st.floats(2, 120), st.floats(5, 500))
def test_lenses_that_just_touch_leave_no_gap(theta: float, distance: float) -> None:
    radius = value(OpticsSetup(theta_deg=theta, working_distance_mm=distance), "largest_lens_radius")
    setup = OpticsSetup(theta_deg=theta, working_distance_mm=distance, lens_radius_mm=radius)
    assert value(setup, "lens_gap") == pytest.approx(0, abs=1e-9 * distance)
    assert value(setup, "least_theta") == pytest.approx(theta)


@pytest.mark.parametrize(
    ("field", "depth", "theta"), [(10.0, 6.0, 31.0), (10.0, 1.0, 31.0), (4.0, 4.0, 90.0), (3.0, 8.0, 20.0)]
)
def test_overlap_is_what_chance_says(field: float, depth: float, theta: float) -> None:
    points = np.random.default_rng(1).uniform(-8, 8, (400_000, 2))
    inside = np.ones(len(points), bool)
    for turn in (-theta / 2, theta / 2):
        c, s = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
        inside &= np.abs(points @ [c, s]) <= field / 2
        inside &= np.abs(points @ [-s, c]) <= depth / 2
    assert overlap_area_mm2(field, depth, theta) == pytest.approx(256 * inside.mean(), rel=0.02)
    setup = OpticsSetup(theta_deg=theta, field_mm=(field, field), depth_of_field_mm=depth)
    flat = np.abs(points[inside & (np.abs(points[:, 1]) < 0.05), 0]).max()
    assert value(setup, "sharp_width") == pytest.approx(2 * flat, rel=0.03)
    high = np.abs(points[inside & (np.abs(points[:, 0]) < 0.05), 1]).max()
    assert value(setup, "sharp_height") == pytest.approx(2 * high, rel=0.03)


def test_thin_strips_overlap_in_a_rhombus() -> None:
    assert overlap_area_mm2(100.0, 1.0, 30.0) == pytest.approx(1 / math.sin(math.radians(30)))


def test_a_smaller_angle_overlaps_more_and_tells_less_depth() -> None:
    narrow, wide = replace(WHOLE, theta_deg=20.0), WHOLE
    assert value(narrow, "overlap_share") > value(wide, "overlap_share")
    assert value(narrow, "depth_per_camera_pixel") > value(wide, "depth_per_camera_pixel")


def test_contrast_limits() -> None:
    assert diffraction_contrast(0.0) == pytest.approx(1)
    assert diffraction_contrast(0.5) == pytest.approx(2 / math.pi * (math.pi / 3 - math.sqrt(3) / 4))
    assert diffraction_contrast(1.0) == diffraction_contrast(2.0) == 0
    # an even disc, integrated strip by strip
    x = np.linspace(-0.5, 0.5, 200_001)
    chord = np.sqrt(0.25 - x**2)
    for cycles in (0.3, 0.9, 2.0):
        expected = abs(np.sum(chord * np.cos(2 * np.pi * cycles * x)) / np.sum(chord))
        assert disc_contrast(cycles) == pytest.approx(expected, abs=1e-4)
    assert disc_contrast(0.0) == 1


def test_neither_limit_is_asserted_both_are_stated() -> None:
    slow = replace(WHOLE, na_camera=0.0055)  # sharp over +-3 mm, but too coarse for 15 um lines
    assert "lines of 15 um have no contrast at NA 0.0055" in said(slow)
    assert value(slow, "contrast_in_focus") == 0
    fast = replace(WHOLE, na_camera=0.02)
    assert value(fast, "contrast_in_focus") > 0.4
    assert value(fast, "contrast_at_depth_end") < 0.1


def test_what_is_missing_is_named_and_not_assumed() -> None:
    figures = work_out(PAPER_SETUP)
    assert figures["lens_gap"].value is None
    assert figures["lens_gap"].missing == ("lens_radius_mm",)
    assert figures["contrast_at_depth_end"].missing == ("wavelength_nm",)
    nothing = work_out(OpticsSetup())
    assert all(figure.value is None and figure.missing for figure in nothing.values())
    assert nothing["depth_sd_whole_columns"].missing == ("field_mm", "projector", "theta_deg")
    assert conflicts(OpticsSetup(), nothing) == ()
    assert all(figure.value is not None for figure in work_out(WHOLE).values())
    assert all(formula.unit and formula.text and formula.source for formula in FORMULAS)


def test_figures_of_the_paper_that_exclude_each_other() -> None:
    text = said(PAPER_SETUP)
    assert "NA 0.1 of the camera and a depth of field of +-3 mm: 3 mm out of focus blur by 0.6 mm" in text
    assert "608x684 is no DLP3010, which has 1280x720; it may be a DLP3000" in text
    assert "20x makes the projected field 0.35 mm wide, not 10 mm" in text


def test_conflicts_that_a_setup_has() -> None:
    assert "radius 28 mm collide" in said(replace(WHOLE, lens_radius_mm=28.0))
    assert "collide" not in said(replace(WHOLE, lens_radius_mm=27.7))
    assert "NA 0.25 of the projector needs a lens of radius 25.8 mm at 100 mm, not 20 mm" in said(WHOLE)
    assert "theta 25 deg: each cone has room for NA 0.216" in said(replace(PAPER_SETUP, theta_deg=25.0))
    fits = OpticsSetup(
        theta_deg=31.0,
        working_distance_mm=100.0,
        lens_radius_mm=15.0,
        na_camera=0.002,
        na_projector=0.005,
        field_mm=(10.0, 10.0),
        depth_of_field_mm=6.0,
        camera=(2560, 1440),
        projector=(608, 684),
        chip="DLP3000",
        magnification_projector=0.6,
        wavelength_nm=550.0,
        line_um=80.0,
    )
    assert said(fits) == ""


@pytest.mark.parametrize(
    ("field", "bad"),
    [("theta_deg", 180.0), ("theta_deg", -1.0), ("na_camera", 1.0), ("field_mm", (10.0, 0.0)), ("chip", "DLP9")],
)
def test_impossible_inputs(field: str, bad: object) -> None:
    with pytest.raises(ValueError, match=f"{field}: "):
        OpticsSetup(**{field: bad})  # type: ignore[arg-type]  # one of several fields

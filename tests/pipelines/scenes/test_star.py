"""The star against sums over fine squares and a polygon's area."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.scenes import Star


@pytest.mark.parametrize(
    "star",
    [
        Star(),
        Star(rim_mm=1.0),
        Star(across_mm=4.0, height_mm=1.0, tips=6, notch=0.6, rim_mm=0.2),
        Star(tips=3, notch=0.3),
    ],
)
def test_area_and_volume_are_what_a_sum_says(star: Star) -> None:
    half, pitch = star.across_mm / 2, 0.005
    places = np.arange(-half + pitch / 2, half, pitch)
    x, y = np.meshgrid(places, places)
    inside = star.outline(x, y) <= 1
    assert inside.sum() * pitch**2 == pytest.approx(star.area_mm2, rel=2e-3)
    height = star.at(x, y).height(0.0)
    assert height[inside].sum() * pitch**2 == pytest.approx(star.volume_mm3, rel=2e-3)
    assert (height[~inside] == star.background_mm).all()
    assert height.max() == pytest.approx(star.height_mm, abs=0.01)


def test_area_of_the_polygon() -> None:
    star = Star()
    angle = np.arange(10) * np.pi / 5
    radius = np.where(np.arange(10) % 2 == 0, 3.5, 3.5 * 0.45)
    x, y = radius * np.sin(angle), radius * np.cos(angle)
    shoelace = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))
    assert star.area_mm2 == pytest.approx(shoelace)
    assert star.outline(x, y) == pytest.approx(np.ones(10))  # every corner lies on the outline
    along = (x + np.roll(x, -1)) / 2, (y + np.roll(y, -1)) / 2
    assert star.outline(*along) == pytest.approx(np.ones(10))  # and so does the middle of every edge


def test_outline_tells_the_distance_from_an_edge() -> None:
    star = Star(notch=0.382)
    # the lower notch of a pentagram looks straight down; half way along an edge the nearest point is on that edge
    tip, notch = np.array([0.0, 3.5]), 3.5 * 0.382 * np.array([np.sin(np.pi / 5), np.cos(np.pi / 5)])
    middle, direction = (tip + notch) / 2, (notch - tip) / np.linalg.norm(notch - tip)
    normal = np.array([-direction[1], direction[0]])
    normal *= np.sign(normal @ middle)
    for off in (-0.05, 0.0, 0.05):
        place = middle + off * normal
        found = (star.outline(place[0:1], place[1:2]) - 1) * star.edge_distance_mm
        assert found[0] == pytest.approx(off, abs=1e-9)


def test_a_background_has_its_own_colour() -> None:
    ground = Star(background_mm=0.0, background_reflects=0.01).at(np.array([0.0, 5.0]), np.array([0.0, 5.0]))
    assert ground.albedo(0.0) == pytest.approx([0.6, 0.01])
    assert ground.height(9.0) == pytest.approx([2.5, 0.0])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"tips": 2}, "3 tips or more"),
        ({"notch": 0.9}, "notch must lie between 0 and 0.809"),
        ({"rim_mm": 3.0}, "a rim above 0 and not above its top"),
        ({"background_mm": 1.0}, "must not lie above the star's base"),
    ],
)
def test_stars_that_cannot_be(options: dict[str, float], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Star(**options)  # type: ignore[arg-type]  # one option of several types

"""The organisms against sums over fine squares, and that they crawl as they should."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.scenes import SCENES, Organisms, Scene

PITCH = 0.02


def raster(scene: Organisms) -> tuple[np.ndarray, np.ndarray]:
    half = scene.side_mm / 2 + 1
    places = np.arange(-half + PITCH / 2, half, PITCH)
    return places[None, :], places[:, None]


def test_it_is_a_scene() -> None:
    assert isinstance(SCENES["organisms"](), Scene)


def test_volume_and_area_of_a_lone_one() -> None:
    scene = Organisms(count=1)
    ground = scene.at(*raster(scene))
    for second in (0.0, 7.5):
        age = second / 3600
        back = ground.height(age) - ground.substrate(age)
        truth = scene.creatures(age)
        assert back.sum() * PITCH**2 == pytest.approx(truth.volume_mm3[0], rel=0.005)
        assert (back > 0).sum() * PITCH**2 == pytest.approx(truth.area_mm2[0], rel=0.02)
        rows, columns = np.nonzero(back > 0)
        places = raster(scene)[0][0]
        assert places[columns].mean() == pytest.approx(truth.x_mm[0], abs=0.01)
        assert places[rows].mean() == pytest.approx(truth.y_mm[0], abs=0.01)


@pytest.mark.parametrize("second", [0.0, 3.0, 30.0, 61.0])
def test_what_they_eat_is_missing_from_the_substrate(second: float) -> None:
    scene = Organisms()
    ground = scene.at(*raster(scene))
    sunk = (ground.substrate(0.0) - ground.substrate(second / 3600)).sum() * PITCH**2
    assert sunk == pytest.approx(scene.eaten_mm3(second / 3600), rel=0.01, abs=1e-9)
    assert scene.truth(0.0, second / 3600).net_volume_mm3 == -scene.eaten_mm3(second / 3600)


def test_they_stay_on_the_plate_and_keep_their_speed() -> None:
    scene = Organisms()
    places = np.array([[s.x_mm, s.y_mm] for s in (scene.creatures(t / 3600) for t in range(121))])
    assert np.abs(places).max() < scene.side_mm / 2
    speed = np.hypot(*np.moveaxis(np.diff(places, axis=0), 1, 0))
    assert 0.5 * scene.speed_mm_s < np.sqrt(np.mean(speed**2)) < 1.5 * scene.speed_mm_s
    headings = scene.creatures(1.0).heading
    assert np.isfinite(headings).all()


def test_scattered_places_give_the_same_as_a_raster() -> None:
    scene = Organisms(count=3)
    x, y = raster(scene)
    whole = scene.at(x, y).height(0.002)
    some = np.random.default_rng(0).integers(0, whole.shape[0], (2, 50))
    alone = scene.at(x[0, some[1]], y[some[0], 0]).height(0.002)
    np.testing.assert_allclose(alone, whole[some[0], some[1]], atol=1e-12)


def test_numbers_that_make_no_sense() -> None:
    with pytest.raises(ValueError, match="count must be above 0"):
        Organisms(count=0)

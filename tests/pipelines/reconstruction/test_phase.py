"""Phase shifting: the ripple of a projector that is not linear, flicker, saturation and the jump of the order."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipelines import PatternSet
from pipelines.reconstruction import locate
from pipelines.reconstruction.phase import learn_phase

from .rough_view import Rough, judge, judge_both, see
from .synthetic_capture import slanted, take


def sinusoids(steps: int, size: tuple[int, int] = (608, 684), **fields: Any) -> PatternSet:
    return PatternSet.from_mapping({"kind": "phase", "size": size, "steps": steps, **fields})


def ripple_px(error: Any, place: Any, period: int, waves: int) -> float:
    """Amplitude of an error of so many waves per period."""
    turns = 2j * np.pi * (place + 0.5) / period
    return float(2 * np.abs(np.mean(error * np.exp(waves * turns))))


@pytest.mark.parametrize("steps", [3, 4, 6, 8])
@pytest.mark.parametrize("gamma", [1.0, 1.5, 2.2])
def test_ripple_of_gamma_is_gone(steps: int, gamma: float) -> None:
    patterns = sinusoids(steps, bits=(5, 0))
    rough = Rough((200, 640), noise=1.0, gamma=gamma, flicker=0.0, seed=5)
    frames, column, _, lit = see(rough, patterns)
    decoded = locate(frames)
    verdict = judge(decoded.column, decoded.sigma_column, column, lit)
    known = np.isfinite(decoded.column) & lit
    error = (decoded.column - column)[known]
    smooth = np.abs(error) < 1
    left = ripple_px(error[smooth], column[known][smooth], patterns.period_px("columns"), steps)
    # untouched: the phase of the N samples of the response itself
    phase = 2 * np.pi * np.arange(4096) / 4096
    angle = 2 * np.pi * np.arange(steps) / steps
    response = (0.5 + 0.5 * np.cos(phase[:, np.newaxis] - angle)) ** gamma
    off = np.angle(np.exp(1j * (np.angle(response @ np.exp(1j * angle)) - phase)))
    without = patterns.period_px("columns") / (2 * np.pi) * float(np.abs(off).max())
    print(
        f"phase, {steps} steps, gamma {gamma}: sd {verdict.sd_px:.3f} px of a period of 38, error over sigma "
        f"{verdict.chi:.2f}, ripple {left:.3f} px ({without:.3f} px uncorrected), {verdict.gross} gross"
    )
    assert left < 0.001 * patterns.period_px("columns")
    assert verdict.gross <= 1e-5 * verdict.count
    assert verdict.kept > 0.95
    assert 0.8 < verdict.chi < 1.2, "sigma says how wrong it is"


@pytest.mark.parametrize("steps", [3, 4, 5])
def test_flicker_and_drifting_light_between_the_steps_are_found(steps: int) -> None:
    patterns = sinusoids(steps, bits=(5, 0))
    rough = Rough((160, 640), noise=1.0, flicker=0.03, drift=6.0, seed=8)
    frames, column, _, lit = see(rough, patterns)
    model = learn_phase(frames, "columns", 1.0)
    assert np.std(model.power) > 0.01
    decoded = locate(frames)
    verdict = judge(decoded.column, decoded.sigma_column, column, lit)
    known = np.isfinite(decoded.column) & lit & (np.abs(decoded.column - column) < 1)
    error, place = (decoded.column - column)[known], column[known]
    for waves in (1, 2):
        assert ripple_px(error, place, patterns.period_px("columns"), waves) < 0.015
    assert abs(verdict.mean_px) < 0.01
    assert 0.8 < verdict.chi < 1.2


def test_power_of_each_step_is_measured() -> None:
    patterns = sinusoids(4, (200, 40), bits=(3, 0))
    view = replace(slanted(120, 400, patterns.size), noise=0.5)
    frames = take(view, patterns)
    stack = frames.stack.astype(float)
    power = np.array([1.03, 0.98, 1.0, 0.99])
    for step, lamp in enumerate(power):
        number = next(n for n, r in enumerate(patterns.roles) if r.what == "phase" and r.index == step)
        stack[number] = view.dark + lamp * (stack[number] - view.dark)
    found = learn_phase(replace(frames, stack=np.rint(stack).clip(0, 255).astype(np.uint8)), "columns", 0.6).power
    np.testing.assert_allclose(found / found.mean(), power / power.mean(), atol=0.004)


@pytest.mark.parametrize(("steps", "gamma", "kept"), [(4, 1.0, 0.9), (6, 1.0, 0.95), (8, 2.2, 0.95)])
def test_saturated_steps_are_left_out_while_three_remain(steps: int, gamma: float, kept: float) -> None:
    patterns = sinusoids(steps, bits=(5, 0))
    frames, column, _, lit = see(Rough((160, 640), noise=1.5, light=330.0, gamma=gamma, seed=6), patterns)
    assert (frames.stack[0] == 255).mean() > 0.15
    decoded = locate(frames)
    verdict = judge(decoded.column, decoded.sigma_column, column, lit)
    bright = (frames.stack[0] == 255) & lit
    alone = judge(decoded.column, decoded.sigma_column, column, bright)
    assert verdict.kept > kept
    assert alone.kept > 0.75
    assert alone.sd_px < 0.1
    assert verdict.gross <= 1e-5 * verdict.count
    assert 0.7 < alone.chi < 1.4


@pytest.mark.parametrize(
    "rough",
    [
        Rough((360, 640), blur_px=1.0, noise=3.0, seed=9),
        Rough((360, 640), noise=2.0, density=2.2, mirrored=True, gamma=1.8, seed=10),
        Rough((480, 480), noise=2.0, turned=True, seed=12),
    ],
    ids=["blurred", "mirrored, small period on the camera, gamma", "turned"],
)
def test_no_jump_by_a_period_at_steps_cracks_and_edges_of_the_order(rough: Rough) -> None:
    patterns = sinusoids(4)
    frames, column, row, lit = see(rough, patterns)
    for verdict in judge_both(locate(frames), column, row, lit):
        assert verdict.kept > 0.93
        assert verdict.gross <= 1e-5 * verdict.count
        assert 0.75 < verdict.chi < 1.25


def test_an_even_picture_teaches_nothing_and_does_no_harm() -> None:
    patterns = sinusoids(3, (200, 40), bits=(3, 0))
    tiny = take(replace(slanted(12, 30, patterns.size), noise=1.0), patterns)
    model = learn_phase(tiny, "columns", 1.0)
    np.testing.assert_array_equal(model.power, 1.0)
    np.testing.assert_allclose(model.straight, np.linspace(0, 1, len(model.straight)))
    assert np.isfinite(locate(tiny).column).mean() > 0.8

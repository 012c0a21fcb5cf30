"""Phase shifting: sinusoids that are moved step by step; Gray code tells the period.

The phase of each pixel is that of the least-squares sinusoid through its steps (Bruning et al. 1974). N steps cancel
the overtones of a projector that is not linear, up to the (N-2)th; what is left is a ripple of N periods per period,
which three and four steps show most. It is measured in the capture itself: a surface is smooth, so the second
difference of the phase along a line is that of the ripple, wherever nothing breaks off.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
import numpy.typing as npt

from ..scan import LEVEL_NONE
from ..slabs import in_slabs
from .codebook import order_planes
from .frames import Frames
from .light import frame_of
from .patterns import AXES, Axis
from .phase_kernels import locate_phases
from .pixel_maps import Decoded
from .settle import keep_surfaces

__all__ = ["PhaseModel", "decode_phase", "learn_phase"]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

LINES = 72
"""Lines of the image from which flicker and ripple are learnt."""
DARK = 0.5
"""Pixels are dark below so much of the median light."""
ENOUGH = 10_000
"""Pixels that tell flicker well enough."""
LEAST_SAMPLES = 500
OVERTONES = 6
TABLE = 1024
RIPPLE_PRIOR = 0.3
"""Standard deviation of a ripple before anything is seen, rad."""
CORRELATED = 4.0
"""Neighbours share what a surface is like: errors are as those of so many times fewer pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class PhaseModel:
    """What a capture says of its own steps.

    Parameters
    ----------
    power, drift : ndarray of float64, shape (steps,)
        Light of each step, of the mean; what came on top (the room's light), of white minus black.
    harmonics : ndarray of float64, shape (OVERTONES,)
        Mean, amplitude and overtones of the sinusoid as the camera sees it, of white minus black.
    straight : ndarray of float64, shape (TABLE + 1,)
        True share of the period by the share that the steps say.
    slack : float
        Standard uncertainty that flicker and ripple leave, periods.
    """

    power: F64
    drift: F64
    harmonics: F64
    straight: F64
    slack: float


def decode_phase(frames: Frames, noise: float, into: Decoded) -> None:
    """Place each camera pixel along the axes of a phase set.

    A pixel is rejected if it is unlit, if its sinusoid is too faint for its noise or for white minus black, if its
    order bits do not agree with its place, or if it lies on no surface that its neighbours show. Saturated steps are
    left out as long as three remain.

    Parameters
    ----------
    frames : Frames
        Of a phase set.
    noise : float
        Standard deviation of a pixel's value, counts.
    into : Decoded
        Filled: places, sigmas and `level`.
    """
    patterns = frames.patterns
    into.level[:] = 0
    for number, (axis, place, sigma) in enumerate(
        zip(AXES, (into.column, into.row), (into.sigma_column, into.sigma_row), strict=True)
    ):
        if not patterns.bits[number]:
            place[:], sigma[:] = np.nan, np.nan
            continue
        _along(frames, axis, noise, place, sigma)
        into.level[np.isnan(place)] = LEVEL_NONE


def _along(frames: Frames, axis: Axis, noise: float, place: F32, sigma: F32) -> None:
    patterns = frames.patterns
    stack = np.ascontiguousarray(frames.stack)
    white, black = (frame_of(frames.patterns, what) for what in ("white", "black"))
    number = AXES.index(axis)
    bits = patterns.bits[number]
    plus, minus = np.full((2, bits), -1, np.int64)
    for frame, role in enumerate(patterns.roles):
        if role.axis == axis and role.what == "bit":
            (minus if role.inverted else plus)[role.index] = frame
    steps = _steps(frames, axis)
    model = learn_phase(frames, axis, noise)
    period = float(patterns.period_px(axis))
    expected = _order_swings(patterns.size[number], bits, period)
    found, spread = np.empty((2, *place.shape), np.float32)

    def locate(first: int, last: int) -> None:
        locate_phases(
            stack,
            white,
            black,
            plus,
            minus,
            steps,
            model.power,
            model.drift,
            model.harmonics,
            model.straight,
            model.slack,
            expected,
            period,
            6 * sqrt(2) * noise,
            noise,
            (first, last),
            found,
            spread,
        )

    in_slabs(len(place), locate)
    keep_surfaces(found, spread, np.zeros_like(found), place, sigma)


def _steps(frames: Frames, axis: Axis) -> npt.NDArray[np.int64]:
    roles = frames.patterns.roles
    return np.array([n for n, role in enumerate(roles) if (role.what, role.axis) == ("phase", axis)], np.int64)


def _order_swings(length: int, bits: int, period: float) -> F32:
    """What the order bits should swing at each projector pixel, shape (px, bits), as softly as a blur may make them."""
    from scipy.ndimage import gaussian_filter1d

    swings = np.where(order_planes(length, bits), 1.0, -1.0)
    soft: F32 = gaussian_filter1d(swings, period / 16, axis=1, mode="nearest").T.astype(np.float32)
    return np.ascontiguousarray(soft)


def learn_phase(frames: Frames, axis: Axis, noise: float) -> PhaseModel:
    """Learn from some lines of the image what the steps' light and the projector's response do to the phase.

    Parameters
    ----------
    frames : Frames
        Of a phase set that codes `axis`.
    axis : {"columns", "rows"}
    noise : float
        Standard deviation of a pixel's value, counts.
    """
    count = frames.patterns.steps
    share = np.linspace(0, 1, TABLE + 1)
    plain = PhaseModel(np.ones(count), np.zeros(count), np.array([0.5, 0.5, *[0.0] * (OVERTONES - 2)]), share, 0.002)
    best = max((_lines(frames, axis, noise, down) for down in (False, True)), key=_turns)
    value, lit, bright = best
    if lit.sum() < LEAST_SAMPLES:
        return plain
    angle = 2 * np.pi * np.arange(count) / count
    thin = max(1, int(lit.sum()) // ENOUGH)
    power, drift, left = _flicker(value[:, lit][:, ::thin], angle)
    value = (value - drift[:, np.newaxis, np.newaxis]) / power[:, np.newaxis, np.newaxis]
    phase = np.angle(np.tensordot(np.exp(1j * angle), value, axes=1))
    # noise of the phase itself would blur the ripple: dark pixels have most of it
    ripple, doubt = _ripple(np.where(bright, phase, np.nan), count)
    straight = share - ripple(2 * np.pi * share) / (2 * np.pi)
    true = (phase[lit] - ripple(phase[lit]))[::thin]
    parts = np.stack([np.cos(h * (true - angle[:, np.newaxis])) for h in range(OVERTONES)])
    design = parts.reshape(OVERTONES, -1)
    harmonics = np.linalg.pinv(design @ design.T) @ (design @ value[:, lit][:, ::thin].reshape(-1))
    return PhaseModel(power, drift, harmonics, straight, float(np.hypot(doubt, left)) / (2 * np.pi))


def _lines(frames: Frames, axis: Axis, noise: float, down: bool) -> tuple[F64, Mask, Mask]:
    """Steps along some rows of the image, or `down` some columns, of white minus black: (step, line, pixel).

    And which pixels are lit and not saturated in any frame, and those of them that are not dark.
    """
    white, black = (frame_of(frames.patterns, what) for what in ("white", "black"))
    chosen = np.array([white, black, *_steps(frames, axis)])
    lines = np.unique(np.linspace(0, frames.stack.shape[2 if down else 1] - 1, LINES).astype(np.int64))
    some = frames.stack[chosen[:, np.newaxis], :, lines] if down else frames.stack[chosen[:, np.newaxis], lines]
    some = some.astype(np.float64)
    light = some[0] - some[1]
    lit = (light > 6 * sqrt(2) * noise) & (some.max(axis=0) < np.iinfo(frames.stack.dtype).max)
    return (
        (some[2:] - some[1]) / np.where(lit, light, 1.0),
        lit,
        lit & (light > DARK * np.median(light[lit]) if lit.any() else lit),
    )


def _turns(lines: tuple[F64, Mask, Mask]) -> float:
    """How far the phase turns from pixel to pixel."""
    value, lit, _ = lines
    angle = 2 * np.pi * np.arange(len(value)) / len(value)
    phasor = np.where(lit, np.tensordot(np.exp(1j * angle), value, axes=1), 0)
    turn = np.abs(np.angle(phasor[:, 1:] * phasor[:, :-1].conj()))[lit[:, 1:] & lit[:, :-1]]
    return float(np.median(turn)) if turn.size else 0.0


def _flicker(value: F64, angle: F64) -> tuple[F64, F64, float]:
    """Light of each step, and what came on top, from the mean and amplitude of the steps as they depend on the phase.

    Let step n be brighter by a_n and lifted by d_n, and A and B the sums of a_n and d_n times exp(i angle_n). Then the
    mean of the steps ripples with the phase p as Re(c1 A* exp(i p)) / N, and their amplitude as
    Re((2 c0 A + 2 D)* exp(i p) + c1 A2* exp(2 i p)) / N, with A2 the sum of a_n times exp(2 i angle_n), c0 the mean and
    c1 the amplitude. Nothing else does: overtones ripple with N p.

    Returns
    -------
    power, drift : ndarray, shape (step,)
    left : float
        Standard uncertainty that is left in the phase, rad.
    """
    count = len(value)
    a, d = np.zeros(count), np.zeros(count)
    left = 0.0
    for _ in range(3):
        clean = (value - d[:, np.newaxis]) / (1 + a[:, np.newaxis])
        phasor = 2 / count * np.tensordot(np.exp(1j * angle), clean, axes=1)
        phase = np.angle(phasor)
        waves = (1, 2, count) if count > 3 else (1, 3)
        parts = np.column_stack([np.ones(len(phase)), *(f(k * phase) for k in waves for f in (np.cos, np.sin))])
        mean, _ = _fit(parts, clean.mean(axis=0))
        amplitude, error = _fit(parts, np.abs(phasor))
        c0, c1 = mean[0], amplitude[0]
        first = count * complex(mean[1], mean[2]) / c1
        lifted = count / 2 * complex(amplitude[1], amplitude[2]) - c0 * first
        a += 2 / count * (first * np.exp(-1j * angle)).real
        d += 2 / count * (lifted * np.exp(-1j * angle)).real
        if count > 3:
            second = count * complex(amplitude[3], amplitude[4]) / c1
            a += (1 if count == 4 else 2) / count * (second * np.exp(-2j * angle)).real
        left = float(np.hypot(error[1], error[2])) / c1
    return 1 + a, d, left


def _fit(parts: F64, value: F64) -> tuple[F64, F64]:
    """Least squares without outliers: coefficients and their standard errors."""
    good = np.ones(len(value), np.bool_)
    for _ in range(3):
        some = parts[good]
        inverse = np.linalg.pinv(some.T @ some)
        found = inverse @ (some.T @ value[good])
        rest = value - parts @ found
        good = np.abs(rest) <= 3 * 1.4826 * np.median(np.abs(rest[good])) + 1e-9
    error = np.sqrt(np.diag(inverse) * rest[good].var() * CORRELATED)
    return np.asarray(found, np.float64), np.asarray(error, np.float64)


class _Waves:
    """A ripple: a sum of waves of N, 2 N, ... periods per period of the phase, rad."""

    def __init__(self, waves: npt.NDArray[np.int64], found: F64) -> None:
        self._waves, self._found = waves, found

    def __call__(self, phase: F64) -> F64:
        return np.tensordot(self._found, _wave_parts(self._waves, phase), axes=1)


def _wave_parts(waves: npt.NDArray[np.int64], phase: F64) -> F64:
    return np.stack([f(k * phase) for k in waves for f in (np.cos, np.sin)])


def _ripple(phase: F64, count: int) -> tuple[_Waves, float]:
    """Ripple of the phase along lines of the image, (line, pixel) with NaN where unknown, and its standard uncertainty.

    Second differences over a step that lets the ripple stand out against the bend of the surface.
    """
    turn = _wrapped(np.diff(phase, axis=1))
    known = np.isfinite(turn)
    per_px = float(np.median(np.abs(turn[known]))) if known.any() else 0.0
    waves = count * np.arange(1, 5 if count < 5 else 3)
    step = int(np.clip(round(np.pi / max(count * per_px, 1e-6)), 1, max(1, phase.shape[1] // 8)))
    before, here, after = phase[:, : -2 * step], phase[:, step:-step], phase[:, 2 * step :]
    bend = _wrapped(_wrapped(after - here) - _wrapped(here - before))
    good = np.isfinite(bend)
    none = _Waves(waves, np.zeros(2 * len(waves)))
    if good.sum() < LEAST_SAMPLES:
        return none, 0.02
    parts = [_wave_parts(waves, place[good]) for place in (before, here, after)]
    design, bent = (parts[0] - 2 * parts[1] + parts[2]).T, bend[good]
    rest = bent
    for _ in range(8):
        scale = max(1.4826 * float(np.median(np.abs(rest))), 1e-6)
        weight = 1 / (scale**2 + rest**2)  # Cauchy's: most of a surface is smooth, and some of it is not at all
        some = design * weight[:, np.newaxis]
        known = some.T @ design
        prior = np.eye(len(known)) / RIPPLE_PRIOR**2
        found = np.linalg.solve(known + prior, some.T @ bent)
        rest = bent - design @ found
    inverse = np.linalg.inv(known + prior)
    some *= rest[:, np.newaxis]
    spread = inverse @ (some.T @ some) @ inverse * CORRELATED
    return _Waves(waves, np.asarray(found, np.float64)), float(np.sqrt(np.trace(spread) / 2))


def _wrapped(angle: F64) -> F64:
    return np.asarray(angle - 2 * np.pi * np.round(angle / (2 * np.pi)))

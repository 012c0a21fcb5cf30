"""Soft decoding of equal-width stripes: the place whose blurred stripes look most like what the pixel saw."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
import numpy.typing as npt

from .frames import Frames
from .patterns import AXES, Axis
from .slabs import in_slabs
from .stripe_kernels import locate_pixels, support, tile_power
from .stripe_model import SwingModel, swing_model

__all__ = ["decode_stripes"]

F32 = npt.NDArray[np.float32]
I64 = npt.NDArray[np.int64]

TILE = 16
FLOOR = 0.02
MARGIN = 20.0


def decode_stripes(frames: Frames, axis: Axis, noise: float) -> tuple[F32, F32, npt.NDArray[np.uint8]]:
    patterns = frames.patterns
    model = swing_model(patterns, axis)
    bits = model.bits
    roles = patterns.roles
    white = next(n for n, r in enumerate(roles) if r.what == "white")
    black = next(n for n, r in enumerate(roles) if r.what == "black")
    plus = np.full(bits, -1, np.int64)
    minus = np.full(bits, -1, np.int64)
    for n, r in enumerate(roles):
        if r.what == "bit" and r.axis == axis:
            (minus if r.inverted else plus)[r.index] = n
    stack = np.ascontiguousarray(frames.stack)
    rows, columns = stack.shape[1:]
    sd = noise * sqrt(2 if patterns.complementary else 6)
    lit = 6 * sqrt(2) * noise
    blur = _blur(stack, white, black, plus, minus, model, lit, sd * sd)
    shift, gain = np.zeros(bits, np.float32), np.ones(bits, np.float32)
    floor = FLOOR
    worst = bits + 5 * sqrt(2 * bits)
    far = max(2 * model.cell_px, 2.0)

    def visit(some: I64, place: F32, sigma: F32, cost: F32, floor: float) -> None:
        locate_pixels(stack, white, black, plus, minus, bits, shift, gain, blur, TILE, model.swing, model.first, model.candidate, model.per_px, lit, sd, floor, far, MARGIN, worst, some, place, sigma, cost)

    some = np.arange(rows // 32, rows, max(1, rows // 24))
    trial = np.empty((3, len(some), columns), np.float32)
    for _ in range(5):
        visit(some, trial[0], trial[1], trial[2], floor)
        if not (trial[2] >= 0).any():
            break
        median = np.median(trial[2][trial[2] >= 0])
        #print("floor", floor, "median cost", median)
        if median < bits - 1:
            break
        floor *= 1.6
    place = np.empty((rows, columns), np.float32)
    sigma = np.empty_like(place)
    cost = np.empty_like(place)
    in_slabs(rows, lambda a, b: visit(np.arange(a, b), place[a:b], sigma[a:b], cost[a:b], floor))
    keep = np.empty(place.shape, np.bool_)
    support(place, max(3 * model.cell_px, 4.0), 2, keep)
    place[~keep] = np.nan
    sigma[~keep] = np.nan
    return place, sigma, cost


def _blur(stack, white, black, plus, minus, model, lit, loss):
    rows, columns = stack.shape[1:]
    tiles = -(-rows // TILE), -(-columns // TILE)
    power, weight = np.empty((*tiles, model.bits)), np.empty(tiles)
    tile_power(stack, white, black, plus, minus, model.bits, TILE, lit, loss, power, weight)
    from scipy.ndimage import uniform_filter
    fine = power[..., -3:].sum(axis=-1)
    fine = uniform_filter(fine, 3, mode="nearest")
    weight = uniform_filter(weight, 3, mode="nearest")
    share = np.where(weight > 0, fine / np.maximum(weight, 1e-9), 1.0)
    expected = model.power[:, -3:].sum(axis=1)  # falls with the blur
    between = (expected[1:] + expected[:-1]) / 2
    return np.searchsorted(-between, -share).astype(np.uint8)

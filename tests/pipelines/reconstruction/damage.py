"""Good captures made bad in known ways, at several strengths."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pipelines import PatternSet

Stack = npt.NDArray[np.uint8]
Damaged = tuple[str, str, Stack, PatternSet]
"""Cause that must be named, what was done, frames, pattern set they are read with."""


def damaged(stack: Stack, patterns: PatternSet, seed: int = 0) -> Iterator[Damaged]:
    """Every damage to one capture of a whole set of pairs with white and black first."""
    rng = np.random.default_rng(seed)
    count = len(stack)
    # patterns that everybody can tell: neither even over the field of view nor too fine to be seen
    inner = [n for n, role in enumerate(patterns.roles) if role.axis and 2 <= role.index <= 7]
    first = {n for n, role in enumerate(patterns.roles) if not role.inverted and role.axis}

    def some(number: int) -> list[int]:
        return sorted(int(n) for n in rng.choice(inner, number, replace=False))

    def change(n: int, image: npt.NDArray[Any]) -> Stack:
        other = stack.copy()
        other[n] = clipped(image)
        return other

    for n in (0, 1, *some(2), count - 1):
        yield "missing", f"without {n}", np.delete(stack, n, axis=0), patterns
    for n in (1, *some(2)):
        slipped = np.concatenate([np.delete(stack, n, axis=0), stack[-1:]])
        yield "missing", f"slipped at {n}", slipped, patterns
    for n in some(2):
        yield "missing", f"dark {n}", change(n, stack[1]), patterns
    for n in some(2):
        yield "repeated", f"stale {n}", change(n, stack[n - 1]), patterns
    for n in (0, *some(2)):
        twice = np.concatenate([stack[: n + 1], stack[n:-1]])
        yield "repeated", f"twice {n}", twice, patterns
        yield "repeated", f"extra {n}", np.concatenate([stack[: n + 1], stack[n:]]), patterns
    black = stack[1:2]
    yield "shifted", "late by 1", np.concatenate([black, stack[:-1]]), patterns
    yield "shifted", "early by 1", np.concatenate([stack[1:], black]), patterns
    yield "shifted", "late by 2", np.concatenate([black, black, stack[:-2]]), patterns
    for n in [k for k in some(8) if k in first][:4]:
        turned = stack.copy()
        turned[[n, n + 1]] = turned[[n + 1, n]]
        yield "pair", f"pair {n}", turned, patterns
    for a, b in (some(2), some(2), some(2), (0, some(1)[0])):
        if abs(a - b) > 1:
            swapped = stack.copy()
            swapped[[a, b]] = swapped[[b, a]]
            yield "swapped", f"{a} with {b}", swapped, patterns
    for gain in (1.6, 2.2, 4.0):
        yield "saturated", f"x {gain}", clipped(stack * gain), patterns
    for gain in (0.08, 0.03, 0.01):
        noise = rng.normal(0, 0.8, stack.shape)
        yield "dark", f"x {gain}", clipped(stack * gain + 2 + noise), patterns
    for n, gain in zip((0, *some(3)), (0.88, 0.9, 1.12, 0.8), strict=True):
        yield "flicker", f"{n} x {gain}", change(n, dimmed(stack, n, gain)), patterns
    for sd in (0.05, 0.1):
        gains = 1 + sd * rng.standard_normal(count)
        yield "flicker", f"sd {sd}", np.stack([clipped(dimmed(stack, n, gains[n])) for n in range(count)]), patterns
    for size in (0.25, 0.4):
        room = size * np.median(stack[0].astype(float) - stack[1]) * np.linspace(0, 1, count)
        yield "ambient", f"ramp {size}", clipped(0.7 * stack + room[:, None, None]), patterns
    lamp = 0.07 * np.median(stack[0].astype(float) - stack[1]) * (np.arange(count) % 3 == 0)
    yield "ambient", "blinking", clipped(0.7 * stack + lamp[:, None, None]), patterns
    for shift in ((0, 1), (1, 0), (2, 1), (0, 4)):
        start = int(rng.integers(count // 4, 3 * count // 4))
        moved = np.concatenate([stack[:start], np.roll(stack[start:], shift, axis=(1, 2))])
        yield "moved", f"{shift} from {start}", moved, patterns
    yield "moved", "half a pixel", np.concatenate([stack[:20], halfway(stack[20:])]), patterns
    for part in (0.15, 0.3, 0.5):
        late = np.concatenate([stack[1:], black])
        yield "interrupted", f"all by {part}", clipped((1 - part) * stack + part * late), patterns
    for part, n in zip((0.15, 0.3, 0.5), some(3), strict=True):
        mixed = (1 - part) * stack[n].astype(float) + part * stack[n + 1]
        yield "interrupted", f"{n} by {part}", change(n, mixed), patterns
    offset = "none" if patterns.offset == "centred" else "centred"
    yield "patterns", f"offset {offset}", stack, replace(patterns, offset=offset)  # type: ignore[arg-type]  # one of two
    yield "patterns", "msb_first", stack, replace(patterns, msb_first=not patterns.msb_first)


def blurred(stack: Stack, patterns: PatternSet, widths: tuple[float, ...]) -> Iterator[Damaged]:
    """Out of focus by Gaussians of these camera px, with the noise that a camera adds afterwards."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(1)
    for width in widths:
        soft = np.stack([gaussian_filter(image.astype(np.float32), width) for image in stack])
        yield "defocus", f"blur {width}", clipped(soft + rng.normal(0, 1, stack.shape)), patterns


def clipped(image: npt.NDArray[Any]) -> Stack:
    grey: Stack = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return grey


def dimmed(stack: Stack, n: int, gain: float) -> npt.NDArray[Any]:
    """One frame under more or less of the projector's light; the room's stays."""
    dark = stack[1].astype(float)
    light: npt.NDArray[Any] = dark + gain * (stack[n] - dark)
    return light


def halfway(stack: Stack) -> Stack:
    return clipped((stack.astype(float) + np.roll(stack, 1, axis=2)) / 2)

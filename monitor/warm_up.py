"""Warming up: the whole chain, some times, on captures that count for nothing, so that no slot waits for a compiler."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from configs import CaptureError
from pipelines import Frames, Instant
from storage import create_store

from .rigs import Rig
from .visit import Epoch, Recipe, Work

__all__ = ["warm_up"]

SECOND = np.timedelta64(10**9, "ns")


def warm_up(
    rig: Rig,
    recipe: Recipe,
    units: Mapping[str, str],
    kind: str,
    at: Instant,
    work: Work[Any],
) -> None:
    """Capture, reconstruct, compare, measure and commit to a store that is thrown away.

    A fresh clone compiles its kernels here, for some 20 s; later starts load them from numba's cache.

    Parameters
    ----------
    rig : Rig
        Open, and a spare one: what it captures, and how often, must not count.
    recipe : Recipe
    units : mapping of str to str
        Of the metrics.
    kind : str
        Of the campaign's store.
    at : Instant
    work : Work
        What makes a tick of a capture.

    Raises
    ------
    CaptureError, DeviceUnavailable, StoreError, ValueError
        What a visit would raise.
    """
    # a video follows one scan from the next, and searches where it cannot: both are to be ready
    ways = [recipe, recipe, replace(recipe, follow=False)] if recipe.follow else [recipe, recipe]
    epoch: Epoch | None = None
    frames: Frames | None = None
    with TemporaryDirectory(prefix="microrelief-") as folder:
        made = create_store(Path(folder) / "warm-up", site="", grid=recipe.grid, metrics=units, kind=kind)
        with closing(made) as store:
            for number, way in enumerate(ways):  # later ones are compared with the first, as the store gives it back
                moment = at + number * SECOND
                frames = _captured(rig, way, moment, frames)
                made_of = work(frames, way, epoch, moment)
                row = store.append(made_of.tick)
                if row is None:
                    return
                epoch = epoch or Epoch(store[row].scan, made_of.watches)


def _captured(rig: Rig, recipe: Recipe, at: Instant, before: Frames | None) -> Frames:
    """Capture; a replay of a single capture shows that once more."""
    try:
        return rig.capture(recipe.patterns, at)
    except CaptureError:
        if before is None:
            raise
        return Frames(before.stack, at, before.patterns, before.exposure_ms)

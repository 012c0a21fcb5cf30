"""A store's review made ready: its shards brought up to date and served, for the command and for the status page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from dashboards import Preset, cache_folder, serve_shards, update_shards
from storage import Store

from .progress import Progress

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["served_review"]


@contextmanager
def served_review(
    store: Store,
    preset: Preset = "overview",
    port: int | None = None,
    step: Progress | None = None,
    *,
    origin: str = "",
    tracks: pd.DataFrame | None = None,
) -> Iterator[str]:
    """Draw what is new in a store and serve its review on this machine alone; gives the address for a viewer."""
    shards = update_shards(store, cache_folder(store), tracks=tracks, progress=step)
    with serve_shards(shards, preset, port, origin=origin) as address:
        yield address

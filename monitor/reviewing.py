"""A store's review made ready: its shards brought up to date and served, for the command and for the status page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from configs import MicroreliefError
from dashboards import Preset, cache_folder, serve_shards, update_shards
from storage import Store

from .progress import Progress
from .reprocess import campaign_of, rules_of

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import pandas as pd

__all__ = ["crack_region", "served_review"]


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
    shards = update_shards(store, cache_folder(store), region=crack_region(store), tracks=tracks, progress=step)
    with serve_shards(shards, preset, port, origin=origin) as address:
        yield address


def crack_region(store: Store) -> npt.NDArray[np.bool_] | None:
    """Give where a store's campaign looks for cracks: its region, less the frame, whose seams are none; None: all."""
    # a campaign of another version, or whose files are gone: a review must not fail for that
    with suppress(MicroreliefError):
        rules = rules_of(campaign_of(store), store)
        if rules.stable is None:
            return rules.region
        return ~rules.stable if rules.region is None else rules.region & ~rules.stable
    return None

"""Stores that dashboards are tested on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipelines import Event

from .drying import START, DryingStore, drying_store


@pytest.fixture(scope="session")
def drying() -> DryingStore:
    """Six scans, the last two in alarm, one failed visit."""
    return drying_store()


@pytest.fixture
def empty() -> DryingStore:
    """A store that was created and never written."""
    full = drying_store(1, 20)
    return DryingStore(full.about, table=full.table.iloc[:0])


@pytest.fixture
def all_failed(empty: DryingStore) -> DryingStore:
    """A campaign whose rig never answered."""
    hours = [START + np.timedelta64(hour, "h") for hour in range(3)]
    return replace(empty, events=tuple(Event(hour, "failed", "the projector does not answer") for hour in hours))

"""Fixtures of the stores' tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from .writers import Nursery


@pytest.fixture(scope="session")
def nursery() -> Iterator[Nursery]:
    """Where writers are born; one for all tests of a process."""
    made = Nursery()
    try:
        yield made
    finally:
        made.close()

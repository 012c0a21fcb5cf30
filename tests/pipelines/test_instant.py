"""Instants round-trip to the nanosecond, and a time without a zone is refused."""

from __future__ import annotations

from datetime import datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipelines import as_datetime, format_instant, instant, parse_instant

YEAR_2200_NS = 7_258_118_400_000_000_000


@given(st.integers(0, YEAR_2200_NS))
def test_a_written_instant_reads_back_to_the_nanosecond(nanoseconds: int) -> None:
    moment = np.datetime64(nanoseconds, "ns")
    assert parse_instant(format_instant(moment)) == moment


def test_offsets_and_zones_are_heeded() -> None:
    assert format_instant(parse_instant("2026-11-22T22:00+01:00")) == "2026-11-22T21:00:00Z"
    assert format_instant(parse_instant("2026-07-01 12:00", "Europe/Berlin")) == "2026-07-01T10:00:00Z"
    assert format_instant(parse_instant("2026-07-01T12:00:00.25Z")) == "2026-07-01T12:00:00.25Z"


def test_a_time_without_zone_is_refused() -> None:
    with pytest.raises(ValueError, match="no time zone"):
        parse_instant("2026-11-22T21:00:00")
    with pytest.raises(ValueError, match="no time zone"):
        instant(datetime(2026, 1, 1))  # noqa: DTZ001 - a naive time is the point


def test_what_is_no_time_is_named() -> None:
    with pytest.raises(ValueError, match="'tomorrow' is not a time"):
        parse_instant("tomorrow")


@pytest.mark.parametrize("year", ["2926", "0226"])
def test_a_year_that_nanoseconds_cannot_count_is_refused(year: str) -> None:
    with pytest.raises(ValueError, match="year must lie from 1678 to 2261"):
        parse_instant(f"{year}-11-22T21:00:00Z")


def test_as_datetime_is_aware() -> None:
    assert as_datetime(parse_instant("2026-11-22T21:00:00Z")).utcoffset() is not None

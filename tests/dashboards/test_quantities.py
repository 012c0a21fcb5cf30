"""Numbers as people read them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashboards.quantities import day_and_time, plain, span, with_uncertainty
from dashboards.ticks import number_text, number_ticks, time_ticks
from pipelines import Measurement


@pytest.mark.parametrize(
    ("value", "sigma", "unit", "text"),
    [
        (-1.2345, 0.0123, "mm3", "−1.234 ± 0.012 mm³"),
        (1234.6, 56.0, "mm2", "1235 ± 56 mm²"),
        (123456.0, 1234.0, "mm", "123500 ± 1200 mm"),
        (0.5, 0.0996, "mm", "0.50 ± 0.10 mm"),
        (-0.0001, 0.3, "mm", "0.00 ± 0.30 mm"),
        (0.97, 0.004, "1", "0.9700 ± 0.0040"),
        (2.0, 0.0, "mm", "2 mm"),
        (2.0, math.nan, "mm", "2 mm"),
        (math.nan, 0.1, "mm", "not measured"),
    ],
)
def test_a_value_is_rounded_to_its_uncertainty(value: float, sigma: float, unit: str, text: str) -> None:
    assert with_uncertainty(Measurement(value, sigma), unit) == text


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e3))
def test_rounding_loses_less_than_a_twentieth_of_the_uncertainty(value: float, sigma: float) -> None:
    shown, _, uncertainty = with_uncertainty(Measurement(value, sigma)).replace("−", "-").partition(" ± ")
    assert float(shown) == pytest.approx(value, abs=0.051 * sigma + 1e-12)
    assert float(uncertainty) == pytest.approx(sigma, rel=0.051)


def test_plain_numbers_and_spans() -> None:
    assert [plain(value) for value in (0.0, 1.5, -0.00123456, 12345.6, math.nan)] == [
        "0",
        "1.5",
        "−0.001235",
        "12350",
        "not measured",
    ]
    spans = [np.timedelta64(seconds, "s") for seconds in (45, 90, 3600 * 6, 86400 * 3 + 3600 * 6 + 59)]
    assert [span(length) for length in spans] == ["45 s", "1 min 30 s", "6 h", "3 d 6 h"]
    assert day_and_time(np.datetime64("2026-05-04T06:00:00", "ns")) == "2026-05-04 06:00 UTC"
    assert day_and_time(np.datetime64("2026-05-04T06:00:01", "ns")) == "2026-05-04 06:00:01 UTC"


@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e4))
def test_number_ticks_lie_inside_and_read_apart(low: float, width: float) -> None:
    ticks = number_ticks(low, low + width)
    assert 2 <= len(ticks) <= 7
    assert all(low - 1e-6 * width <= tick <= low + width * (1 + 1e-6) for tick in ticks)
    texts = [number_text(tick, ticks[1] - ticks[0]) for tick in ticks]
    assert len(set(texts)) == len(texts)


@pytest.mark.parametrize("seconds", [1, 20, 300, 5000, 86400, 86400 * 9, 86400 * 60, 86400 * 400, 86400 * 4000])
def test_time_ticks_lie_inside_whatever_the_span(seconds: int) -> None:
    start = np.datetime64("2026-05-04T06:12:34.5", "ns")
    end = start + np.timedelta64(seconds, "s")
    ticks = time_ticks(start, end)
    assert 1 <= len(ticks) <= 8
    assert all(start <= moment <= end for moment, _ in ticks)
    assert len({text for _, text in ticks}) == len(ticks)

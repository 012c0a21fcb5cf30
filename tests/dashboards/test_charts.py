"""Trends as SVG: gaps, limits, bands."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from dashboards.alarm_limits import Line, alarm_limits
from dashboards.charts import Trend, gap_after, trend_svg

from .drying import CAMPAIGN, SIX_HOURS, START


def times(*slots: int) -> np.ndarray:
    return np.array([START + slot * SIX_HOURS for slot in slots])


def draw(trend: Trend) -> dict[str, list[ET.Element]]:
    """Parse the drawing and sort its elements by class."""
    found: dict[str, list[ET.Element]] = {}
    for element in ET.fromstring(trend_svg(trend, 'A "quoted" <name>')).iter():
        found.setdefault(element.get("class", "").split(" ")[0], []).append(element)
    return found


def test_gaps_are_drawn_as_gaps() -> None:
    moments = times(0, 1, 2, 6, 7, 8)
    values = np.arange(6.0)
    assert gap_after(moments).tolist() == [False, False, True, False, False]
    parts = draw(Trend("Net volume (mm³)", moments, values, np.full(6, 0.1)))
    assert [len(line.get("points", "").split()) for line in parts["line"]] == [3, 3]
    assert len(parts["band"]) == 2


def test_a_visit_that_yielded_nothing_breaks_the_line_and_is_marked() -> None:
    moments, lost = times(0, 1, 2), times(0)[:0]
    values = np.arange(3.0)
    assert len(draw(Trend("x", moments, values, values * 0, (), lost))["line"]) == 1
    lost = times(1) + np.timedelta64(3600, "s")
    parts = draw(Trend("x", moments, values, values * 0, (), lost))
    assert len(parts["lost"]) == 1
    assert [len(line.get("points", "").split()) for line in parts["line"]] == [2]
    assert len(parts["whisker"]) == 1


def test_values_that_were_not_measured_leave_no_point() -> None:
    values = np.array([np.nan, 1.0, np.nan, 3.0])
    parts = draw(Trend("x", times(0, 1, 2, 3), values, np.full(4, 0.1)))
    assert "line" not in parts
    assert len(parts["dot"]) == 2


def test_the_band_is_two_standard_uncertainties_either_way() -> None:
    parts = draw(Trend("x", times(0, 1), np.array([0.0, 1.0]), np.array([0.5, 0.5])))
    band = [tuple(map(float, point.split(","))) for point in parts["band"][0].get("points", "").split()]
    line = [tuple(map(float, point.split(","))) for point in parts["line"][0].get("points", "").split()]
    per_unit = line[0][1] - line[1][1]
    assert band[0][1] == np.float64(line[0][1] - per_unit).round(1)
    assert abs(band[-1][1] - (line[0][1] + per_unit)) <= 0.11


def test_limits_in_reach_are_drawn_and_far_ones_do_not_flatten_the_data() -> None:
    values = np.array([0.0, 1.0, 2.0])
    near, far = Line("warning", "above", 2.5), Line("alarm", "above", 200.0)
    parts = draw(Trend("x", times(0, 1, 2), values, values * 0, (near, far)))
    assert [text.text for text in parts["limit-name"]] == ["warning above 2.5"]


def test_one_scan_alone_is_drawn() -> None:
    parts = draw(Trend("x", times(0), np.array([2.0]), np.array([np.nan])))
    assert len(parts["dot"]) == 1


def test_limits_are_read_from_the_campaign_that_the_store_keeps() -> None:
    opening, lift = alarm_limits(CAMPAIGN)
    assert (opening.name, opening.metric) == ("crack opening", "crack_opening")
    assert opening.lines == (Line("warning", "above", 0.25), Line("alarm", "above", 0.36))
    assert lift.name == "edge_lift"
    for text in ("", "alarms: 3", "- a list", "alarms: [[", "{bad: [yaml"):
        assert alarm_limits(text) == ()

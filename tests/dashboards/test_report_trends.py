"""What a report says of trends: without the environment, where the course changed, how fast each place moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dashboards import Findings, gather, write_report
from dashboards.page import render_page
from dashboards.raster import block_mean
from dashboards.report import make_sections
from pipelines import Acknowledgement, AlarmChange
from storage import Inbox

from .drying import DryingStore, drying_store
from .filled_store import fill_store

SCANS = 40


def render(findings: Findings) -> str:
    return render_page(make_sections(findings), site="Plot", kind="Surface report", software="", templates=None)


@pytest.fixture(scope="module")
def warm() -> DryingStore:
    """A crust whose opening follows the day's temperature, creeps, and jumps once."""
    store = drying_store(SCANS, 48)
    table = store.table.copy()
    hours = np.array((table.index - table.index[0]).total_seconds()) / 3600
    random = np.random.default_rng(1)
    table["temperature"] = 15 + 5 * np.sin(2 * np.pi * hours / 60)
    table["temperature_sigma"] = 0.5
    # six hours behind the temperature: one visit
    late = 15 + 5 * np.sin(2 * np.pi * (hours - 6) / 60)
    table["crack_opening"] = 0.1 + 0.001 * hours / 24 + 0.002 * (late - 15) + random.normal(0, 0.0005, len(hours))
    table["crack_opening_sigma"] = 0.0005
    table["crack_area"] = 5 + random.normal(0, 0.01, len(hours)) + 0.5 * (np.arange(len(hours)) >= 25)
    table["crack_area_sigma"] = 0.01
    about = replace(
        store.about,
        campaign=f"{store.about.campaign}\nenvironment: {{csv: air.csv, temperature_c: t, max_lag_hours: 24}}\n",
        metrics={**store.about.metrics, "temperature": "degree_Celsius"},
    )
    return replace(store, table=table, about=about)


def test_the_corrected_trend_stands_beside_the_raw_one(warm: DryingStore) -> None:
    page = render(gather(warm))
    assert "Rates ± one standard uncertainty" in page
    assert "Crack opening at mean temperature: 0.00" in page
    assert "temperature 0.0020" in page
    assert "mm per °C" in page
    assert ">6 h<" in page
    assert "Temperature at mean" not in page, "the environment is not corrected for itself"


def test_a_course_that_changed_is_told_with_its_size(warm: DryingStore) -> None:
    page = render(gather(warm))
    assert "Where a metric took another course" in page
    row = page.split("<caption>Where a metric took another course")[1].split("</table>")[0]
    assert "Crack area" in row
    assert "0.5" in row


def test_rates_are_mapped_from_the_scans_that_were_read_anyway(warm: DryingStore) -> None:
    findings = gather(warm)
    assert findings.rates is not None
    assert findings.rates.scans == SCANS - 1
    last = warm.scans[-1].change
    assert last is not None
    sure = np.abs(findings.rates.rate) > 3 * findings.rates.sigma
    assert sure.mean() > 0.3, "the crust dries"
    assert np.corrcoef(findings.rates.rate[sure], block_mean(last.dz, 8)[sure])[0, 1] > 0.7
    assert "The map of rates" in render(findings)


def test_each_metric_leads_to_its_definition(warm: DryingStore) -> None:
    page = render(gather(warm))
    for name in ("net_volume", "crack_opening", "edge_lift"):
        assert page.count(f'id="metric-{name}"') == 1
        assert page.count(f'href="#metric-{name}"') >= 2


def test_an_alarm_says_why_and_who_has_seen_it(drying: DryingStore, tmp_path: Path) -> None:
    last = drying.scans[-1].scan.time
    raised = AlarmChange(
        last, "crack opening", "ok", "alarm", "crack opening 0.421 mm, above the limit of 0.36 mm"
    ).event
    seen = Acknowledgement(last + np.timedelta64(1, "h"), "crack opening", "Ann", "sealed").event
    page = render(gather(replace(drying, events=(*drying.events, raised))))
    assert "not acknowledged" in page
    page = render(gather(replace(drying, events=(*drying.events, raised, seen))))
    assert "acknowledged by Ann: sealed, 2026-" in page
    assert "no data after 3 slots" in page
    path = fill_store(replace(drying, events=(*drying.events, raised)), tmp_path / "s.icechunk")
    Inbox(path).put(seen)
    from storage import open_store

    assert "acknowledged by Ann" in write_report(open_store(path), tmp_path / "report").read_text(encoding="utf-8")

"""The report: complete, offline, readable, and honest where there is little to say."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from configs import StoreError
from dashboards import SECTIONS, gather, judge_findings, write_report
from pipelines import Event, Motion
from pipelines.change import NoiseCell, NoiseModel
from storage import Ledger, Stored, ledger_beside

from .drying import SIX_HOURS, START, DryingStore, drying_store

VOID = {"meta", "link", "img", "br", "hr", "line", "rect", "path", "image", "polyline", "polygon", "circle"}


class Page(HTMLParser):
    """Checks nesting and collects sections, links, text and images."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sections: list[str] = []
        self.links: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open, f"not closed: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag not in VOID:
            self.open.append(tag)
        if tag == "section":
            self.sections.append(given["id"] or "")
        if given.get("role") == "img":
            self.images.append(given)
        self.links += [value or "" for name, value in attrs if name in ("href", "src", "xlink:href", "action")]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style", "script"} & set(self.open):
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def folder(drying: DryingStore, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the crust, which most tests look at."""
    made = tmp_path_factory.mktemp("report")
    write_report(drying, made)
    return made


@pytest.fixture(scope="module")
def page(folder: Path) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def page_of(store: DryingStore, folder: Path) -> Page:
    return Page(write_report(store, folder).read_text(encoding="utf-8"))


def test_the_page_holds_every_section_in_order(page: Page) -> None:
    assert page.sections == [name for name in SECTIONS if name != "environment"], "this one has no logger"
    assert page.sections[0] == "verdict"


def test_the_page_asks_for_nothing_outside_itself(page: Page, folder: Path) -> None:
    outside = [link for link in page.links if not link.startswith(("#", "data:"))]
    assert outside == []
    text = (folder / "report.html").read_text(encoding="utf-8")
    own = text.replace("https://github.com/leeoniya/uPlot", "")  # named in the licence of what draws the charts
    assert re.findall(r"https?://|@import|url\(", own) == []


def test_every_drawing_says_what_it_shows(page: Page) -> None:
    # six trends, two height maps, the camera's picture, four change maps, one of rates, one level of detection
    assert len(page.images) == 6 + 2 + 1 + 4 + 1 + 1
    assert all(len(image["aria-label"] or "") > 20 for image in page.images)


def test_the_numbers_on_the_page_are_those_of_the_store(drying: DryingStore, page: Page) -> None:
    text = page.text
    value = drying.table["net_volume"].iloc[-1]
    assert f"−{abs(value):.2f} ± 0.31 mm³" in text
    assert "Visits planned 7 Visits taken 6 Visits missed 0 Visits rejected 0 Visits failed 1" in text
    assert "12 h, from 2026-05-04 12:00 UTC" in text
    for word in ("SNAP0123", "c0ffee0123456789", "5e1ec7ed", "microrelief 0.1.0", "frame 17 of 42 is missing"):
        assert word in text
    assert "120 x 120 cells of 83.33 µm (10 x 10 mm)" in text


def test_the_verdict_in_words(drying: DryingStore) -> None:
    red = judge_findings(gather(drying))
    assert red.tone == "red"
    assert red.headline == "In alarm"
    assert red.reasons == ("Crack opening is 0.421 ± 0.012 mm, above the limit of 0.36 mm.",)

    calm = drying_store(alarm=False)
    green = judge_findings(gather(calm))
    assert (green.tone, green.headline, green.reasons) == (
        "green",
        "All is well",
        ("The one alarm is within its limits.",),
    )

    quiet = replace(calm, scans=[replace(stored, alarms={}) for stored in calm.scans])
    assert judge_findings(gather(quiet)).reasons == ("No alarm is set; the newest scan was measured.",)


def test_a_verdict_is_amber_where_silence_or_doubt_is_newest() -> None:
    calm = drying_store(alarm=False)
    later = calm.scans[-1].scan.time + SIX_HOURS
    silent = replace(calm, events=(*calm.events, Event(later, "missed", "the computer was off")))
    verdict = judge_findings(gather(silent))
    assert (verdict.tone, verdict.headline) == ("amber", "Needs a look")
    assert verdict.reasons == ("The newest visit, 2026-05-06 00:00 UTC, was missed: the computer was off.",)

    last = calm.scans[-1]
    assert last.change is not None
    motion = Motion(np.eye(4), 0.02, 0.3, 0.1, 0.001, 0.01, "doubtful", "only 30 % overlap")
    doubtful: list[Stored] = [*calm.scans[:-1], replace(last, change=replace(last.change, motion=motion))]
    verdict = judge_findings(gather(replace(calm, scans=doubtful)))
    assert verdict.tone == "amber"
    assert verdict.reasons == (
        "Registration of the newest scan is doubtful: only 30 % overlap; its numbers may mislead.",
    )

    dumb: list[Stored] = [*calm.scans[:-1], replace(last, alarms={"crack opening": "no data"})]
    assert judge_findings(gather(replace(calm, scans=dumb))).reasons == ("crack opening: no data.",)


def test_one_scan_makes_a_report_without_trends_or_changes(tmp_path: Path) -> None:
    page = page_of(drying_store(1, 30), tmp_path)
    assert "Trends begin with the second scan" in page.text
    assert len(page.images) == 2  # the height map and the camera's picture
    assert "Nan" not in page.text
    assert "nan" not in re.sub(r"[a-z]*nan[a-z]+", "", page.text)


def test_an_empty_store_makes_a_page_that_says_so(empty: DryingStore, tmp_path: Path) -> None:
    page = page_of(empty, tmp_path)
    assert page.sections == ["verdict", "provenance"]
    assert "No data The store holds no scan yet: run the campaign, then write this report again." in page.text
    assert not (tmp_path / "series.csv").exists()


def test_a_campaign_that_only_failed_says_how_often_and_why(all_failed: DryingStore, tmp_path: Path) -> None:
    page = page_of(all_failed, tmp_path)
    reason = "All 3 visits yielded no scan. The last one, 2026-05-04 08:00 UTC: the projector does not answer."
    assert reason in page.text
    assert page.sections == ["verdict", "period", "events", "provenance"]


def test_scans_without_a_single_measured_cell_do_not_stop_the_report(tmp_path: Path) -> None:
    store = drying_store(3, 20)
    blind: list[Stored] = []
    for stored in store.scans:
        nothing = np.full(stored.scan.grid.shape, np.nan, dtype=np.float32)
        change = None if stored.change is None else replace(stored.change, dz=nothing, lod=nothing)
        blind.append(replace(stored, scan=replace(stored.scan, height=nothing, sigma=nothing), change=change))
    page = page_of(replace(store, scans=blind), tmp_path)
    assert "maps" in page.sections


def test_a_change_of_grid_between_epochs_is_no_obstacle(tmp_path: Path) -> None:
    old, new = drying_store(2, 24), drying_store(3, 30)
    moved = [
        replace(stored, number=stored.number + 2, epoch=1, baseline=2, planned=stored.planned + 9 * SIX_HOURS)
        for stored in new.scans
    ]
    table = pd.concat([old.table, new.table.set_axis(new.table.index + pd.Timedelta(days=3))])
    table.attrs = old.table.attrs
    store = replace(new, scans=[*old.scans, *moved], table=table)
    assert "epoch 1" in page_of(store, tmp_path).text


def test_names_from_a_campaign_are_text_and_never_markup(tmp_path: Path) -> None:
    store = drying_store(2, 20, site="<script>alert(1)</script> & co")
    text = write_report(store, tmp_path).read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; co" in text


def test_visits_come_from_the_ledger_where_there_is_one(tmp_path: Path) -> None:
    store = drying_store(4, 20, location=str(tmp_path / "site.icechunk"))
    ledger = Ledger(ledger_beside(tmp_path / "site.icechunk"))
    for slot in range(5):
        ledger.settle(START + slot * SIX_HOURS, "taken")
    ledger.settle(START + 5 * SIX_HOURS, "missed", "power cut")
    ledger.plan(START + 6 * SIX_HOURS)
    ledger.close()
    text = page_of(store, tmp_path / "out").text
    assert "Visits planned 6 Visits taken 5 Visits missed 1" in text
    assert "was missed: power cut." in text


def test_the_series_lies_beside_the_page(drying: DryingStore, folder: Path) -> None:
    parquet = pd.read_parquet(folder / "series.parquet")
    csv = pd.read_csv(folder / "series.csv", comment="#")
    assert len(parquet) == len(csv) == 6
    column = next(name for name in csv.columns if name.startswith("net_volume") and "sigma" not in name)
    np.testing.assert_allclose(csv[column], drying.table["net_volume"])


def test_the_noise_model_behind_levels_of_detection_is_told(drying: DryingStore, page: Page, tmp_path: Path) -> None:
    cell = NoiseCell(0.003, 0.4, 1234, 0.0051, 0.005, 0.052)
    model = NoiseModel(0.002, 1.5, 0.004, np.ones(1), 0.01, 0.0001, 0.048, 8, 8, "monday", "friday", cells=(cell,))
    assert "noise model" not in page.text
    text = page_of(replace(drying, about=replace(drying.about, noise=model)), tmp_path / "with").text
    assert f"noise model {model.id}, calibrated on 8 scans at rest from monday to friday" in text
    assert "4.8 % were beyond the 95 % level" in text
    assert "1234" in text


def test_a_folder_that_cannot_be_made_is_said_in_one_line(drying: DryingStore, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(StoreError, match="cannot write the report there"):
        write_report(drying, tmp_path / "taken")


def test_a_long_campaign_is_sampled_for_quality_and_keeps_its_newest_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dashboards.findings._MOST_READ", 5)
    store = drying_store(12, 10)
    findings = gather(store)
    assert len(findings.quality) == 5
    assert findings.quality[-1].number == 11
    assert findings.between[-1].number == 11
    assert len(findings.visits) == 13

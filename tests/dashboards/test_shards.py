"""Shards: only what is new or has changed is drawn again, and nothing stale is ever shown."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from configs import MicroreliefError, StoreError
from dashboards import update_shards
from dashboards.shards import cache_folder
from monitor.reprocess import campaign_of, process, rules_of
from pipelines import Tick
from storage import engine, only_grown, open_store

from .drying import START, DryingStore, drying_store
from .filled_store import fill_store

CELLS = 40


def first(scans: int, whole: DryingStore) -> DryingStore:
    """The store as it was when it held so many scans."""
    about = replace(whole.about, snapshot=f"SNAP{scans}")
    return replace(whole, about=about, scans=whole.scans[:scans], table=whole.table.iloc[:scans])


@pytest.fixture
def grown(monkeypatch: pytest.MonkeyPatch) -> Callable[[bool], None]:
    """Say whether the in-memory stores of a test, which have no snapshots, only grew."""

    def say(only: bool) -> None:
        monkeypatch.setattr("dashboards.shards.only_grown", lambda store, since: only)

    return say


def series(file: Path, path: str) -> list[int]:
    """Scan numbers at which something was logged."""
    from rerun.chunk import RrdReader

    found: list[int] = []
    for chunk in RrdReader(file).store().stream():
        if str(chunk.entity_path) == path:
            found += chunk.to_record_batch().to_pydict().get("scan", [])
    return sorted(found)


def test_a_file_for_each_day_and_only_new_days_are_drawn(tmp_path: Path, grown: Callable[[bool], None]) -> None:
    whole = drying_store(8, CELLS)  # four a day from 6:00; the third visit of the first day failed
    grown(True)
    early = update_shards(first(5, whole), tmp_path)
    assert early.made == 5
    assert list(early.files) == ["frame", "history", "2026-05-04", "2026-05-05"]
    kept = early.files["2026-05-04"].stat().st_mtime_ns
    assert update_shards(first(5, whole), tmp_path).made == 0
    seen: list[tuple[int, int]] = []
    late = update_shards(first(8, whole), tmp_path, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (late.made, late.made)
    assert late.files["2026-05-04"].stat().st_mtime_ns == kept
    drawn = [series(file, "/surface/mesh") for day, file in late.files.items() if day.startswith("2026")]
    assert [number for day in drawn for number in day] == list(range(8))
    assert late.made == 8 - len(drawn[0])


def test_cracks_keep_their_names_from_day_to_day(tmp_path: Path, grown: Callable[[bool], None]) -> None:
    whole = drying_store(8, 80)  # whose crack is narrower than a cell in the first scan
    grown(True)
    update_shards(first(4, whole), tmp_path)
    files = update_shards(whole, tmp_path).files
    days = [file for day, file in files.items() if day.startswith("2026")]
    assert [number for file in days for number in series(file, "/cracks/1")] == list(range(1, 8))
    assert not any(series(file, "/cracks/9") for file in days)


def test_what_was_processed_again_is_drawn_again(tmp_path: Path, grown: Callable[[bool], None]) -> None:
    whole = drying_store(4, CELLS)
    update_shards(whole, tmp_path)
    grown(False)
    assert update_shards(whole, tmp_path).made == 4


def test_values_beyond_the_scales_are_drawn_by_new_ones(tmp_path: Path, grown: Callable[[bool], None]) -> None:
    whole = drying_store(4, CELLS)
    grown(True)
    narrow = update_shards(whole, tmp_path).layout.scales
    last = whole.scans[-1]
    assert last.change is not None
    fallen = replace(last, change=replace(last.change, dz=last.change.dz - np.float32(5)))
    sunk = replace(whole, scans=(*whole.scans[:-1], fallen))
    again = update_shards(sunk, tmp_path)
    assert again.made == 4
    assert again.layout.scales.change_limit_mm > 2 * narrow.change_limit_mm


@pytest.mark.parametrize("text", ["", "{", "[1]", json.dumps({"recipe": 1, "snapshot": "", "scales": 3, "days": {}})])
def test_a_list_that_cannot_be_read_is_made_again(text: str, tmp_path: Path, grown: Callable[[bool], None]) -> None:
    whole = drying_store(2, CELLS)
    grown(True)
    update_shards(whole, tmp_path)
    (tmp_path / "shards.json").write_text(text, encoding="utf-8")
    assert update_shards(whole, tmp_path).made == 2


def test_work_that_was_cut_short_goes_on_where_it_stood(tmp_path: Path, grown: Callable[[bool], None]) -> None:
    whole = drying_store(8, CELLS)
    grown(True)

    def cut(done: int, total: int) -> None:
        if done == 7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        update_shards(whole, tmp_path, progress=cut)
    assert 0 < update_shards(whole, tmp_path).made < 8
    assert not list(tmp_path.glob(".*"))


def test_a_full_disk_is_said_before_anything_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dashboards.shards._SPARE_BYTES", 10**18)
    with pytest.raises(MicroreliefError, match=r"a review of 2 scans takes .* GB there .*--scans FIRST:LAST"):
        update_shards(drying_store(2, CELLS), tmp_path)


def test_an_empty_store_has_none(empty: DryingStore, tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="holds no scan yet"):
        update_shards(empty, tmp_path)


def test_a_store_on_disk_grows_is_rebaselined_and_never_shows_the_old(tmp_path: Path) -> None:
    source = drying_store(3, CELLS)
    source = replace(source, about=replace(source.about, campaign=""))
    path = fill_store(source, tmp_path / "plot.icechunk")
    folder = cache_folder(open_store(path))
    assert folder == tmp_path / "plot.review"
    assert update_shards(open_store(path), folder).made == 3
    before = open_store(path).about.snapshot
    extra = drying_store(8, CELLS).scans[-1]
    store = open_store(path, write=True)
    store.append(Tick(extra.planned, extra.scan, extra.change))
    assert only_grown(store, before)
    assert update_shards(store, folder).made == 1
    rules = rules_of(campaign_of(store), store)
    with engine(1) as spread:
        process(store, rules, spread, first=1, last=1, now=START + np.timedelta64(30, "D"), baseline=True)
    store.close()
    again = open_store(path)
    assert not only_grown(again, before)
    assert update_shards(again, folder).made == 4


def test_a_store_in_a_bucket_is_drawn_elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    store = drying_store(1, CELLS, location="s3://bucket/site")
    folder = cache_folder(store)
    assert folder.is_relative_to(tmp_path) or "microrelief" in str(folder)
    assert folder != cache_folder(drying_store(1, CELLS, location="s3://bucket/other"))

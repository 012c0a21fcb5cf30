"""A chosen baseline begins an epoch: later scans are compared with it, and the store says so."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from monitor.cli import run_tokens
from monitor.visit import Rules, compare_with
from storage import Store, open_store
from tests.monitor.stored import fill


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("made") / "s"
    fill(path, 5).close()
    return path


@pytest.fixture
def path(made: Path, tmp_path: Path) -> Path:
    shutil.copytree(made, tmp_path / "s")
    return tmp_path / "s"


def gained(store: Store) -> list[float]:
    return [round(float(value)) for value in store.series()["gained_volume"].fillna(-1)]


def test_followers_are_compared_with_the_chosen_scan(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = open_store(path)
    heights = [before[number].scan.height for number in range(5)]
    was = gained(before)
    assert run_tokens(["rebaseline", str(path), "--scan", "2"]) == 0
    store = open_store(path)
    assert [store[number].baseline for number in range(5)] == [0, 0, 2, 2, 2]
    assert [store[number].epoch for number in range(5)] == [0, 0, 1, 1, 1]
    assert store[2].change is None
    now = gained(store)
    assert now[:2] == was[:2]
    assert now[2] == -1
    for number in (3, 4):
        alone = compare_with(store[2].scan, store[number].scan, Rules(store[2].scan.grid, metrics=("gained_volume",)))
        assert now[number] == round(alone.metrics["gained_volume"].value)
        assert 0 < now[number] < was[number], "the block rises with each scan: it gained less since the second"
    for number in range(5):
        np.testing.assert_array_equal(store[number].scan.height, heights[number])
    told = [event.text for event in store.events if event.kind in ("epoch", "note")]
    assert "epoch 1 begins: scan 2 was chosen as baseline" in told
    assert any(text.startswith("scan 2 is the new baseline of those after it") for text in told)
    assert "epoch 1 begins at scan 2, its baseline; 2 later scans worked out again" in capsys.readouterr().out
    assert run_tokens(["verify", str(path)]) == 0


def test_the_newest_may_be_chosen_and_once_is_enough(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["rebaseline", str(path), "--scan", "-1"]) == 0
    assert open_store(path)[4].baseline == 4
    assert run_tokens(["rebaseline", str(path), "--scan", "4"]) == 2
    assert "scan 4 is the baseline of its epoch already" in capsys.readouterr().err


def test_a_scan_that_is_not_there_is_refused(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens(["rebaseline", str(path), "--scan", "9"]) == 2
    assert "has no such scan, the newest is 4" in capsys.readouterr().err

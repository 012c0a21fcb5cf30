"""A campaign whose store is in a bucket: every command that knows a store takes it, and the ledger stays here."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from configs import Campaign
from monitor.campaign import run_campaign
from monitor.cli import run_tokens
from monitor.clock import AcceleratedClock
from pipelines import instant
from storage import Ledger, ledger_beside, open_store

from .campaigns import BASE, Rig, campaign_in, simulated_campaign_in, work

Capture = pytest.CaptureFixture[str]


def _on_s3(folder: Path, url: str, until: str) -> tuple[Campaign, Path]:
    """A stand-in campaign and its file, whose whole store entry is a URL."""
    campaign = campaign_in(folder, until=until)
    kept = campaign.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    file = folder / "site.yaml"
    file.write_text(json.dumps({**kept, "store": url}, indent=1), encoding="utf-8")
    return Campaign.model_validate({**kept, "store": url}, context={"folder": folder}), file


def test_run_status_report_and_review(tmp_path: Path, s3_prefix: str, capsys: Capture) -> None:
    url = f"{s3_prefix}/site.icechunk"
    campaign, file = _on_s3(tmp_path, url, "2026-01-01T04:00:00+00:00")
    assert (campaign.store.path, campaign.store.beside) == (url, tmp_path)
    text = file.read_text(encoding="utf-8")
    clock = AcceleratedClock(instant(BASE))
    first = run_campaign(campaign, clock=clock, rig=Rig(), work=work, text=text, max_scans=2)
    second = run_campaign(campaign, clock=clock, rig=Rig(), work=work, text=text)
    assert (first.taken, second.taken) == (2, 3)

    address = ledger_beside(url, tmp_path)
    assert address.file == tmp_path / "ledger.sqlite"
    ledger = Ledger(address, write=False)
    assert ledger.counts() == {"planned": 0, "taken": 5, "missed": 0, "rejected": 0, "failed": 0}
    ledger.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "calibration.json",
        "ledger.sqlite",
        "site.health.sqlite",
        "site.yaml",
    ]

    for given in (str(file), url):
        code = run_tokens(["status", given, "--json"])
        told = json.loads(capsys.readouterr().out)
        assert (code, told["scans"], told["state"], told["store"]) == (0, 5, "ok", url), given
    assert run_tokens(["status", url]) == 0
    assert "disk" not in capsys.readouterr().out
    assert run_tokens(["report", url, "--out", str(tmp_path / "report")]) == 0
    assert (tmp_path / "report" / "report.html").exists()
    assert run_tokens(["review", url, "--save", str(tmp_path / "review.rrd")]) == 0
    assert (tmp_path / "review.rrd").stat().st_size > 0
    capsys.readouterr()
    assert run_tokens(["run", str(file), "--dry-run"]) == 0
    assert "free" not in capsys.readouterr().out


def test_a_simulated_rig_keeps_its_calibration_with_the_campaign(tmp_path: Path) -> None:
    from monitor.recipe import read_pattern_set, simulated_calibration_file

    kept = simulated_campaign_in(tmp_path, "2026-01-02T00:00:00+00:00").model_dump(mode="json", exclude_defaults=True)
    kept["register"] = kept.pop("register_")
    campaign = Campaign.model_validate({**kept, "store": "s3://bucket/soil.icechunk"}, context={"folder": tmp_path})
    file = simulated_calibration_file(campaign, read_pattern_set(campaign))
    assert file.parent == tmp_path
    assert file.name.startswith("soil.calibration-")


def test_another_folder_for_what_lies_beside(tmp_path: Path) -> None:
    kept = campaign_in(tmp_path).model_dump(mode="json", by_alias=True, exclude_defaults=True)
    store = {"path": "s3://bucket/soil", "folder": "state"}
    assert (
        Campaign.model_validate({**kept, "store": store}, context={"folder": tmp_path}).store.beside
        == tmp_path / "state"
    )


def test_what_is_wrong_with_the_bucket_is_one_line(tmp_path: Path, s3_prefix: str, capsys: Capture) -> None:
    _, file = _on_s3(tmp_path, "s3://no-such-bucket-here/site", "2026-01-01T04:00:00+00:00")
    for words in (["status", str(file)], ["run", str(file)]):
        assert run_tokens(words) == 1
        told = capsys.readouterr().err.strip()
        assert "there is no bucket no-such-bucket-here" in told
        assert "\n" not in told
    assert not (tmp_path / "ledger.sqlite").exists()


@pytest.mark.parametrize("place", ["gs://bucket/site", "s3://", "s3://bucket", "s3://Bucket_/x", "https://x.org/y"])
def test_a_place_that_is_none_is_told_where_it_stands(tmp_path: Path, place: str, capsys: Capture) -> None:
    _, file = _on_s3(tmp_path, "s3://bucket/site", "2026-01-01T04:00:00+00:00")
    file.write_text(file.read_text(encoding="utf-8").replace("s3://bucket/site", place), encoding="utf-8")
    assert run_tokens(["status", str(file)]) == 2
    told = capsys.readouterr().err
    line = next(number for number, text in enumerate(file.read_text().splitlines(), 1) if '"store"' in text)
    assert f"site.yaml:{line}:" in told
    assert f"{place!r} is no place for a store: give a folder, or s3://BUCKET/PREFIX" in told


def test_a_crash_leaves_a_ledger_that_the_next_run_settles(tmp_path: Path, s3_prefix: str) -> None:
    campaign, _ = _on_s3(tmp_path, s3_prefix, "2026-01-01T04:00:00+00:00")
    ledger = Ledger(ledger_beside(campaign.store.path, campaign.store.beside))
    ledger.plan(instant(BASE))
    ledger.close()
    outcome = run_campaign(campaign, clock=AcceleratedClock(instant(BASE)), rig=Rig(), work=work)
    assert outcome.taken == 4
    assert [event.kind for event in open_store(s3_prefix).events].count("missed") == 1

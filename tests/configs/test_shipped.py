"""The campaigns that ship: each dry-runs without hardware, and the schema beside them is current."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path

import jsonschema
import pytest

from configs import read_campaign
from monitor.check import load_checked
from monitor.cli import run_tokens
from monitor.commands.schema import schema_text

FOLDER = Path(str(files("configs")))
CAMPAIGNS = sorted(file.name for file in FOLDER.glob("*.yaml"))


def test_these_ship() -> None:
    assert CAMPAIGNS == ["area.yaml", "demo.yaml", "microbes.yaml", "site.yaml", "soil.yaml", "video.yaml"]


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_each_dry_runs(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / name
    file.write_text((FOLDER / name).read_text(encoding="utf-8"), encoding="utf-8")
    assert run_tokens(["run", str(file), "--dry-run"]) == 0
    told = capsys.readouterr().out
    assert told.count("scan due 2") == 6
    assert "a scan, estimated" in told
    assert [path.name for path in tmp_path.iterdir()] == [name], "a dry run writes nothing"


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_each_is_commented_and_names_the_schema(name: str) -> None:
    text = (FOLDER / name).read_text(encoding="utf-8")
    assert text.startswith("# yaml-language-server: $schema=campaign.schema.json\n")
    assert text.count("#") >= 8


def test_the_schema_that_ships_is_current() -> None:
    shipped = (FOLDER / "campaign.schema.json").read_text(encoding="utf-8")
    assert shipped == schema_text(), "run: microrelief schema --out configs/campaign.schema.json"


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_the_schema_accepts_what_we_accept(name: str) -> None:
    jsonschema.validate(read_campaign(FOLDER / name).document.data, json.loads(schema_text()))


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("schedule", "evry"), "6 h"),
        (("schedule", "every"), 6),
        (("schedule", "every"), "6 parsecs "),
        (("rig", "name"), "simulatd"),
        (("rig", "options"), {"sed": 1}),
        (("metrics",), ["net_volum"]),
        (("store", "kind"), "zar"),
    ],
)
def test_the_schema_refuses_what_we_refuse(keys: tuple[str, ...], value: object) -> None:
    data = read_campaign(FOLDER / "soil.yaml").document.data
    part = data
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = value
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(data, json.loads(schema_text()))


def test_registered_names_are_checked_with_their_place(tmp_path: Path) -> None:
    text = (FOLDER / "soil.yaml").read_text(encoding="utf-8")
    for right, wrong, expected in [
        ("name: simulated ", "name: simulatd ", "rig.name: no rig 'simulatd', did you mean 'simulated'?"),
        ("seed: 3", "sed: 3", "rig.options.sed: unknown option, did you mean 'seed'?"),
        ("camera: [960, 720]", "camera: [960]", "rig.options.camera: "),
        ("crack_area,", "crack_are,", "metrics[3]: no metric 'crack_are', did you mean 'crack_area'?"),
        ("unit: mm ", "unit: cm ", "alarms[0].unit: crack_opening is in mm, not 'cm'"),
        ("kind: gray", "kind: grey", "patterns.kind: "),
        ("every: 6 h", "cron: 0 0 * *", "schedule.cron: a cron line has 5 fields"),
        ("path: soil.icechunk", "path: soil\n  kind: icechunkk", "store.kind: no store of kind 'icechunkk', did you"),
    ]:
        assert right in text
        file = tmp_path / "site.yaml"
        changed = text.replace(right, wrong, 1)
        file.write_text(changed, encoding="utf-8")
        with pytest.raises(ValueError, match=r"site\.yaml") as caught:
            load_checked(file)
        place, _, message = str(caught.value).removeprefix(f"{file}:").partition(": ")
        line = int(place.split(":")[0])
        assert message.startswith(expected), str(caught.value)
        assert wrong.splitlines()[-1].split(":")[0].strip() in changed.splitlines()[line - 1]

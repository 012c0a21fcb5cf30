"""Campaign files: every mistake is named with its line and column, and nothing is accepted and ignored."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from configs import ConfigError, InputError, format_duration, load_campaign, parse_duration, read_campaign

GOOD = """\
site:
  name: Plot 7
  zone: Europe/Berlin
store:
  path: plot7.icechunk
rig:
  name: simulated
  options: {seed: 1}
schedule:
  every: 6 h
  start: 2026-01-01 00:00
calibration:
  file: calibration.json
region_mm: [[0, 0], [1, 0], [1, 1]]
metrics: [net_volume, lost_volume]
alarms:
  - name: erosion
    metric: lost_volume
    warn_above: 1
    alarm_above: 2
"""


def write(folder: Path, text: str) -> Path:
    file = folder / "site.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def problems(folder: Path, text: str) -> list[str]:
    file = write(folder, text)
    with pytest.raises(ConfigError) as caught:
        load_campaign(file)
    assert caught.value.exit_code == 2
    return [line.removeprefix(f"{folder}/") for line in str(caught.value).splitlines()]


def test_a_good_campaign_is_read(tmp_path: Path) -> None:
    campaign = load_campaign(write(tmp_path, GOOD))
    assert campaign.schedule.every == timedelta(hours=6)
    assert campaign.start == datetime(2025, 12, 31, 23, tzinfo=UTC), "midnight in the site's zone"
    assert campaign.store.path == tmp_path / "plot7.icechunk", "relative to the file"
    assert campaign.calibration.file == tmp_path / "calibration.json"
    assert campaign.alarms[0].warn_above == 1.0
    assert campaign.retain.raw_frames == "off"


def test_a_campaign_is_frozen(tmp_path: Path) -> None:
    campaign = load_campaign(write(tmp_path, GOOD))
    with pytest.raises(ValueError, match="frozen"):
        campaign.site.name = "other"


MISTAKES = [
    ("every: 6 h", "evry: 6 h", "site.yaml:10:3: schedule.evry: unknown key, did you mean 'every'?"),
    ("warn_above: 1", "warn_abve: 1", "site.yaml:19:5: alarms[0].warn_abve: unknown key, did you mean 'warn_above'?"),
    ("region_mm:", "region:", "site.yaml:14:1: region: unknown key, did you mean 'region_mm'?"),
    ("rig:", "rigg:", "site.yaml:6:1: rigg: unknown key, did you mean 'rig'?"),
    ("zone: Europe/Berlin", "zzz: 1", "site.yaml:3:3: site.zzz: unknown key; known here: name, zone"),
    ("every: 6 h", "every: 6", "site.yaml:10:10: schedule.every: needs a unit, such as 6 s, 6 min or 6 h"),
    (
        "every: 6 h",
        "every: 6 parsecs",
        "site.yaml:10:10: schedule.every: unknown unit 'parsecs': "
        "write a number and s, min, h, days or weeks, such as 6 h",
    ),
    (
        "every: 6 h",
        "every: 0.1 s",
        "site.yaml:10:10: schedule.every: must be at least 0.2 s: for a higher rate use video: {rate_hz: ...}",
    ),
    (
        "every: 6 h",
        'every: 6 h\n  cron: "0 * * * *"',
        "site.yaml:9:1: schedule: needs exactly one of every, cron and video, not every and cron",
    ),
    ("every: 6 h\n", "", "site.yaml:9:1: schedule: needs exactly one of every, cron and video, not none"),
    (
        "every: 6 h",
        "video: {rate_hz: 0}",
        "site.yaml:10:20: schedule.video.rate_hz: must be more than 0, not 0",
    ),
    (
        "every: 6 h",
        "video: {rate_hz: 1}",
        "site.yaml:11:10: schedule.start: has no meaning with video, which starts when it is started",
    ),
    (
        "start: 2026-01-01 00:00",
        "start: tomorrow",
        "site.yaml:11:10: schedule.start: 'tomorrow' is not a time: write it like 2026-11-22T21:00:00Z",
    ),
    (
        "start: 2026-01-01 00:00",
        "start: 2026-01-01 00:00\n  until: 2025-01-01",
        "site.yaml:12:10: schedule.until: lies before start",
    ),
    (
        "Europe/Berlin",
        "Europe/Berln",
        "site.yaml:3:9: site.zone: 'Europe/Berln' is not a time zone: use a name like Europe/Berlin or UTC",
    ),
    ("name: Plot 7", "name: 7", "site.yaml:2:9: site.name: must be text, not 7; put quotes around it"),
    ("name: Plot 7", "name: ''", "site.yaml:2:9: site.name: must not be empty"),
    ("name: Plot 7", "name:", "site.yaml:2:3: site.name: must be text, not nothing; put quotes around it"),
    ("warn_above: 1", "warn_above: much", "site.yaml:19:17: alarms[0].warn_above: must be a number, not 'much'"),
    ("warn_above: 1", "warn_above: .inf", "site.yaml:19:17: alarms[0].warn_above: must be a finite number, not inf"),
    (
        "warn_above: 1",
        "warn_above: 3",
        "site.yaml:19:17: alarms[0].warn_above: must not be above alarm_above, 2",
    ),
    (
        "metric: lost_volume",
        "metric: crack_area",
        "site.yaml:18:13: alarms[0].metric: 'crack_area' is not among this campaign's metrics",
    ),
    (
        "metrics: [net_volume, lost_volume]",
        "metrics: [lost_volume, lost_volume]",
        "site.yaml:15:24: metrics[1]: 'lost_volume' is given twice",
    ),
    (
        "metrics: [net_volume, lost_volume]",
        "metrics: lost_volume",
        "site.yaml:15:10: metrics: must be a list, not 'lost_volume'",
    ),
    ("[1, 1]]", "[1, x]]", "site.yaml:14:33: region_mm[2][1]: must be a number, not 'x'"),
    (", [1, 1]]", "]", "site.yaml:14:12: region_mm: needs at least 3 points, not 2"),
    (
        "file: calibration.json",
        "simulated: yes",
        "site.yaml:13:14: calibration.simulated: must be true or false, not 'yes'",
    ),
    (
        "file: calibration.json",
        "simulated: false",
        "site.yaml:12:1: calibration: needs either file: calibration.json or simulated: true",
    ),
    (
        "region_mm:",
        "retain: {raw_frames: some}\nregion_mm:",
        "site.yaml:14:22: retain.raw_frames: must be off, all, or how long, such as 30 days, not 'some'",
    ),
    (
        "region_mm:",
        "patterns: 3\nregion_mm:",
        "site.yaml:14:11: patterns: must be a pattern set, such as {kind: gray, size: [608, 684]}, "
        "or the name of a pattern file",
    ),
    ("region_mm:", "site: {}\nregion_mm:", "site.yaml:14:1: site: given twice, first in line 1"),
    (
        "schedule:\n",
        "schedule: soon\nother:\n",
        "site.yaml:9:11: schedule: must hold keys of its own, indented below it, not 'soon'",
    ),
    ("  zone:", "\tzone:", "site.yaml:3:1: not YAML: a tab: indent with spaces"),
    ("name: Plot 7", "name: Plot: 7", "site.yaml:2:13: not YAML: a ':' where none can be"),
    ("[[0, 0]", "[[0, 0", "site.yaml:15:1: not YAML"),
]


@pytest.mark.parametrize(("right", "wrong", "expected"), MISTAKES)
def test_each_mistake_is_named_where_it_stands(tmp_path: Path, right: str, wrong: str, expected: str) -> None:
    assert right in GOOD
    found = problems(tmp_path, GOOD.replace(right, wrong, 1))
    assert any(line.startswith(expected) for line in found), "\n".join(found)


def test_all_mistakes_are_told_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    text = GOOD.replace("every:", "evry:").replace("warn_above: 1", "warn_above: x").replace("Berlin", "Berln")
    found = problems(tmp_path, text)
    assert [line.split(": ")[0] for line in found] == ["site.yaml:3:9", "site.yaml:10:3", "site.yaml:19:17"]


def test_a_missing_part_says_what_belongs_there(tmp_path: Path) -> None:
    text = GOOD.replace("store:\n  path: plot7.icechunk\n", "")
    assert problems(tmp_path, text) == [
        "site.yaml:1:1: store: missing: add `store:` with path, kind, reserve_mb, folder"
    ]


def test_a_missing_key_is_placed_at_its_parent(tmp_path: Path) -> None:
    text = GOOD.replace("  path: plot7.icechunk\n", "  kind: icechunk\n")
    assert problems(tmp_path, text) == ["site.yaml:4:1: store.path: missing: add `path:`"]


@pytest.mark.parametrize("text", ["", "# only a comment\n"])
def test_an_empty_file_says_so(tmp_path: Path, text: str) -> None:
    assert problems(tmp_path, text)[0].startswith("site.yaml:1:1: empty")


@pytest.mark.parametrize("text", ["- a\n- b\n", "just words\n"])
def test_something_else_than_keys_says_so(tmp_path: Path, text: str) -> None:
    assert problems(tmp_path, text)[0].startswith("site.yaml:1:1: a campaign is")


def test_a_missing_file_a_folder_and_a_binary_file_say_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such campaign file"):
        load_campaign(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="is a folder"):
        load_campaign(tmp_path)
    (tmp_path / "image.yaml").write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(InputError, match="is not a text file"):
        load_campaign(tmp_path / "image.yaml")


def test_times_stay_text_until_their_zone_is_known(tmp_path: Path) -> None:
    file = read_campaign(write(tmp_path, GOOD.replace("2026-01-01 00:00", "2026-07-01T00:00:00Z")))
    assert file.document.data["schedule"]["start"] == "2026-07-01T00:00:00Z"
    assert file.campaign.start == datetime(2026, 7, 1, tzinfo=UTC)


@settings(deadline=None)
@given(st.text(max_size=80))
def test_no_text_makes_it_crash(text: str) -> None:
    from configs import parse_campaign

    with pytest.raises(ConfigError) as caught:
        parse_campaign(text, "site.yaml", Path())
    assert all(line.startswith("site.yaml:") for line in str(caught.value).splitlines() if line)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("6 h", 21600), ("90s", 90), ("1 h 30 min", 5400), ("2 days", 172800), ("1 week", 604800), ("250 ms", 0.25)],
)
def test_durations(text: str, seconds: float) -> None:
    assert parse_duration(text).total_seconds() == seconds


@settings(deadline=None)
@given(st.integers(1, 10**9).map(lambda n: timedelta(milliseconds=n)))
def test_durations_read_back_as_written(length: timedelta) -> None:
    assert abs(parse_duration(format_duration(length)) - length) <= length * 1e-5

"""Keys of alarms and of the environment: what is wrong is told with file, line and column."""

from __future__ import annotations

from pathlib import Path

import pytest

from configs import Campaign, ConfigError, load_campaign
from configs.places import read_yaml

BEGIN = """site: {name: x}
store: x.icechunk
rig: {name: simulated}
schedule: {every: 1 h}
calibration: {simulated: true}
metrics: [net_volume]
"""


def load(folder: Path, text: str) -> Campaign:
    (folder / "c.yaml").write_text(BEGIN + text, encoding="utf-8")
    return load_campaign(folder / "c.yaml")


@pytest.mark.parametrize(
    ("alarm", "column", "said"),
    [
        ("", 5, "needs a limit: warn_above"),
        (", within_days: 3, chart: ewma", 53, "within_days: has no meaning without a limit such as alarm_above"),
        (", warn_above: 1, window_days: 3", 68, "window_days: has no meaning without a limit such as alarm_rate_above"),
        (", warn_above: 1, chart_model: line", 68, "chart_model: has no meaning without chart"),
        (", warn_above: 1, confirm: [3, 2]", 64, "confirm: is [m, n] with m of the newest n values: 3 of 2?"),
        (", warn_above: 1, confirm: [0, 2]", 65, "must be at least 1, not 0"),
        (", warn_above: 1, no_data_after_slots: 0", 76, "must be at least 1, not 0"),
        (", chart: cusum, false_alarm_every_scans: 3", 79, "must be at least 10, not 3"),
        (", chart: shewhart", 47, "must be one of 'cusum', 'ewma', not 'shewhart'"),
        (
            ", warn_rate_above_per_day: 2, alarm_rate_above_per_day: 1",
            65,
            "must not be above alarm_rate_above_per_day, 1",
        ),
        (", warn_abov: 1", 40, "unknown key, did you mean 'warn_above'?"),
    ],
)
def test_alarms_that_make_no_sense(tmp_path: Path, alarm: str, column: int, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, f"alarms:\n  - {{name: volume, metric: net_volume{alarm}}}\n")
    (line,) = str(caught.value).splitlines()
    assert f"c.yaml:8:{column}: alarms[0]" in line, line
    assert said in line, line


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{temperature_c: t}", "7:14: environment: needs exactly one of csv, http and mqtt, not none"),
        ("{csv: a.csv, http: 'http://x/y', temperature_c: t}", "not csv and http"),
        ("{csv: a.csv}", "environment: needs temperature_c, humidity_percent or both"),
        ("{http: 'ftp://x', temperature_c: t}", "7:21: environment.http: must be an address such as http://"),
        ("{mqtt: 'mqtt://broker', temperature_c: t}", "environment.mqtt: must be an address such as mqtt://"),
        ("{http: 'http://x/', temperature_c: t, time_column: when}", "time_column: has no meaning without csv"),
        ("{csv: a.csv, temperature: t}", "environment.temperature: unknown key, did you mean 'temperature_c'?"),
    ],
)
def test_environments_that_make_no_sense(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, f"environment: {text}\n")
    assert said in str(caught.value)


def test_a_whole_alarm_and_its_environment(tmp_path: Path) -> None:
    campaign = load(
        tmp_path,
        """alarms:
  - {name: v, metric: net_volume, warn_above: 1, alarm_above: 2, confirm: [2, 3], clear_by: 0.1, within_days: 3,
     window_days: 9, warn_rate_above_per_day: 0.5, chart: ewma, chart_model: line, false_alarm_every_scans: 1000}
environment: {csv: air.csv, temperature_c: t, humidity_percent: rh, max_lag_hours: 12}
""",
    )
    (alarm,) = campaign.alarms
    assert alarm.confirm == (2, 3)
    assert campaign.environment is not None
    assert campaign.environment.csv == tmp_path / "air.csv"
    assert campaign.environment.sigmas == {"temperature": 0.5, "humidity": 3.0}


def test_the_commented_environment_of_the_shipped_campaign_is_right(tmp_path: Path) -> None:
    text = (Path(__file__).resolve().parents[2] / "configs" / "soil.yaml").read_text(encoding="utf-8")
    block = text[text.index("# environment:") :].split("\n\n")[0]
    plain = "\n".join(line.removeprefix("# ").removeprefix("#") for line in block.splitlines())
    assert load(tmp_path, plain + "\n").environment is not None
    assert read_yaml(plain, "x").data["environment"]["humidity_percent"] == "rh"

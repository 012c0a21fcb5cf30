"""The command line: help with an example everywhere, one clear line and the right exit code for every mistake."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from monitor.campaign import run_campaign
from monitor.cli import COMMANDS, main, run_tokens
from monitor.clock import AcceleratedClock
from monitor.standing import look
from pipelines import instant

from .campaigns import BASE, Rig, campaign_in, work

T0 = instant(BASE)
Capture = pytest.CaptureFixture[str]


def test_help_lists_every_command_with_what_it_does(capsys: Capture) -> None:
    assert run_tokens(["--help"]) == 0
    told = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for name, (_, about) in COMMANDS.items():
        assert f"{name} {about}" in told


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_shows_an_example(name: str, capsys: Capture) -> None:
    assert run_tokens([name, "--help"]) == 0
    told = capsys.readouterr().out
    assert "Usage: microrelief " + name in told
    example = told.partition("\nExample")[2]
    assert f"microrelief {name}" in example


def test_version(capsys: Capture) -> None:
    assert run_tokens(["--version"]) == 0
    assert capsys.readouterr().out.strip() == "0.1.0"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["rnu"], "microrelief: no command 'rnu', did you mean 'run'?"),
        (["xyzzy"], "microrelief: no command 'xyzzy'; `microrelief --help` lists them"),
        (["--bogus"], "microrelief: unknown option --bogus; see `microrelief --help`"),
        (["run"], "microrelief: CAMPAIGN is missing; see `microrelief run --help`"),
        (["run", "a.yaml", "b.yaml"], "microrelief: too many arguments: b.yaml; see `microrelief run --help`"),
        (["run", "a.yaml", "--dry"], "microrelief: Unknown option: --dry. Did you mean --dry-run?"),
        (["run", "a.yaml", "--max-scans", "many"], "microrelief: Invalid value for --max-scans"),
        (["run", "a.yaml", "--max-scans", "0"], "microrelief: --max-scans must be at least 1, not 0"),
        (["run", "none.yaml"], "microrelief: none.yaml: no such campaign file; `microrelief init DIR`"),
        (["video", "none.yaml", "--for"], "microrelief: "),
        (["status", "none.yaml"], "microrelief: none.yaml: no such campaign file"),
    ],
)
def test_a_wrong_command_line_gives_one_line_and_exit_2(words: list[str], expected: str, capsys: Capture) -> None:
    assert run_tokens(words) == 2
    told = capsys.readouterr()
    assert told.err.startswith(expected)
    assert len(told.err.splitlines()) == 1
    assert told.out == ""


def test_debug_lets_the_error_pass_wherever_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    for words in (["--debug", "run", "none.yaml"], ["run", "none.yaml", "--debug"], ["run", "--debug", "none.yaml"]):
        monkeypatch.setattr(sys, "argv", ["microrelief", *words])
        with pytest.raises(ValueError, match="no such campaign file"):
            main()


def test_a_mistake_in_a_campaign_is_told_with_its_place(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "site.yaml"
    file.write_text("site:\n  name: x\nschedule:\n  evry: 6 h\n", encoding="utf-8")
    assert run_tokens(["run", str(file)]) == 2
    assert f"{file}:4:3: schedule.evry: unknown key, did you mean 'every'?" in capsys.readouterr().err.splitlines()


def test_help_starts_fast() -> None:
    """0.25 s of CPU on the reference machine: pydantic, numba and zarr must not be loaded for it."""
    code = (
        "import sys, monitor.cli; monitor.cli.run_tokens(['--help']); "
        "heavy = {'pydantic', 'numba', 'zarr', 'xarray', 'pandas', 'scipy', 'cv2'} & set(sys.modules); "
        "assert not heavy, heavy"
    )
    before = os.times()
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
    after = os.times()
    assert after.children_user + after.children_system - before.children_user - before.children_system < 1.5


def test_a_closed_pipe_is_no_error() -> None:
    code = "import sys; sys.argv = ['microrelief', 'schema']; from monitor.cli import main; main()"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    error = process.stderr.read().decode()
    process.stderr.close()
    assert process.wait(timeout=60) == 0, error
    assert error == ""


def test_a_missing_system_library_names_its_package() -> None:
    from monitor.system_libraries import missing_library

    error = ImportError("libGL.so.1: cannot open shared object file: No such file or directory")
    assert missing_library(error) == "the system library libGL.so.1 is not there: `apt-get install libgl1`"
    assert "pip install" in missing_library(ModuleNotFoundError("No module named 'zarr'", name="zarr"))


def test_init_writes_a_campaign_that_dry_runs_and_overwrites_nothing(tmp_path: Path, capsys: Capture) -> None:
    folder = tmp_path / "plot7"
    assert run_tokens(["init", str(folder)]) == 0
    text = (folder / "campaign.yaml").read_text(encoding="utf-8")
    assert text.count("#") > 10
    assert "plot7.icechunk" in text
    assert run_tokens(["run", str(folder / "campaign.yaml"), "--dry-run"]) == 0
    capsys.readouterr()
    assert run_tokens(["init", str(folder)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert (folder / "campaign.yaml").read_text(encoding="utf-8") == text


def test_init_says_so_where_it_cannot_write(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert run_tokens(["init", str(tmp_path / "file")]) == 2
    assert "is no folder" in capsys.readouterr().err


def test_doctor_looks_at_machine_and_campaign(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "soil.yaml"
    text = files("configs").joinpath("video.yaml").read_text(encoding="utf-8")
    file.write_text(text, encoding="utf-8")
    assert run_tokens(["doctor", str(file)]) == 0
    told = capsys.readouterr().out
    for what in ("packages: configs, pipelines", "icechunk: ", "rerun-sdk: ", "disk here", "clock: ", "rig: simulated"):
        assert f"ok       {what}" in told
    file.write_text(text.replace("simulated: true", "file: nowhere.json"), encoding="utf-8")
    assert run_tokens(["doctor", str(file)]) == 1
    told = capsys.readouterr().out
    assert "WRONG    calibration: " in told
    assert "-> `microrelief calibrate POSE_DIR" in told


def run_hours(folder: Path, visits: int, at_h: float = 0) -> None:
    clock = AcceleratedClock(T0 + np.timedelta64(round(at_h * 3600), "s"))
    run_campaign(campaign_in(folder), clock=clock, rig=Rig(), max_scans=visits, work=work)


def test_status_of_a_store(tmp_path: Path, capsys: Capture) -> None:
    run_hours(tmp_path, 3)
    assert run_tokens(["status", str(tmp_path / "site.icechunk"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["scans"] == 3
    assert told["last"] == "2026-01-01T02:00:00Z"
    assert told["missed"] == 0
    assert told["state"] == "ok"
    assert not told["running"]
    assert run_tokens(["status", str(tmp_path / "site.icechunk")]) == 0
    assert "scans    3, 0 missed" in capsys.readouterr().out


def test_status_is_degraded_after_missed_slots_and_overdue_ones(tmp_path: Path) -> None:
    run_hours(tmp_path, 1)
    run_hours(tmp_path, 1, at_h=3.5)
    campaign = campaign_in(tmp_path)
    standing = look(campaign.store.path, T0 + np.timedelta64(4 * 3600 + 60, "s"), campaign)
    assert (standing.state, standing.exit_code, standing.missed) == ("degraded", 4, 3)
    assert standing.next == T0 + np.timedelta64(5, "h")


def test_status_tells_a_pulled_plug_from_an_ended_run(tmp_path: Path) -> None:
    run_hours(tmp_path, 2)
    campaign = campaign_in(tmp_path)
    later = T0 + np.timedelta64(5 * 3600 + 1800, "s")
    assert look(campaign.store.path, later, campaign).overdue == 0, "it was ended on purpose"
    from monitor.loop import BEGAN
    from pipelines import Event, Tick
    from storage import open_store

    store = open_store(campaign.store.path, write=True)
    store.append(Tick(later, events=(Event(later, "note", f"{BEGAN}: and the plug was pulled"),)))
    store.close()
    standing = look(campaign.store.path, later, campaign)
    assert (standing.overdue, standing.state) == (4, "degraded")


def test_status_says_whether_somebody_runs_it(tmp_path: Path) -> None:
    from storage import open_store

    run_hours(tmp_path, 1)
    path = tmp_path / "site.icechunk"
    writer = open_store(path, write=True)
    assert look(path, T0).running
    writer.close()
    assert not look(path, T0).running


def test_status_of_what_is_no_store(tmp_path: Path, capsys: Capture) -> None:
    assert run_tokens(["status", str(tmp_path)]) == 1
    assert run_tokens(["status", str(tmp_path / "nothing.icechunk")]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 2

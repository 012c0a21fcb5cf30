"""As a service: the unit file is systemd's, the watchdog hears from the loop, the log is JSON and rotates."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import structlog

import monitor.log
from monitor.campaign import run_campaign
from monitor.cli import run_tokens
from monitor.clock import AcceleratedClock
from monitor.log import set_up_log
from monitor.watchdog import Watchdog, tell_systemd
from pipelines import instant

from .campaigns import BASE, Rig, campaign_in, work

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    shutil.copy(ROOT / "configs" / "soil.yaml", tmp_path / "soil.yaml")
    assert run_tokens(["service", str(tmp_path / "soil.yaml"), "--user", "rig", "--status-port", "8123"]) == 0
    return capsys.readouterr().out


def test_the_unit_runs_this_program_on_this_campaign(unit: str, tmp_path: Path) -> None:
    assert f"run {tmp_path}/soil.yaml --status-port 8123" in unit
    assert f"ReadWritePaths={tmp_path}" in unit
    for line in ("Type=notify", "WatchdogSec=15min", "User=rig", "NoNewPrivileges=yes", "ProtectSystem=strict"):
        assert line in unit.splitlines()


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze: apt-get install systemd")
def test_systemd_takes_the_unit(unit: str, tmp_path: Path) -> None:
    file = tmp_path / "microrelief-soil.service"
    file.write_text(unit)
    found = subprocess.run(["systemd-analyze", "verify", str(file)], capture_output=True, text=True, timeout=60)
    said = [line for line in found.stderr.splitlines() if "microrelief-soil" in line and "not executable" not in line]
    assert said == []


def test_a_path_that_a_unit_cannot_hold_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "my site").mkdir()
    shutil.copy(ROOT / "configs" / "soil.yaml", tmp_path / "my site" / "soil.yaml")
    assert run_tokens(["service", str(tmp_path / "my site" / "soil.yaml")]) == 2
    assert "no path with blanks" in capsys.readouterr().err


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """What systemd listens with."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        yield listening


def heard(manager: socket.socket) -> list[str]:
    found = []
    while True:
        try:
            found.append(manager.recv(4096).decode())
        except BlockingIOError:
            return found


def test_the_watchdog_hears_of_each_slot_and_of_the_end(manager: socket.socket, tmp_path: Path) -> None:
    clock = AcceleratedClock(instant(BASE))
    run_campaign(campaign_in(tmp_path), clock=clock, rig=Rig(), companions=[Watchdog()], max_scans=2, work=work)
    assert heard(manager) == [
        "READY=1",
        "WATCHDOG=1\nSTATUS=scan 0 taken",
        "WATCHDOG=1\nSTATUS=scan 1 taken",
        "STOPPING=1",
    ]


def test_without_systemd_nobody_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert not tell_systemd("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", "/nowhere/at/all")
    assert not tell_systemd("READY=1")


def test_the_log_is_json_where_asked_and_the_file_rotates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(monitor.log, "FILE_BYTES", 600)
    file = tmp_path / "logs" / "run.jsonl"
    set_up_log(form="json", file=file)
    log = structlog.get_logger("microrelief.test")
    for number in range(20):
        log.warning("store", number=number, error='disk "full"\nagain')
    log.info("a notice")
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert [line["number"] for line in lines] == list(range(20)), "notices go to the file alone"
    assert lines[0]["level"] == "warning"
    assert lines[0]["logger"] == "microrelief.test"
    assert lines[0]["error"] == 'disk "full"\nagain'
    files = sorted(tmp_path.glob("logs/*"))
    assert len(files) == 1 + monitor.log.FILES_KEPT
    kept = [json.loads(line) for each in files for line in each.read_text().splitlines()]
    assert kept
    assert json.loads(file.read_text().splitlines()[-1])["event"] == "a notice"

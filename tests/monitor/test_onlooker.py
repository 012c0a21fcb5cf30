"""A review that goes along: begun with the first durable scan, ended with the run, and missed by nobody if it ends."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from monitor.onlooker import OURSELVES, Onlooker
from monitor.settled import Settled

from .stand_ins import after

TAKEN = Settled(after(0), "taken", number=0, began=after(0))


def started(monkeypatch: pytest.MonkeyPatch) -> list[subprocess.Popen[bytes]]:
    """Every process that is started from now on."""
    made: list[subprocess.Popen[bytes]] = []
    start = subprocess.Popen

    def remember(*args: object, **options: object) -> subprocess.Popen[bytes]:
        made.append(start(*args, **options))  # type: ignore[call-overload]  # passed on
        return made[-1]

    monkeypatch.setattr(subprocess, "Popen", remember)
    return made


def test_it_begins_with_the_first_scan_and_ends_with_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    sleeps = (sys.executable, "-c", "import signal; signal.pause()")
    made = started(monkeypatch)
    onlooker = Onlooker("site.icechunk", ["--web", "--port", "9123"], sleeps)
    onlooker.settled(Settled(after(0), "failed", "too dark", began=after(0)))
    assert not made
    onlooker.settled(TAKEN)
    onlooker.settled(TAKEN)
    (process,) = made
    told = process.args
    assert isinstance(told, list)
    assert told[-6:] == ["review", "site.icechunk", "--follow", "--web", "--port", "9123"]
    assert process.poll() is None
    onlooker.close()
    assert process.poll() is not None
    onlooker.close()


def test_one_that_ended_by_itself_is_logged_once_and_the_run_goes_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    made = started(monkeypatch)
    onlooker = Onlooker("site.icechunk", (), (sys.executable, "-c", "raise SystemExit(3)"))
    onlooker.settled(TAKEN)
    made[0].wait()
    for _ in range(3):
        assert onlooker.settled(TAKEN) == ()
    onlooker.close()
    told = capsys.readouterr()
    assert (told.out + told.err + caplog.text).count("the live review ended") == 1


def test_it_is_our_own_command_whatever_lies_in_the_current_folder(tmp_path: Path) -> None:
    (tmp_path / "monitor").mkdir()
    (tmp_path / "monitor" / "__init__.py").write_text("raise SystemExit('not us')", encoding="utf-8")
    done = subprocess.run([*OURSELVES, "review", "--help"], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert "review" in done.stdout

"""A trace of the system calls: all that a commit wrote is on the disk before the scan is acknowledged."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CALLS = "openat,creat,rename,renameat,renameat2,link,linkat,write,pwrite64,writev,fsync,fdatasync,syncfs"
NOT_KEPT = ("writer.lock", "ledger.sqlite-shm", "ledger.sqlite-journal", "health.sqlite-shm", "health.sqlite-journal")
"""A label for people; an index and a journal that SQLite makes anew."""


@dataclass(frozen=True)
class Call:
    """One system call: when it began and ended, in lines of the trace."""

    name: str
    text: str
    began: int
    ended: int


def calls_of(trace: str) -> list[Call]:
    """Read a trace of several threads, in which a call may end lines after it began."""
    calls, open_calls = [], {}
    for number, line in enumerate(trace.splitlines()):
        thread, _, text = line.partition(" ")
        text = text.strip()
        if text.endswith("<unfinished ...>"):
            open_calls[thread] = (number, text.removesuffix("<unfinished ...>"))
            continue
        began = number
        if resumed := re.match(r"<\.\.\. \w+ resumed>", text):
            began, head = open_calls.pop(thread)
            text = head + text[resumed.end() :]
        if match := re.match(r"(\w+)\(", text):
            calls.append(Call(match[1], text, began, number))
    return calls


def succeeded(call: Call) -> bool:
    return re.search(r"\) += (\d+)", call.text) is not None


def written(call: Call, folder: Path) -> list[str]:
    """Give the files in `folder` that a call changes or names."""
    if not succeeded(call):
        return []
    if call.name in ("write", "pwrite64", "writev"):
        found = re.findall(rf"^\w+\(\d+<({folder}/[^>]*)>", call.text)
    elif call.name in ("openat", "creat"):
        found = re.findall(rf'"({folder}/[^"]*)"', call.text) if "O_CREAT" in call.text else []
    elif call.name in ("rename", "renameat", "renameat2", "link", "linkat"):
        found = re.findall(rf'"({folder}/[^"]*)"', call.text)[-1:]
    else:
        found = []
    found = [re.sub(r"#\d+$", "", path) for path in found]  # Icechunk writes beside and renames: one file, one inode
    return [path for path in found if not path.endswith(NOT_KEPT)]


@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed: no trace of the system calls")
def test_every_file_of_a_commit_is_synced_before_the_scan_is_acknowledged(tmp_path: Path) -> None:
    folder, trace = tmp_path / "site", tmp_path / "trace"
    folder.mkdir()
    command = [sys.executable, "-m", "tests.monitor.campaigns", str(folder), "--hours", "2"]
    done = subprocess.run(
        ["strace", "-f", "-y", "-qq", "-s", "400", "-e", f"trace={CALLS}", "-o", str(trace), *command],
        cwd=ROOT,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    if "PTRACE" in done.stderr or "Operation not permitted" in done.stderr:
        pytest.skip("processes may not be traced here")
    assert done.returncode == 0, done.stderr
    calls = calls_of(trace.read_text(errors="replace"))
    said = [call for call in calls if call.name == "write" and "committed scan" in call.text]
    assert len(said) == 3
    syncs = [call for call in calls if call.name in ("fsync", "fdatasync", "syncfs") and succeeded(call)]
    checked = 0
    for number, spoken in enumerate(said):
        since = said[number - 1].ended if number else 0
        for call in calls:
            if not since < call.began < spoken.began:
                continue
            for path in written(call, folder):
                if path.endswith("/calibration.json"):  # the test's own
                    continue
                assert any(
                    call.ended < sync.began
                    and sync.ended < spoken.began
                    and (sync.name == "syncfs" or f"<{path}>" in sync.text)
                    for sync in syncs
                ), f"{path} was not synced before scan {number} was acknowledged: {call.text}"
                checked += 1
    references = [sync for sync in syncs if "ref.json>" in sync.text]
    assert len(references) >= 3, "the reference is synced by itself, after all that it names"
    print(f"\n{len(said)} commits, {checked} writes, all synced before their scan was acknowledged")
    assert checked > 100

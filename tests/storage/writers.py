"""Writers that are born quickly and die at once: forked from a process that has imported everything, killed with -9."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

import numpy as np

from storage import open_store

from .ticks import surface

ROOT = Path(__file__).resolve().parents[2]

NURSERY = """
import json, os, sys, time, traceback
import botocore.session, icechunk, xarray, zarr  # once, before the writers part
import storage.bucket, storage.icechunk_store
from storage import open_store
from tests.storage.ticks import tick

def say(text):
    os.write(1, (text + chr(10)).encode())

def write(url, pace_s):
    store = open_store(url, write=True)
    number = len(store)
    say(f"open {number}")
    due = time.monotonic()
    while True:
        say(f"stored {store.append(tick(number)) + 1}")
        number, due = number + 1, due + pace_s
        time.sleep(max(0.0, due - time.monotonic()))

for line in sys.stdin:
    asked = json.loads(line)
    child = os.fork()
    if child == 0:
        try:
            os.environ.update(asked["environment"])
            write(asked["url"], asked["pace_s"])
        except BaseException:
            traceback.print_exc()
        os._exit(1)
    say(f"pid {child}")
    os.waitpid(child, 0)
    say("gone")
"""


class Writer:
    """A process that appends; `stored` is how many scans it has said are stored."""

    def __init__(self, nursery: subprocess.Popen[str]) -> None:
        assert nursery.stdout is not None
        self._lines = nursery.stdout
        self.pid, self.stored = 0, 0
        self._open, self._begun = Event(), Event()
        self._thread = Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        for line in self._lines:
            word, _, value = line.strip().partition(" ")
            if word == "pid":
                self.pid = int(value)
            elif word in ("open", "stored"):
                self.stored = int(value)
                (self._open if word == "open" else self._begun).set()
            elif word == "gone":
                break
        self._open.set()
        self._begun.set()

    def wait_until_open(self) -> None:
        """Return once it has opened the store."""
        assert self._open.wait(120)
        assert self._thread.is_alive(), "the writer ended by itself"

    def wait(self) -> None:
        """Return once it has stored something."""
        assert self._begun.wait(120)
        assert self._thread.is_alive(), "the writer ended by itself"

    def kill(self) -> None:
        """Kill it with -9, and hear its last words."""
        if self._thread.is_alive():
            os.kill(self.pid, signal.SIGKILL)
        self._thread.join()


class Nursery:
    """Lets writers be born, one at a time."""

    def __init__(self) -> None:
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        self._process = subprocess.Popen(
            [sys.executable, "-c", NURSERY],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env=environment,
        )

    @contextmanager
    def writing(self, url: str | Path, pace_s: float = 0.0) -> Iterator[Writer]:
        """Start a writer that appends every `pace_s`, or as fast as it can; it is killed at the block's end."""
        environment = {name: value for name, value in os.environ.items() if name.startswith(("AWS_", "NO_PROXY"))}
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"url": str(url), "pace_s": pace_s, "environment": environment}) + "\n")
        self._process.stdin.flush()
        writer = Writer(self._process)
        try:
            writer.wait_until_open()
            yield writer
        finally:
            writer.kill()

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def kill_at_random(nursery: Nursery, url: str | Path, kills: int, seed: int, longest_s: float) -> tuple[int, int]:
    """Let a writer append and kill it, `kills` times; give the scans acknowledged in all and those found."""
    moments = random.Random(seed)
    acknowledged = 0
    for number in range(1, kills + 1):
        with nursery.writing(url) as writer:
            time.sleep(moments.uniform(0.0, longest_s))  # a moment of the writer's life: nothing here is waited for
        acknowledged = writer.stored
        found = len(open_store(url))
        assert found >= acknowledged, "an acknowledged scan is lost"
        assert found <= acknowledged + 1, "more than the one scan under way is there"
        if number % 20 == 0:
            print(f"{number} kills: {acknowledged} scans acknowledged, {found} found", flush=True)
    return acknowledged, len(open_store(url))


def check_whole(url: str | Path) -> None:
    """Every scan is there, and is what was written."""
    store = open_store(url)
    times = store.window()["time"].values
    assert (np.diff(times.astype(np.int64)) > 0).all()
    assert list(store.series()["scan"]) == list(range(len(store)))
    for number in range(len(store)):
        stored = store[number]
        assert stored.scan.time == surface(number).time
        np.testing.assert_array_equal(stored.scan.texture, surface(number).texture)
        assert (stored.change is None) == (number == 0)

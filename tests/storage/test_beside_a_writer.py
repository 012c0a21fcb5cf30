"""While a writer writes, for real: readers in processes of their own, and copies of the live store, see whole scans."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from storage import create_store, open_store

from .. import s3_servers
from .ticks import GRID, METRICS, tick
from .writers import ROOT, Nursery, check_whole

READERS = 10

READ = """
import multiprocessing, sys, time
import numpy as np
import icechunk, xarray, zarr, pandas  # once, before the readers part
import storage.icechunk_store, storage.view
from storage import open_store
from tests.storage.ticks import surface

def check(stored, number):
    truth = surface(number)
    assert stored.number == number and stored.scan.time == truth.time
    assert np.array_equal(stored.scan.texture, truth.texture), "a torn texture"
    assert np.allclose(stored.scan.height, truth.height, rtol=0, atol=2.6e-4, equal_nan=True), "a torn height"
    assert (stored.change is None) == (number == 0)

def read(url, seconds, seed, results):
    rng, opened, newest, until = np.random.default_rng(seed), 0, 0, time.monotonic() + seconds
    try:
        while time.monotonic() < until:
            store = open_store(url)
            count = len(store)
            assert count >= newest, "the store went back"
            assert not [event for event in store.events if event.kind == "lost"], "a snapshot that was not whole"
            assert len(store.series()) == store.window().sizes["time"] == count
            check(store[count - 1], count - 1)
            number = int(rng.integers(count))
            check(store[number], number)
            opened, newest = opened + 1, count
            time.sleep(2.0)  # as ten who look on do; without rest they would leave a writer on two cores no time
        results.put((opened, newest, ""))
    except BaseException as error:
        results.put((opened, newest, f"{type(error).__name__}: {error}"))

if __name__ == "__main__":
    url, seconds, readers = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
    context = multiprocessing.get_context("fork")
    results = context.Queue()
    processes = [context.Process(target=read, args=(url, seconds, seed, results)) for seed in range(readers)]
    for process in processes:
        process.start()
    for _ in processes:
        print(*results.get(), flush=True)
    for process in processes:
        process.join()
"""


def _made(url: str | Path) -> None:
    store = create_store(url, site="x", grid=GRID, metrics=METRICS)
    store.append(tick(0))
    store.close()


def _read_beside(nursery: Nursery, url: str | Path, seconds: float) -> None:
    _made(url)
    with nursery.writing(url, pace_s=0.2) as writer:
        done = subprocess.run(
            [sys.executable, "-c", READ, str(url), str(seconds), str(READERS)],
            capture_output=True,
            text=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        assert done.returncode == 0, done.stderr
        written = writer.stored - 1
        assert written > 0, "nothing was written meanwhile"
    readers = [line.split(maxsplit=2) for line in done.stdout.splitlines()]
    assert len(readers) == READERS
    assert [words[2] for words in readers if len(words) > 2] == []
    assert all(int(words[0]) > 0 for words in readers)
    opened = sum(int(words[0]) for words in readers)
    print(f"{READERS} readers opened {opened} times in {seconds:g} s while {written} scans were written")
    check_whole(url)


def test_ten_readers_see_whole_scans_only(tmp_path: Path, nursery: Nursery) -> None:
    _read_beside(nursery, tmp_path / "s", 4.0)


@pytest.mark.soak
def test_ten_readers_for_a_minute(tmp_path: Path, nursery: Nursery) -> None:
    _read_beside(nursery, tmp_path / "s", 60.0)


@pytest.mark.soak
def test_ten_readers_for_a_minute_on_s3(s3_prefix: str, nursery: Nursery) -> None:
    _read_beside(nursery, s3_prefix, 60.0)


def _copy(source: Path, target: Path) -> None:
    """Copy file by file, as people do; a temporary file that is renamed meanwhile is no loss."""

    def one(file: str, to: str) -> None:
        try:
            shutil.copyfile(file, to)
        except FileNotFoundError:
            assert Path(file).suffix != "" or "#" in file, file

    shutil.copytree(source, target, copy_function=one)


def _copy_live(nursery: Nursery, folder: Path, copies: int) -> int:
    """Copy a store in mid-write, and open each copy; give how many opened at an older snapshot than the newest."""
    behind = 0
    with nursery.writing(folder) as writer:
        writer.wait()
        for number in range(copies):
            before = writer.stored
            target = folder.with_name(f"copy-{number}")
            _copy(folder, target)
            copy = open_store(target)
            assert len(copy) >= before, "what was acknowledged before the copy began is in it"
            behind += bool([event for event in copy.events if event.kind == "lost"])
            again = open_store(target, write=True)
            assert again.append(tick(len(copy))) == len(copy), "a copy can be gone on with"
            again.close()
            if number in (0, copies - 1):
                check_whole(target)
            shutil.rmtree(target)
            if number % 10 == 9:
                print(f"{number + 1} copies, the last of {len(again)} scans: all open", flush=True)
    return behind


def test_a_copy_taken_in_mid_write_opens(tmp_path: Path, nursery: Nursery) -> None:
    _made(tmp_path / "s.icechunk")
    _copy_live(nursery, tmp_path / "s.icechunk", copies=3)


@pytest.mark.soak
def test_fifty_copies_taken_in_mid_write_open(tmp_path: Path, nursery: Nursery) -> None:
    behind = 0
    for store in range(5):  # a new one each: a writer at full speed writes a thousand scans during twenty copies
        _made(tmp_path / f"{store}" / "s.icechunk")
        behind += _copy_live(nursery, tmp_path / f"{store}" / "s.icechunk", copies=10)
    print(f"50 copies of a live folder: all open; {behind} of them at an older snapshot than their newest")


def _copy_live_bucket(nursery: Nursery, url: str, copies: int) -> int:
    client = s3_servers.client(os.environ["AWS_ENDPOINT_URL"])
    prefix = url.removeprefix(f"s3://{s3_servers.BUCKET}/")
    behind = 0
    with nursery.writing(url) as writer:
        writer.wait()
        for number in range(copies):
            before = writer.stored
            pages = client.get_paginator("list_objects_v2").paginate(Bucket=s3_servers.BUCKET, Prefix=f"{prefix}/")
            for key in [item["Key"] for page in pages for item in page["Contents"]]:
                source = {"Bucket": s3_servers.BUCKET, "Key": key}
                target = f"{prefix}-{number}{key.removeprefix(prefix)}"
                client.copy_object(Bucket=s3_servers.BUCKET, Key=target, CopySource=source)
            copy = open_store(f"{url}-{number}")
            assert len(copy) >= before, "what was acknowledged before the copy began is in it"
            behind += bool([event for event in copy.events if event.kind == "lost"])
            if number in (0, copies - 1):
                check_whole(f"{url}-{number}")
    return behind


def test_a_copy_of_a_live_bucket_opens(s3_prefix: str, nursery: Nursery) -> None:
    _made(s3_prefix)
    _copy_live_bucket(nursery, s3_prefix, copies=1)


@pytest.mark.soak
def test_fifty_copies_of_a_live_bucket_open(s3_prefix: str, nursery: Nursery) -> None:
    behind = 0
    for store in range(25):  # a new one every other time: to copy a hundred scans takes a server a minute
        _made(f"{s3_prefix}-{store}")
        behind += _copy_live_bucket(nursery, f"{s3_prefix}-{store}", copies=2)
        print(f"{2 * (store + 1)} copies: all open, {behind} at an older snapshot than their newest", flush=True)

"""What a store on S3 promises beyond the contract: one writer, no half, clear refusals. The servers are not ours."""

from __future__ import annotations

import os
import pickle
from datetime import UTC, datetime
from itertools import product
from pathlib import Path
from typing import Any

import icechunk
import numpy as np
import pytest

from configs import StoreError
from storage import (
    Store,
    cite,
    collect,
    copy_store,
    create_store,
    expire,
    open_store,
    snapshots,
    statistics,
    store_exists,
    verify,
    writer_of,
)
from storage import lease as lease_module
from storage.bucket import Bucket

from .. import s3_servers
from .ticks import GRID, METRICS, START, failure, surface, tick
from .writers import Nursery, check_whole, kill_at_random


def _made(url: str, scans: int = 0) -> Store:
    store = create_store(url, site="x", grid=GRID, metrics=METRICS)
    for number in range(scans):
        store.append(tick(number))
    return store


def _objects(url: str) -> tuple[Any, dict[str, int]]:
    """A plain client, and the sizes of a store's objects by key."""
    prefix = url.removeprefix(f"s3://{s3_servers.BUCKET}/")
    client = s3_servers.client(os.environ["AWS_ENDPOINT_URL"])
    pages = client.get_paginator("list_objects_v2").paginate(Bucket=s3_servers.BUCKET, Prefix=prefix)
    return client, {item["Key"]: item["Size"] for page in pages for item in page.get("Contents", ())}


def test_the_same_store_at_a_url(s3_prefix: str) -> None:
    url = f"{s3_prefix}/site.icechunk"
    assert not store_exists(url)
    store = _made(url, 2)
    assert writer_of(url) is not None
    store.close()
    assert store_exists(url)
    assert writer_of(url) is None
    reader = open_store(url)
    assert (len(reader), reader.about.location) == (2, url)
    np.testing.assert_array_equal(reader[1].scan.texture, surface(1).texture)
    assert len(open_store(Path(url))) == 2, "a Path folds the two slashes into one"
    with pytest.raises(StoreError, match="exists already"):
        _made(url)
    _, objects = _objects(url)
    format_1 = {"chunks", "config.yaml", "manifests", "refs", "snapshots", "transactions"}
    assert {key.split(".icechunk/")[-1].split("/")[0] for key in objects if ".lock" not in key} <= format_1
    assert [key for key in objects if "probe" in key] == []


def test_care_of_a_store_at_a_url(s3_prefix: str, tmp_path: Path) -> None:
    url = f"{s3_prefix}/site.icechunk"
    writer = _made(url)
    assert writer.append_all([tick(0), tick(1)]) == (0, 1)
    with pytest.raises(StoreError, match=r"written by|writes|holds"):
        expire(url, datetime.now(UTC))
    for number in (2, 3, 4):
        writer.append(failure(number))
    writer.close()
    told = statistics(url, START)
    assert (told.scans, told.free, told.disk_full) == (2, None, None)
    assert told.bytes > 0
    first = list(snapshots(url))[-1].id
    cite(url, first)
    assert expire(url, datetime.now(UTC)) > 0
    collect(url, datetime.now(UTC))
    assert not verify(url).damaged
    assert len(open_store(url, snapshot=first)) == 0, "what a report cites is kept"
    assert copy_store(url, tmp_path / "copy") == 2
    np.testing.assert_array_equal(open_store(tmp_path / "copy")[1].scan.texture, surface(1).texture)
    assert copy_store(url, tmp_path / "whole", history=True) == 2
    assert len(open_store(tmp_path / "whole", snapshot=first)) == 0
    back = f"{s3_prefix}/back"
    assert copy_store(tmp_path / "copy", back) == 2
    np.testing.assert_array_equal(open_store(back)[1].scan.texture, surface(1).texture)
    for copied in (tmp_path / "whole", back):
        assert not verify(copied).damaged
    with pytest.raises(StoreError, match="exists already"):
        copy_store(tmp_path / "copy", back)
    with pytest.raises(StoreError, match="a copy with its history goes to a folder"):
        copy_store(url, f"{s3_prefix}/other", history=True)


def test_credentials_are_in_no_object_and_no_pickle(s3_prefix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "hush-hush")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "AKIAHUSH")
    store = _made(s3_prefix, 1)
    client, objects = _objects(s3_prefix)
    for key in objects:
        assert b"hush" not in client.get_object(Bucket=s3_servers.BUCKET, Key=key)["Body"].read().lower()
    session = store.session  # type: ignore[attr-defined]  # Icechunk's
    pickled = pickle.dumps(session)
    assert b"hush" not in pickled.lower()
    assert "hush" not in (repr(store) + str(store.about)).lower()
    store.close()


def test_one_writer_named_to_the_next(s3_prefix: str) -> None:
    first = _made(s3_prefix)
    with pytest.raises(StoreError, match=rf"another writer holds this store \(pid {os.getpid()} on "):
        open_store(s3_prefix, write=True)
    first.append(tick(0))
    first.close()
    second = open_store(s3_prefix, write=True)
    assert second.append(tick(1)) == 1
    assert [event.kind for event in second.events] == ["epoch"], "the first let go: nothing to note"
    second.close()


def test_a_writer_that_was_asleep_is_refused_and_mixes_nothing(s3_prefix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lease_module, "BEAT_S", 1e6)  # its thread sleeps too, however slow this machine is
    asleep = _made(s3_prefix, 1)
    monkeypatch.setattr(lease_module, "_alive", lambda record: None)
    monkeypatch.setattr(lease_module, "LEASE_S", 0.0)
    monkeypatch.setattr(lease_module, "LOOK_S", 0.01)
    other = open_store(s3_prefix, write=True)
    assert [event.text for event in other.events if "taken over" in event.text]
    with pytest.raises(StoreError, match="another writer wrote here meanwhile"):
        asleep.append(tick(1))
    other.append(tick(1))
    asleep._lock.beat()  # type: ignore[attr-defined]  # what its thread does every few seconds
    with pytest.raises(StoreError, match="another took over"):
        asleep.append(tick(2))
    asleep.close()
    assert other.append(tick(2)) == 2
    other.close()
    check_whole(s3_prefix)


def test_of_two_commits_at_one_moment_one_fails_cleanly(s3_prefix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Past every lease: Icechunk's own conditional write decides."""
    first = _made(s3_prefix, 1)
    second = _without_lease(s3_prefix)
    real = Bucket.publish

    def late(self: Bucket, repository: Any, session: Any, message: str, metadata: dict[str, Any]) -> str:
        monkeypatch.setattr(Bucket, "publish", real)
        assert first.append(tick(1)) == 1
        return real(self, repository, session, message, metadata)

    monkeypatch.setattr(Bucket, "publish", late)
    with pytest.raises(StoreError, match="another writer wrote here meanwhile"):
        second.append(tick(1))
    first.append(tick(2))
    first.close()
    check_whole(s3_prefix)


def _without_lease(url: str) -> Store:
    from storage.icechunk_store import IcechunkStore
    from storage.location import location_of

    class Free:
        taken_from = ""

        def check(self) -> None:
            pass

        def release(self) -> None:
            pass

    return IcechunkStore(location_of(url), Free())


def test_a_commit_whose_answer_was_lost_counts(s3_prefix: str) -> None:
    store = _made(s3_prefix, 1)

    class Deaf:
        def __init__(self, session: Any) -> None:
            self._session = session

        def commit(self, message: str, metadata: dict[str, Any]) -> str:
            self._session.commit(message, metadata=metadata)
            raise icechunk.ConflictError("before", "after")  # a second try of the same write met the first

    location, repository = store._location, store._repository  # type: ignore[attr-defined]  # the parts of the store
    session = repository.writable_session("main")
    import zarr

    zarr.open_group(session.store).attrs["x"] = 1
    assert location.publish(repository, Deaf(session), "x", {}) == repository.lookup_branch("main")
    store.close()


def test_opens_at_the_newest_whole_snapshot_and_says_what_was_lost(s3_prefix: str) -> None:
    """A hand in the bucket, or a rule of it that deletes: S3 itself keeps what it took."""
    store = _made(s3_prefix, 2)
    count = 2
    for kind, gone in product(("snapshots", "manifests"), (False, True)):
        client, before = _objects(s3_prefix)
        store.append(tick(count))
        store.close()
        newer = [key for key in _objects(s3_prefix)[1] if key not in before and f"/{kind}/" in key]
        for key in newer:
            if gone:
                client.delete_object(Bucket=s3_servers.BUCKET, Key=key)
            else:
                client.put_object(Bucket=s3_servers.BUCKET, Key=key, Body=b"")
        reader = open_store(s3_prefix)
        assert len(reader) == count, (kind, gone)
        assert reader.events[-1].kind == "lost", (kind, gone)
        store = open_store(s3_prefix, write=True)
        assert store.append(tick(count)) == count
        count += 1
    store.close()
    assert [event.kind for event in open_store(s3_prefix).events].count("lost") == 4
    check_whole(s3_prefix)


def test_what_a_killed_maker_left_is_no_store_and_is_finished_by_the_next(s3_prefix: str) -> None:
    icechunk.Repository.create(Bucket(*s3_prefix.removeprefix("s3://").split("/")).storage())
    assert not store_exists(s3_prefix)
    with pytest.raises(StoreError, match="no store yet: whoever made it did not finish"):
        open_store(s3_prefix)
    store = _made(s3_prefix, 1)
    store.close()
    assert len(open_store(s3_prefix)) == 1


@pytest.mark.parametrize(
    ("variables", "url", "message"),
    [
        ({}, "s3://no-such-bucket-here/site", "there is no bucket no-such-bucket-here: make it first"),
        ({}, f"s3://{s3_servers.BUCKET}/nothing", "no such store: check the URL"),
        ({"AWS_ENDPOINT_URL": "http://127.0.0.1:9"}, f"s3://{s3_servers.BUCKET}/x", "127.0.0.1:9 cannot be reached"),
        ({"AWS_ACCESS_KEY_ID": "", "AWS_SECRET_ACCESS_KEY": ""}, f"s3://{s3_servers.BUCKET}/x", "no credentials: set"),
        ({"AWS_PROFILE": "nobody"}, f"s3://{s3_servers.BUCKET}/x", "credentials for S3: .*nobody.*: check AWS_PROFILE"),
    ],
)
@pytest.mark.parametrize("write", [False, True])
def test_what_is_wrong_is_one_clear_line(
    s3_prefix: str, monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], url: str, message: str, write: bool
) -> None:
    for name, value in variables.items():
        if value:
            monkeypatch.setenv(name, value)
        else:
            monkeypatch.delenv(name)
    with pytest.raises(StoreError, match=message) as caught:
        open_store(url, write=write)
    assert "\n" not in str(caught.value)


def test_something_else_in_the_prefix_is_no_store(s3_prefix: str) -> None:
    client, _ = _objects(s3_prefix)
    key = s3_prefix.removeprefix(f"s3://{s3_servers.BUCKET}/")
    client.put_object(Bucket=s3_servers.BUCKET, Key=f"{key}/holiday.jpg", Body=b"x")
    with pytest.raises(StoreError, match="is no store: it has no snapshots"):
        open_store(s3_prefix, write=True)
    with pytest.raises(StoreError, match="exists already"):
        _made(s3_prefix)
    assert list(_objects(s3_prefix)[1]) == [f"{key}/holiday.jpg"], "nothing was left behind"


def test_a_server_that_ignores_conditional_writes_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with s3_servers.s3rver(tmp_path) as endpoint:
        for name, value in s3_servers.environment(endpoint, key="S3RVER").items():
            monkeypatch.setenv(name, value)
        client = s3_servers.client(endpoint, key="S3RVER")
        client.create_bucket(Bucket=s3_servers.BUCKET)
        with pytest.raises(StoreError, match=r"ignores conditional writes \(If-None-Match and If-Match") as caught:
            _made(f"s3://{s3_servers.BUCKET}/site")
        assert "\n" not in str(caught.value)
        assert "Contents" not in client.list_objects_v2(Bucket=s3_servers.BUCKET), "nothing was left behind"


def _killed_at_random(nursery: Nursery, url: str, kills: int, seed: int) -> tuple[int, int]:
    """Kill writers of a new store, while the server goes on; every scan is whole, and it can be gone on with."""
    _made(url, 1).close()
    acknowledged, found = kill_at_random(nursery, url, kills, seed, longest_s=1.0)
    check_whole(url)
    store = open_store(url, write=True)
    assert not [event for event in store.events if event.kind == "lost"]
    assert store.append(failure(found)) is None
    store.close()
    return acknowledged, found


def test_kill_9_loses_nothing_acknowledged(s3_prefix: str, nursery: Nursery) -> None:
    acknowledged, found = _killed_at_random(nursery, s3_prefix, kills=2, seed=20261122)
    assert found >= acknowledged >= 1


@pytest.mark.soak
def test_many_kills_lose_nothing_acknowledged(s3_prefix: str, nursery: Nursery) -> None:
    """On ten stores: each scan costs a bucket more objects, and this is about the moments."""
    acknowledged = found = 0
    for store in range(10):
        of_one = _killed_at_random(nursery, f"{s3_prefix}-{store}", kills=20, seed=store)
        acknowledged, found = acknowledged + of_one[0], found + of_one[1]
    print(f"200 kills on S3: {acknowledged} scans acknowledged, {found} found")

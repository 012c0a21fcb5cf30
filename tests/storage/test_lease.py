"""One writer on S3, held by a lease; bucket and clock are stand-ins, so that nothing waits."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from configs import StoreError
from storage import lease as module
from storage.lease import BEAT_S, LEASE_S, Lease, holder_in
from storage.objects import Found, PreconditionError


class FakeObjects:
    """One object with conditional writes, and a clock that moves when somebody waits."""

    def __init__(self) -> None:
        self.now = 0.0
        self.data: bytes | None = None
        self.version = 0
        self.written = 0.0
        self.tells_age = True
        self.meanwhile: Callable[[], None] = lambda: None

    def get(self, key: str) -> Found | None:
        if self.data is None:
            return None
        return Found(self.data, str(self.version), self.now - self.written if self.tells_age else 0.0)

    def put(self, key: str, data: bytes, *, replacing: str | None) -> str:
        if (replacing is None) != (self.data is None) or (replacing is not None and replacing != str(self.version)):
            raise PreconditionError(key)
        self.data, self.version, self.written = data, self.version + 1, self.now
        return str(self.version)

    def pause(self, seconds: float) -> None:
        self.now += seconds
        self.meanwhile()


def _lease(objects: FakeObjects) -> Lease:
    return Lease(objects, "site.lock", "s3://b/site", pause=objects.pause, clock=lambda: objects.now, beats=False)


def _elsewhere(objects: FakeObjects, **fields: object) -> None:
    """Let the holder be a process of another machine."""
    assert objects.data is not None
    record = {
        **json.loads(objects.data),
        "machine": "another boot",
        "holder": "pid 7 on station",
        "token": "t",
        **fields,
    }
    objects.data = json.dumps(record).encode()
    objects.version += 1


def test_a_free_lease_is_taken_and_let_go() -> None:
    objects = FakeObjects()
    lease = _lease(objects)
    assert lease.taken_from == ""
    told = holder_in(objects.get(""))
    assert told is not None
    assert told.startswith("pid ")
    lease.release()
    lease.release()
    assert holder_in(objects.get("")) is None
    assert _lease(objects).taken_from == "", "the one before let go"


def test_a_live_process_of_this_machine_is_refused_at_once() -> None:
    objects = FakeObjects()
    _lease(objects)
    with pytest.raises(StoreError, match=r"another writer holds this store \(pid \d+ on .* since"):
        _lease(objects)
    assert objects.now == 0


def test_a_dead_process_of_this_machine_holds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    objects = FakeObjects()
    _lease(objects)
    monkeypatch.setattr(module, "_started", lambda pid: "other")
    assert holder_in(objects.get("")) is None
    assert _lease(objects).taken_from.startswith("pid ")
    assert objects.now == 0


def test_a_writer_elsewhere_that_shows_a_sign_of_life_is_refused() -> None:
    objects = FakeObjects()
    _lease(objects)
    _elsewhere(objects)
    objects.meanwhile = lambda: _elsewhere(objects, beat=int(objects.now)) if objects.now == 5 else None
    with pytest.raises(StoreError, match="pid 7 on station"):
        _lease(objects)
    assert objects.now <= BEAT_S


@pytest.mark.parametrize("tells_age", [True, False])
def test_a_writer_elsewhere_that_stays_silent_loses_its_lease(tells_age: bool) -> None:
    objects = FakeObjects()
    _lease(objects)
    _elsewhere(objects)
    objects.tells_age = tells_age
    lease = _lease(objects)
    assert lease.taken_from == "pid 7 on station"
    assert LEASE_S <= objects.now <= LEASE_S + 5


def test_a_lease_that_ended_long_ago_is_taken_at_once() -> None:
    objects = FakeObjects()
    _lease(objects)
    _elsewhere(objects)
    objects.now = 3600.0
    assert holder_in(objects.get("")) is None
    assert _lease(objects).taken_from == "pid 7 on station"
    assert objects.now == 3600.0


def test_of_two_that_take_at_once_one_is_refused() -> None:
    objects = FakeObjects()
    _lease(objects)
    _elsewhere(objects, released=True)
    taking = objects.put

    def beaten(key: str, data: bytes, *, replacing: str | None) -> str:
        objects.put = taking  # type: ignore[method-assign]  # the stand-in's own
        _elsewhere(objects, released=False)
        return taking(key, data, replacing=replacing)

    objects.put = beaten  # type: ignore[method-assign]  # the stand-in's own
    objects.meanwhile = lambda: _elsewhere(objects, beat=1)
    with pytest.raises(StoreError, match="pid 7 on station"):
        _lease(objects)


def test_a_holder_that_was_asleep_learns_that_it_lost() -> None:
    objects = FakeObjects()
    lease = _lease(objects)
    lease.beat()
    lease.check()
    _elsewhere(objects)
    before = objects.data
    lease.beat()
    with pytest.raises(StoreError, match=r"another took over \(pid 7 on station\): nothing was stored"):
        lease.check()
    lease.release()
    assert objects.data == before, "what is another's stays"


def test_a_beat_whose_answer_was_lost_is_known_as_ones_own() -> None:
    objects = FakeObjects()
    lease = _lease(objects)
    assert objects.data is not None
    objects.put("", objects.data, replacing=str(objects.version))  # arrived, and the answer did not
    lease.beat()
    lease.check()
    lease.beat()
    lease.check()


def test_a_lock_that_nobody_can_read_ends_like_any_other() -> None:
    objects = FakeObjects()
    objects.put("", b"who was this?", replacing=None)
    assert _lease(objects).taken_from == "a writer that gave no name"
    assert objects.now >= LEASE_S

"""Every store against a plain list, whatever is done to it: appends, groups, failures, crashes, reopening, reading."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

import storage.folder
from configs import StoreError
from pipelines import Grid, Measurement, Tick
from storage import STORES, Store, create_store, open_store

from .ticks import METRICS, at, calibration, change_of, failure, surface

GRID = Grid(3, 5, 0.05)


class Crash(BaseException):
    """The process ends before what it wrote is published."""


class Machine(RuleBasedStateMachine):
    """Does the same to a store of one kind and to a memory store, and compares what they give."""

    kind = ""

    @initialize()
    def make(self) -> None:
        self.folder = Path(tempfile.mkdtemp())
        facts: dict[str, Any] = {"site": "x", "grid": GRID, "metrics": METRICS}
        self.store: Store = create_store(self.folder / "s", kind=self.kind, **facts)
        self.model: Store = create_store(self.folder / "model", kind="memory", **facts)
        self.slot = 0
        self.calibration = 0
        self.baseline = 0
        self.metrics = dict(METRICS)

    @property
    def on_disk(self) -> bool:
        return self.kind != "memory"

    def _tick(self, what: str) -> Tick:
        """Make the next tick: a failure, a scan with or without change, or one of a new calibration."""
        number, self.slot = self.slot, self.slot + 1
        if what == "failed":
            return failure(number)
        if what == "recalibrated":
            self.calibration += 1
        kept = calibration(1 + self.calibration / 10)
        scan = surface(number, GRID, kept.id)
        if len(self.model) == 0 or what == "recalibrated":
            self.baseline = number
            return Tick(at(number), scan, calibration=kept)
        change = change_of(scan, surface(self.baseline, GRID, kept.id)) if what == "compared" else None
        measured = {name: Measurement(float(number), 0.5) for name in list(self.metrics)[number % 3 :]}
        return Tick(at(number), scan, change, measured, {"lift": "warning" if number % 2 else "ok"}, (), kept)

    whats = st.sampled_from(["compared", "compared", "alone", "failed", "recalibrated"])

    @rule(what=whats)
    def append(self, what: str) -> None:
        tick = self._tick(what)
        assert self.store.append(tick) == self.model.append(tick)

    @rule(whats=st.lists(st.sampled_from(["compared", "failed", "alone"]), max_size=3))
    @precondition(lambda self: len(self.model) > 0)
    def append_a_group(self, whats: list[str]) -> None:
        ticks = [self._tick(what) for what in whats]
        assert self.store.append_all(ticks) == self.model.append_all(ticks)

    @rule(what=whats, whole=st.booleans())
    @precondition(lambda self: self.on_disk)
    def crash_before_commit(self, what: str, whole: bool) -> None:
        """Everything is written but the reference, or but the snapshot too; the process is gone, another opens."""
        slot, known, baseline = self.slot, self.calibration, self.baseline
        tick = self._tick(what)

        def crash(*_: object) -> None:
            raise Crash

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(storage.folder, "sync_file_system", crash)
            if not whole:
                patch.setattr(storage.folder.Folder, "publish", crash)
            with pytest.raises(Crash):
                self.store.append(tick)
        self.slot, self.calibration, self.baseline = slot, known, baseline
        self.reopen()

    @rule()
    @precondition(lambda self: self.on_disk)
    def reopen(self) -> None:
        self.store.close()
        self.store = open_store(self.folder / "s", write=True)

    @rule()
    def refuse(self) -> None:
        """What does not fit costs nothing: a scan of another grid, in a group that would fit otherwise."""
        wrong = Tick(at(self.slot), surface(self.slot, Grid(3, 5, 0.06)))
        for store in (self.store, self.model):
            with pytest.raises(StoreError, match="another grid"):
                store.append_all([failure(self.slot), wrong])

    @rule(number=st.integers(-9, 9))
    def read(self, number: int) -> None:
        try:
            mine, theirs = self.store[number], self.model[number]
        except IndexError:
            assert not -len(self.model) <= number < len(self.model)
            with pytest.raises(IndexError):
                self.store[number]
            return
        np.testing.assert_allclose(mine.scan.height, theirs.scan.height, atol=0.000251)
        np.testing.assert_array_equal(mine.scan.texture, theirs.scan.texture)
        assert (mine.scan.time, mine.scan.calibration_id) == (theirs.scan.time, theirs.scan.calibration_id)
        facts = ("number", "epoch", "baseline", "planned", "alarms")
        assert [getattr(mine, name) for name in facts] == [getattr(theirs, name) for name in facts]
        assert (mine.change is None) == (theirs.change is None)
        if mine.change is not None and theirs.change is not None:
            np.testing.assert_allclose(mine.change.dz, theirs.change.dz, atol=0.00051)
            assert mine.change.baseline_time == theirs.change.baseline_time
        kept = mine.scan.calibration_id
        assert self.store.calibration(kept).as_mapping() == self.model.calibration(kept).as_mapping()

    @rule(first=st.integers(-1, 9), length=st.integers(0, 5))
    def look_through_a_window(self, first: int, length: int) -> None:
        bounds = at(first), at(first + length)
        mine, theirs = self.store.window(*bounds), self.model.window(*bounds)
        for name in ("time", "scan", "epoch", "planned", "calibration"):
            np.testing.assert_array_equal(mine[name].values.astype(theirs[name].dtype), theirs[name].values)
        np.testing.assert_allclose(mine["height"].values, theirs["height"].values, atol=0.000251)

    @invariant()
    def gives_the_same(self) -> None:
        if not hasattr(self, "store"):
            return
        assert len(self.store) == len(self.model)
        assert self.store.events == self.model.events
        assert self.store.about.metrics == self.model.about.metrics
        mine, theirs = self.store.series(), self.model.series()
        assert mine.equals(theirs), (mine, theirs)

    def teardown(self) -> None:
        if hasattr(self, "store"):
            self.store.close()
            shutil.rmtree(self.folder)


class DiskMachine(Machine):
    """A store on a disk may also be opened with a metric that it does not have yet."""

    @rule()
    @precondition(lambda self: self.on_disk and "porosity" not in self.metrics)
    def add_a_metric(self) -> None:
        self.store.close()
        self.store = open_store(self.folder / "s", write=True, metrics={"porosity": "1"})
        self.metrics["porosity"] = "1"
        self.model._metrics["porosity"] = "1"  # type: ignore[attr-defined]  # no file to open anew


@pytest.mark.parametrize("kind", list(STORES))
@pytest.mark.parametrize(("runs", "steps"), [(3, 12), pytest.param(60, 40, marks=pytest.mark.soak)])
def test_every_store_does_what_a_list_does(kind: str, runs: int, steps: int) -> None:
    machine = type(f"Machine_{kind}", (DiskMachine,), {"kind": kind})
    run = settings(
        max_examples=runs,
        stateful_step_count=steps,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    run_state_machine_as_test(machine, settings=run)


@pytest.mark.parametrize("whole", [False, True])
def test_a_crash_before_the_commit_leaves_what_was(whole: bool) -> None:
    """The rule by itself: few runs of the machine above come to it."""
    machine = type("Crashing", (DiskMachine,), {"kind": "icechunk"})()
    machine.make()
    try:
        for what in ("recalibrated", "compared"):
            machine.append(what)
            machine.crash_before_commit(what, whole)
            machine.gives_the_same()
            machine.read(-1)
    finally:
        machine.teardown()

"""Every fault of the simulated rig ends in the right event, state, message and exit code, and never in a height map."""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from configs import Campaign, InputError
from monitor.campaign import run_campaign
from monitor.cli import run_tokens
from monitor.clock import AcceleratedClock
from monitor.rigs import SimulatedRig
from monitor.rigs.faults import FAULTS, RAISED
from monitor.settled import Settled
from pipelines import PatternSet, instant
from pipelines.reconstruction import diagnose
from storage import Ledger, ledger_beside, open_store
from tests.monitor.campaigns import BASE, HOLDER

ENDS: dict[str, tuple[str, str, int]] = {
    # fault: (state and kind of event, message, exit code of `microrelief scan`)
    "dropped": ("failed", "a frame was dropped", 1),
    "unplugged": ("failed", "the camera does not answer; is it plugged in?", 75),
    "repeated": ("rejected", "capture rejected: repeated frame|capture rejected: frame missing", 4),
    "slipped": ("rejected", "capture rejected: frame missing", 4),
    "late": ("rejected", "capture rejected: sequence off by one", 4),
    "swapped": ("rejected", "capture rejected: two frames swapped", 4),
    "dark": ("rejected", "capture rejected: underexposure", 4),
    "saturated": ("rejected", "capture rejected: saturation", 4),
    "moved": ("rejected", "capture rejected: movement during the capture", 4),
}
T0 = instant(BASE)


CAMERA = (240, 180)
PATTERNS = PatternSet("gray", (608, 684), bits=(8, 8))
FAINT = ["dark", "saturated"]
"""A hundredth of the light, exposed five times as long: faint, and right all the same."""
SUFFERED: list[str | list[str]] = [*FAULTS, FAINT]


def settings(faults: dict[int, Any]) -> dict[str, Any]:
    return {
        "site": {"name": "faults"},
        "store": {"path": "site.icechunk"},
        "rig": {"name": "simulated", "options": {"camera": CAMERA, "pace": 1, "faults": faults}},
        "schedule": {"every": "1 h"},
        "patterns": PATTERNS.as_mapping(),
        "calibration": {"simulated": True},
        "grid": {"pitch_mm": 0.1},
        "register": {"stable_mm": HOLDER},
        "metrics": ["net_volume"],
    }


def test_every_fault_is_in_the_table() -> None:
    assert set(ENDS) == set(FAULTS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds the calibration of the rig, made once."""
    return tmp_path_factory.mktemp("faults")


@pytest.fixture(scope="module")
def run(folder: Path) -> list[Settled]:
    """One campaign: a good visit, then each fault, then a good visit again."""
    told: list[Settled] = []
    faults = dict(enumerate(SUFFERED, start=1))
    campaign = Campaign.model_validate(settings(faults), context={"folder": folder})
    run_campaign(campaign, clock=AcceleratedClock(T0), on_settled=told.append, max_scans=len(SUFFERED) + 2)
    return told


def test_each_ends_in_its_state_with_its_message_and_event(run: list[Settled], folder: Path) -> None:
    store = open_store(folder / "site.icechunk")
    ledger = Ledger(ledger_beside(folder / "site.icechunk"), write=False)
    rows = ledger.rows()
    ledger.close()
    for number, name in enumerate(FAULTS):
        state, message, code = ENDS[name]
        settled = run[number + 1]
        assert settled.state == state, f"{name}: {settled.state}, {settled.cause}"
        assert re.search(message, settled.cause), f"{name}: {settled.cause}"
        assert settled.unavailable == (code == 75)
        assert settled.number is None
        row = rows[number + 1]
        assert (row.state, row.cause, row.scan) == (state, settled.cause, None)
        events = [event for event in store.events if event.kind == state and event.text == settled.cause]
        assert events, f"{name}: no event in the store"
    assert run[0].state == run[-1].state == "taken"
    assert run[-2].state == "taken"
    assert any("capture: underexposure" in event.text for event in store.events)


def test_no_fault_ends_in_a_height_map(run: list[Settled], folder: Path) -> None:
    store = open_store(folder / "site.icechunk")
    assert len(store) == 3  # the good ones and the faint one
    # the soil dries by some micrometres an hour; a wrong height map is off by far more
    for number in range(1, len(store)):
        change = store[number].change
        assert change is not None
        assert np.nanmedian(np.abs(change.dz)) < 0.02
        assert store[number].scan.coverage > 0.5 * store[0].scan.coverage


PAIRS = [pair for pair in combinations([name for name in FAULTS if name not in RAISED], 2) if set(pair) != set(FAINT)]


def test_no_two_faults_together_pass_for_a_good_capture() -> None:
    rig = SimulatedRig(camera=CAMERA, faults=dict(enumerate(PAIRS)))
    rig.open()
    for pair in PAIRS:
        assert diagnose(rig.capture(PATTERNS, T0)).verdict == "reject", pair


def test_a_fault_that_there_is_not_is_named() -> None:
    with pytest.raises(InputError, match=r"rig option faults: no fault 'late '; there are dropped"):
        SimulatedRig(faults={0: ["dark", "late "]})


@pytest.mark.parametrize("name", ["dropped", "unplugged", "swapped"])
def test_the_command_ends_in_the_exit_code(
    name: str, run: list[Settled], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = folder / f"{name}.yaml"
    YAML().dump(settings({0: name}), file)
    assert run_tokens(["scan", str(file)]) == ENDS[name][2]
    assert re.search(ENDS[name][1], capsys.readouterr().out)

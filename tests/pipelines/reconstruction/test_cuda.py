"""A GPU gives the CPU's numbers to the last bit: in numba's simulator everywhere, and on a GPU where there is one."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipelines.reconstruction import Device, device
from pipelines.reconstruction.devices import missing
from tests.pipelines.reconstruction.both_devices import both, scenes

ROOT = Path(__file__).resolve().parents[3]
WAYS = 3 + 2  # of the scene with three pitches; the other scenes go three ways
SETTLED = 2  # axes, of positions that are made up


def test_kernels_in_the_simulator_give_the_same_bits() -> None:
    """Which device numba's kernels are made for is settled when it is imported: hence a process of its own."""
    told = subprocess.run(
        [sys.executable, "-m", "tests.pipelines.reconstruction.simulated_card"],
        cwd=ROOT,
        env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.returncode == 0, told.stderr
    lines = [line.split("; ") for line in told.stdout.splitlines()]
    assert len({(scene, way) for scene, way, *_ in lines}) == WAYS + 3 * 3 + SETTLED
    assert min(float(measured) for *_, measured in lines) > 0.4, "little was measured, so little was compared"
    assert [line for line in lines if float(line[3]) < 1] == []


@pytest.fixture(scope="module")
def card() -> Device:
    why = missing()
    if why:
        pytest.skip(f"needs a GPU: {why}")
    return device("cuda")


@pytest.mark.parametrize("number", range(5))
def test_a_card_gives_the_same_bits(card: Device, number: int) -> None:
    scene = list(scenes(320, 200))[number]
    for way, found in both(scene, device("cpu"), card):
        assert [each for each in found if each.same < 1] == [], way


def test_a_machine_without_a_card_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipelines.reconstruction.devices.find_spec", lambda _: None)
    with pytest.raises(ValueError, match=r"no GPU to work on: the extra is not installed: pip install"):
        device("cuda")
    monkeypatch.setattr("pipelines.reconstruction.devices.find_spec", lambda _: object())
    monkeypatch.setattr("numba.cuda.is_available", lambda: False)
    with pytest.raises(ValueError, match=r"no NVIDIA GPU with its driver is found"):
        device("cuda")


def test_the_cpu_is_always_there() -> None:
    assert device("cpu").name == "cpu"

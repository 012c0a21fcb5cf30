"""``microrelief reconstruct --device``: where there is no GPU, where it is held, and by a wrong name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from configs import DeviceUnavailable
from monitor.cli import run_tokens
from pipelines import Calibration, Frames, PatternSet, PointMap
from pipelines import reconstruction as rec
from storage import write_capture
from tests.pipelines.reconstruction.both_devices import shoot
from tests.pipelines.reconstruction.exact_rig import make_rig


@pytest.fixture
def words(tmp_path: Path) -> list[str]:
    rig = make_rig((96, 64))
    write_capture(shoot(rig, PatternSet("gray", rig.projector.size)), tmp_path / "capture")
    (tmp_path / "rig.json").write_text(rig.to_json())
    files = [str(tmp_path / name) for name in ("capture", "rig.json", "out.npz")]
    return ["reconstruct", files[0], "--calibration", files[1], "--out", files[2], "--force", "--device"]


def test_without_a_gpu_it_says_so_and_what_to_do(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("pipelines.reconstruction.devices.missing", lambda: "no NVIDIA GPU with its driver is found")
    assert run_tokens([*words, "cuda"]) == 2
    told = capsys.readouterr().err.strip()
    assert told.endswith("--device cuda: there is no GPU to work on: no NVIDIA GPU with its driver is found")
    assert "\n" not in told
    assert not Path(words[5]).exists()


def test_a_gpu_that_is_held_may_be_free_later(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(frames: Frames, calibration: Calibration) -> PointMap:
        raise DeviceUnavailable("the GPU cannot be used now: out of memory")

    held = replace(rec.device("cpu"), name="cuda", reconstruct=full)
    monkeypatch.setattr(rec, "device", lambda name: held)
    assert run_tokens([*words, "cuda"]) == 75
    assert "the GPU cannot be used now" in capsys.readouterr().err
    assert not Path(words[5]).exists()


def test_another_device_is_a_mistake(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_tokens([*words, "tpu"]) == 2
    assert "tpu" in capsys.readouterr().err


def test_the_cpu_may_be_named(words: list[str]) -> None:
    assert run_tokens([*words, "cpu"]) == 0
    assert Path(words[5]).exists()

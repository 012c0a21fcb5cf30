"""The delay of a projector, against one whose delay is known, on a clock of the test's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from configs import Campaign, CaptureError
from monitor import health
from monitor.rigs import DevicesRig
from monitor.rigs.cameras import Shot
from monitor.rigs.delay import Delay, measure_delay
from monitor.rigs.projectors.base import Again
from pipelines import PatternSet

PATTERNS = PatternSet("gray", (64, 48), bits=(2, 0))


class Bench:
    """A clock, a projector whose light follows `delay_s` later, and a camera whose frame takes `frame_s`."""

    wraps_at: int | None = None
    exposure_ms = 5.0
    awaits_trigger = False
    again: Again = "frame"

    def __init__(self, delay_s: float, frame_s: float, bright: int = 200) -> None:
        self.time_s, self.delay_s, self.frame_s = 0.0, delay_s, frame_s
        self.levels = [bright if role.name == "white" else 20 for role in PATTERNS.roles]
        self.shown: list[tuple[float, int]] = [(-10.0, 20)]

    def now(self) -> float:
        return self.time_s

    def wait(self, seconds: float) -> None:
        self.time_s += seconds

    def open(self) -> None: ...
    def start(self) -> None: ...
    def close(self) -> None: ...
    def load(self, patterns: PatternSet) -> None: ...

    def show(self, frame: int) -> None:
        self.shown.append((self.time_s + self.delay_s, self.levels[frame]))

    def take(self) -> Shot:
        lit = next(level for since, level in reversed(self.shown) if since <= self.time_s)
        self.time_s += self.frame_s
        return Shot(np.full((16, 16), lit, np.uint8))


def measured(bench: Bench) -> Delay:
    rig = DevicesRig(camera={"kind": "basler"})  # made, never opened: its parts are replaced
    rig.camera, rig.projector = bench, bench
    return measure_delay(rig, PATTERNS, bench.now, bench.wait)


@pytest.mark.parametrize("delay_s", [0.0, 0.013, 0.084, 0.31])
@pytest.mark.parametrize("frame_s", [0.001, 0.01, 0.033])
def test_a_known_delay_is_found_to_one_frame(delay_s: float, frame_s: float) -> None:
    delay = measured(Bench(delay_s, frame_s))
    assert delay_s - 1e-9 <= delay.most_ms / 1000 <= delay_s + frame_s + 1e-9
    assert delay.settle_ms >= 1000 * delay_s
    assert delay.settle_ms <= 1000 * (delay_s + 2 * frame_s) + 5
    assert delay.contrast == 180


def test_a_dark_projector_is_said() -> None:
    with pytest.raises(CaptureError, match="white looks like black"):
        measured(Bench(0.01, 0.01, bright=21))


def test_doctor_opens_the_rig_once_and_measures_the_delay_of_what_stands(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    bench = Bench(0.084, 0.01)
    opened: list[str] = []
    monkeypatch.setattr(bench, "open", lambda: opened.append("part"))
    rig = DevicesRig(camera={"kind": "basler"}, settle_ms=40)
    rig.camera, rig.projector = bench, bench
    monkeypatch.setattr(health, "make_rig", lambda name, options: rig)
    monkeypatch.setattr(health, "measure_delay", lambda rig, patterns: measured(Bench(0.084, 0.01)))
    campaign = Campaign.model_validate(
        {
            "site": {"name": "bench"},
            "store": {"path": str(tmp_path / "bench.icechunk")},
            "rig": {"name": "devices", "options": {"camera": {"kind": "basler"}}},
            "schedule": {"every": "1 h"},
            "calibration": {"file": str(tmp_path / "calibration.json")},
        }
    )
    found = {finding.what: finding for finding in health.check_campaign(campaign)}
    assert opened == ["part", "part"]  # camera and projector, once each
    assert found["rig"].level == "ok"
    assert found["projector"].level == "wrong"
    assert "set rig option settle_ms to" in found["projector"].told
    bench.again = "capture"
    assert "projector" not in {finding.what for finding in health.check_campaign(campaign)}

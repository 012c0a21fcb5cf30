"""A campaign on stand-ins but with the real store and ledger: to run in a process that a test stops or kills.

python -m tests.monitor.campaigns FOLDER --hours 100 --scan-s 0.02 [--real | --simulated]
"""

from __future__ import annotations

import argparse
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from configs import Campaign
from monitor.campaign import run_campaign
from monitor.clock import AcceleratedClock, RealClock
from monitor.settled import Settled
from monitor.stopping import graceful_stop
from monitor.visit import Epoch, Recipe, Yield
from pipelines import Calibration, Frames, Instant, Lens, Scan, Tick, instant

from .stand_ins import whole

CAMERA = Lens((16, 12), np.array([[1000.0, 0, 8], [0, 1000, 6], [0, 0, 1]]), np.zeros(5))
PROJECTOR = Lens((16, 16), np.array([[300.0, 0, 8], [0, 300, 8], [0, 0, 1]]), np.zeros(5))
REFERENCE = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 100]])
HOLDER = [[[x - 0.95, -5.2], [x + 0.95, -5.2], [x + 0.95, 5.2], [x - 0.95, 5.2]] for x in (-6.25, 6.25)]
SOIL = [[-4.6, -4.6], [4.6, -4.6], [4.6, 4.6], [-4.6, 4.6]]
BASE = datetime(2026, 1, 1, tzinfo=UTC)


class Rig:
    """Gives dark frames after a while."""

    def __init__(self, scan_s: float = 0.0) -> None:
        self.scan_s = scan_s

    def open(self) -> None:
        pass

    def capture(self, patterns: object, at: Instant) -> Frames:
        if self.scan_s >= 1:
            print("capturing", flush=True)
        time.sleep(self.scan_s)
        return Frames(np.zeros((len(patterns.roles), 12, 16), np.uint8), at, patterns)  # type: ignore[attr-defined, arg-type]  # a pattern set

    def close(self) -> None:
        pass


@whole
def work(frames: Frames, recipe: Recipe, epoch: Epoch | None, planned: Instant) -> Yield:
    """A scan whose height tells its slot, so that a scan in the wrong place would show."""
    hours = float((planned - instant(BASE)) / np.timedelta64(1, "h"))
    height = np.full(recipe.grid.shape, (hours % 1000) / 1000, np.float32)
    zeros = np.zeros(recipe.grid.shape, np.uint8)
    scan = Scan(recipe.grid, frames.time, height, np.full_like(height, 0.01), zeros, zeros, recipe.calibration.id)
    return Yield(Tick(planned, scan, calibration=recipe.calibration), "taken")


def campaign_in(
    folder: Path, every: str = "1 h", until: str | None = None, start: str | None = BASE.isoformat()
) -> Campaign:
    """Make a campaign in a folder, with a calibration that only says where cells are."""
    file = folder / "calibration.json"
    if not file.exists():
        calibration = Calibration(CAMERA, PROJECTOR, np.eye(3), np.array([-1.0, 0, 0]), REFERENCE, {"stereo": 0.1})
        file.write_text(calibration.to_json(), encoding="utf-8")
    return Campaign.model_validate(
        {
            "site": {"name": "stand-in"},
            "store": {"path": "site.icechunk"},
            "rig": {"name": "simulated"},
            "schedule": {"every": every, "start": start, "until": until},
            "patterns": {"kind": "gray", "size": [16, 16], "bits": [2, 2]},
            "calibration": {"file": "calibration.json"},
            "grid": {"pitch_mm": 0.1},
        },
        context={"folder": folder},
    )


def simulated_campaign_in(folder: Path, until: str) -> Campaign:
    """Make a campaign on the simulated rig with a small camera, which calibrates itself; its soil dries fast."""
    return Campaign.model_validate(
        {
            "site": {"name": "simulated"},
            "store": {"path": "site.icechunk"},
            "rig": {"name": "simulated", "options": {"camera": [480, 360], "pace": 6}},
            "schedule": {"every": "1 h", "start": BASE.isoformat(), "until": until},
            "calibration": {"simulated": True},
            "grid": {"pitch_mm": 0.05},
            "register": {"stable_mm": HOLDER},
            "region_mm": SOIL,
            "metrics": ["net_volume", "gained_volume"],
        },
        context={"folder": folder},
    )


def tell(settled: Settled) -> None:
    """Say what is durable, as `run` does."""
    slot = int((settled.planned - instant(BASE)) / np.timedelta64(1, "h"))
    said = f"committed scan {settled.number}" if settled.number is not None else settled.state
    print(f"{said} slot {slot}", flush=True)


def main() -> None:
    """Run it until its hours are over, or somebody stops it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--hours", type=int, default=100)
    parser.add_argument("--scan-s", type=float, default=0.0)
    parser.add_argument("--real", action="store_true", help="every second by the real clock")
    parser.add_argument("--simulated", action="store_true", help="the simulated rig, and all that follows it")
    options = parser.parse_args()
    until = str(instant(BASE) + np.timedelta64(options.hours, "h"))[:19] + "+00:00"
    if options.simulated:
        run_campaign(
            simulated_campaign_in(options.folder, until), clock=AcceleratedClock(instant(BASE)), on_settled=tell
        )
        return
    if options.real:
        campaign, clock = campaign_in(options.folder, "1 s", start=None), RealClock()
    else:
        campaign = campaign_in(options.folder, until=until)
        clock = AcceleratedClock(instant(BASE))  # type: ignore[assignment]  # either is a Clock
    with graceful_stop() as stop:
        outcome = run_campaign(campaign, clock=clock, rig=Rig(options.scan_s), on_settled=tell, stop=stop, work=work)
    print(f"ended: {outcome.taken} taken, stopped {outcome.stopped}", flush=True)


if __name__ == "__main__":
    main()

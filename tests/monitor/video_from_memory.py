"""Video from frames in memory: a rig that gives the same large captures at once, and all that follows it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from configs import Campaign
from monitor.campaign import run_campaign
from monitor.clock import Clock
from monitor.settled import Outcome, Settled
from pipelines import Calibration, Frames, Instant, PatternSet

__all__ = ["MemoryRig", "record", "video_campaign"]


@dataclass
class MemoryRig:
    """Gives captures from memory, in turn."""

    captures: list[Frames]
    count: int = field(default=0)

    def open(self) -> None:
        pass

    def capture(self, patterns: PatternSet, at: Instant) -> Frames:
        frames = self.captures[self.count % len(self.captures)]
        self.count += 1
        return Frames(frames.stack, at, patterns, frames.exposure_ms)

    def close(self) -> None:
        pass


def video_campaign(
    folder: Path,
    rig: Calibration,
    patterns: PatternSet,
    rate_hz: float,
    length: str,
    pitch_mm: float | None = None,
) -> Campaign:
    """Make a campaign with the video recipe: change, volumes and the store, on the camera's own pitch or another.

    Each scan is committed at once, as without any setting: a group is less work, but work that all comes together.
    """
    (folder / "calibration.json").write_text(rig.to_json(), encoding="utf-8")
    return Campaign.model_validate(
        {
            "site": {"name": "video"},
            "store": {"path": "video.icechunk"},
            "rig": {"name": "simulated"},
            "schedule": {"video": {"rate_hz": rate_hz, "for": length}},
            "patterns": patterns.as_mapping(),
            "calibration": {"file": "calibration.json"},
            "grid": {"pitch_mm": pitch_mm},
            "metrics": ["net_volume", "gained_volume", "lost_volume"],
        },
        context={"folder": folder},
    )


def record(
    campaign: Campaign, rig: MemoryRig, clock: Clock, told: Callable[[Settled], None], max_scans: int | None = None
) -> Outcome:
    """Record."""
    return run_campaign(campaign, clock=clock, rig=rig, on_settled=told, max_scans=max_scans)

"""Ten minutes of video at 1 Hz and full size, in real time: nothing dropped, no lag, memory flat. `make soak`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import psutil
import pytest

from monitor.clock import RealClock
from monitor.settled import Settled
from storage import open_store
from tests.benchmarks.bench_reconstruct import COLUMNS, ROWS, capture
from tests.pipelines.reconstruction.exact_rig import make_rig

from .video_from_memory import MemoryRig, record, video_campaign

SECONDS = 600


@pytest.mark.soak
def test_ten_minutes_at_full_size_drop_nothing(tmp_path: Path) -> None:
    rig = make_rig((COLUMNS, ROWS))
    captures = [capture(rig, seed) for seed in (1, 2)]
    memory: list[int] = []
    ended: list[Settled] = []

    def told(settled: Settled) -> None:
        ended.append(settled)
        memory.append(psutil.Process().memory_info().rss)

    warm = tmp_path / "warm"
    warm.mkdir()
    record(video_campaign(warm, rig, captures[0].patterns, 1.0, "20 s"), MemoryRig(captures), RealClock(), told, 3)
    ended.clear()
    memory.clear()
    campaign = video_campaign(tmp_path, rig, captures[0].patterns, 1.0, f"{SECONDS} s")
    outcome = record(campaign, MemoryRig(captures), RealClock(), told)
    lags = np.array(outcome.lags_s)
    print(f"\n{outcome.taken} taken, {outcome.missed} dropped, lag max {lags.max():.3f} s")
    assert (outcome.taken, outcome.missed) == (SECONDS, 0)
    assert lags.max() < 1.0
    assert len(open_store(tmp_path / "video.icechunk")) == SECONDS
    settled_memory = np.array(memory[60:], dtype=float)
    slope = np.polyfit(np.arange(len(settled_memory)), settled_memory, 1)[0]
    assert slope * SECONDS < 0.1 * settled_memory.mean(), "memory grows"

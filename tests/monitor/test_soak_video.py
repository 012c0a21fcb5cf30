"""Ten minutes of video at 1 Hz and full size, in real time: nothing dropped, no lag, memory flat. `make soak`.

``MICRORELIEF_SOAK_SECONDS=60 pytest -s -m soak tests/monitor/test_soak_video.py`` is a minute of it.
"""

from __future__ import annotations

import os
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

SECONDS = int(os.environ.get("MICRORELIEF_SOAK_SECONDS", "600"))
SETTLED = SECONDS // 10
"""Scans after which memory no longer grows."""


@pytest.mark.soak
def test_ten_minutes_at_full_size_drop_nothing(tmp_path: Path) -> None:
    rig = make_rig((COLUMNS, ROWS))
    captures = [capture(rig, seed) for seed in (1, 2)]
    memory: list[int] = []

    def told(settled: Settled) -> None:  # keeps nothing of it: it holds the scan
        memory.append(psutil.Process().memory_info().rss)

    warm = tmp_path / "warm"
    warm.mkdir()
    record(video_campaign(warm, rig, captures[0].patterns, 1.0, "20 s"), MemoryRig(captures), RealClock(), told, 3)
    memory.clear()
    campaign = video_campaign(tmp_path, rig, captures[0].patterns, 1.0, f"{SECONDS} s")
    outcome = record(campaign, MemoryRig(captures), RealClock(), told)
    lags, latencies = np.array(outcome.lags_s), np.array(outcome.latencies_s)
    settled_memory = np.array(memory[SETTLED:], dtype=float)
    slope = np.polyfit(np.arange(len(settled_memory)), settled_memory, 1)[0]
    print(
        f"\n{outcome.taken} taken, {outcome.missed} dropped, late by at most {lags.max():.3f} s, worked out after "
        f"p50 {np.median(latencies):.3f} s p99 {np.percentile(latencies, 99):.3f} s; memory "
        f"{settled_memory.mean() / 1e6:.0f} MB, {slope * len(settled_memory) / 1e6:+.0f} MB over the run"
    )
    assert (outcome.taken, outcome.missed) == (SECONDS, 0)
    assert lags.max() < 1.0
    assert np.percentile(latencies, 99) < 1.0
    assert len(open_store(tmp_path / "video.icechunk")) == SECONDS
    assert slope * SECONDS < 0.1 * settled_memory.mean(), "memory grows"

"""A commit costs as much after many scans as after few."""

from __future__ import annotations

import pytest

from ..benchmarks.bench_store import LATE, SPAN, WARM, append_against_floor, around, commit_costs


@pytest.mark.soak
def test_a_commit_costs_the_same_at_scan_300_as_at_scan_10() -> None:
    costs = commit_costs(200, LATE + SPAN)
    (early_s, early_bytes), (late_s, late_bytes) = around(costs, WARM), around(costs, LATE)
    print(f"\nscan {WARM}: {early_s * 1e3:.0f} ms, {early_bytes / 1e3:.0f} kB;", end=" ")
    print(f"scan {LATE}: {late_s * 1e3:.0f} ms, {late_bytes / 1e3:.0f} kB")
    assert late_bytes < 1.15 * early_bytes
    assert late_s < 2 * early_s, "measured on a machine that may do other things meanwhile"


def test_a_commit_leaves_a_1_hz_video_its_time() -> None:
    append, floor, _, _ = append_against_floor(500, repeats=3)
    assert append < max(0.5, 10 * floor)

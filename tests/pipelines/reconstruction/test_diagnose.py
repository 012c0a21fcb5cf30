"""Good captures are fine; each damage gets its own name. The table of confusions is printed with -s."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path
from time import thread_time

import numpy as np
import numpy.typing as npt
import pytest

from monitor.rigs import SimulatedRig
from pipelines import PatternSet, parse_instant
from pipelines.reconstruction import CAUSES, diagnose, diagnose_stack
from storage import read_capture, read_patterns

from .damage import Damaged, blurred, clipped, damaged
from .synthetic_capture import slanted, take

Stack = npt.NDArray[np.uint8]
PATTERNS = PatternSet("gray", (608, 684))
DOCS = Path(__file__).resolve().parents[3] / "docs" / "diagnose.md"


@cache
def synthetic(seed: int = 3) -> Stack:
    """A textured slope in closed form, through blur, flicker and noise."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    view = replace(slanted(240, 320, PATTERNS.size, 1.1), noise=1.2, flicker=0.008, blur_px=0.6)
    grain = gaussian_filter((0.6 + 0.4 * rng.random((60, 80))).repeat(4, 0).repeat(4, 1), 1.5)
    frames = take(view, PATTERNS, seed=seed).stack
    return clipped(frames * grain + rng.normal(0, 1, frames.shape))


@cache
def simulated(seed: int = 1, day: int = 3, camera: tuple[int, int] = (640, 480)) -> Stack:
    rig = SimulatedRig(camera=camera, started="2026-01-01T00:00:00Z", seed=seed)
    rig.open()
    stack = rig.capture(PATTERNS, parse_instant(f"2026-01-{day:02d}T00:00:00Z")).stack
    assert stack.dtype == np.uint8
    return stack.astype(np.uint8)


def confusions(origin: str, cases: list[Damaged]) -> list[str]:
    """Print how often each damage was called what; give those that were called by another name."""
    table: Counter[tuple[str, str]] = Counter()
    wrong = []
    for cause, what, stack, patterns in cases:
        found = diagnose_stack(stack, patterns)
        named = found.causes[0] if found.causes else "fine"
        table[cause, named] += 1
        if named != cause:
            wrong.append(f"{cause}, {what}: {[finding.line for finding in found.findings]}")
    columns = [*CAUSES, "fine"]
    print(f"\n{origin:12}", *(f"{name[:7]:>7}" for name in columns))
    for cause in CAUSES:
        print(f"{cause:12}", *(f"{table[cause, name] or '.':>7}" for name in columns))
    return wrong


def test_damages_of_a_synthetic_capture_get_their_names() -> None:
    stack = synthetic()
    cases = [*damaged(stack, PATTERNS), *blurred(stack, PATTERNS, (3.0, 5.0))]
    assert {case[0] for case in cases} == set(CAUSES)
    assert not confusions("synthetic", cases)


def test_damages_of_a_simulated_capture_get_their_names() -> None:
    stack = simulated()
    assert not confusions("simulated", [*damaged(stack, PATTERNS), *blurred(stack, PATTERNS, (3.0, 6.0))])


def test_damages_of_a_rendered_capture_get_their_names(shared_data: Path) -> None:
    patterns = read_patterns(shared_data / "rendered" / "patterns.yaml")
    stack = read_capture(shared_data / "rendered" / "t0", patterns).stack.astype(np.uint8)
    assert not confusions("rendered", [*damaged(stack, patterns), *blurred(stack, patterns, (3.0, 5.0))])


@pytest.mark.parametrize("seed", [3, 4])
def test_a_good_synthetic_capture_is_fine(seed: int) -> None:
    assert not diagnose_stack(synthetic(seed), PATTERNS).findings


@pytest.mark.parametrize(("seed", "day"), [(1, 1), (2, 2), (3, 3), (4, 4)])
@pytest.mark.parametrize("camera", [(640, 480), (320, 240)])
def test_a_good_simulated_capture_is_fine(seed: int, day: int, camera: tuple[int, int]) -> None:
    found = diagnose_stack(simulated(seed, day, camera), PATTERNS)
    assert not found.findings, [finding.line for finding in found.findings]


@pytest.mark.parametrize(
    "name",
    ["rendered/t0", "rendered/t1", "rendered/t0_tile1", "rendered/calib/pose0", "rendered/calib/pose4"]
    + [f"kamino410/capture_{n}" for n in range(3)],
)
def test_a_good_capture_is_fine(shared_data: Path, name: str) -> None:
    patterns = read_patterns(shared_data / name.split("/")[0] / "patterns.yaml")
    found = diagnose(read_capture(shared_data / name, patterns))
    assert not found.findings, [finding.line for finding in found.findings]


def test_frames_are_named() -> None:
    stack = synthetic()
    swapped = stack.copy()
    swapped[[8, 15]] = swapped[[15, 8]]
    (finding,) = diagnose_stack(swapped, PATTERNS).findings
    assert finding.frames == ("columns_3", "columns_6_inverted")
    (finding,) = diagnose_stack(np.delete(stack, 11, axis=0), PATTERNS).findings
    assert finding.frames == ("columns_4_inverted",)
    assert (finding.value, finding.limit) == (41, 42)
    (finding,) = diagnose_stack(clipped(stack * 2.2), PATTERNS).findings[:1]
    assert finding.limit < finding.value <= 1


def test_a_full_capture_takes_little_time() -> None:
    small = simulated()
    stack = np.tile(small, (1, 3, 4))
    diagnose_stack(stack, PATTERNS)
    assert min(_seconds(stack) for _ in range(5)) < 0.15  # of this thread: other tests may run beside it


def _seconds(stack: Stack) -> float:
    began = thread_time()
    diagnose_stack(stack, PATTERNS)
    return thread_time() - began


def test_the_page_lists_every_cause() -> None:
    text = DOCS.read_text(encoding="utf-8")
    for name, cause in CAUSES.items():
        assert f"| `{name}` | {cause.title} | {cause.found_by} | {cause.advice} |" in text


@pytest.mark.parametrize(
    "stack", [np.zeros((3, 4), np.uint8), np.zeros((3, 4, 5), float), np.zeros((0, 4, 5), np.uint8)]
)
def test_what_is_no_stack_is_refused(stack: Stack) -> None:
    with pytest.raises(ValueError, match="frames must be"):
        diagnose_stack(stack, PATTERNS)

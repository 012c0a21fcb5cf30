"""Frame pool: room is lent to one capture at a time, and used again."""

from __future__ import annotations

import numpy as np

from monitor.frame_pool import FramePool
from monitor.rigs import SimulatedRig
from pipelines import Frames, PatternSet

from .stand_ins import T0

PATTERNS = PatternSet("gray", (16, 16), bits=(2, 2))
SHAPE = (len(PATTERNS.roles), 12, 16)


def frames(stack: np.ndarray) -> Frames:
    return Frames(stack, T0, PATTERNS)


def test_room_is_used_again_once_it_is_let_go_and_not_before() -> None:
    pool = FramePool()
    first, second = pool.take(SHAPE, np.uint8), pool.take(SHAPE, np.uint8)
    assert first is not second
    pool.let_go(frames(first))
    pool.let_go(frames(first))  # twice is once
    assert pool.take(SHAPE, np.uint8) is first
    assert pool.take(SHAPE, np.uint8) is not first


def test_other_shapes_and_foreign_frames_are_not_mixed_in() -> None:
    pool = FramePool()
    foreign = np.zeros(SHAPE, np.uint8)
    pool.let_go(frames(foreign))
    assert pool.take(SHAPE, np.uint8) is not foreign
    lent = pool.take(SHAPE, np.uint8)
    pool.let_go(frames(lent))
    other = pool.take(SHAPE, np.uint16)
    assert other.dtype == np.uint16
    assert other.shape == SHAPE
    assert pool.take(SHAPE, np.uint8) is not lent, "thrown away: the camera has changed"


def test_a_rig_captures_into_lent_room() -> None:
    pool, rig = FramePool(), SimulatedRig(camera=(64, 64))
    pool.lend_to(rig)
    pool.lend_to(object())  # cannot
    rig.open()
    patterns = PatternSet("gray", (608, 684))
    kept = rig.capture(patterns, T0)
    before = kept.stack.copy()
    room = rig.capture(patterns, T0 + np.timedelta64(1, "h")).stack
    np.testing.assert_array_equal(kept.stack, before)
    pool.let_go(kept)
    assert rig.capture(patterns, T0).stack is kept.stack
    assert room is not kept.stack

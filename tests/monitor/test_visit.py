"""One visit: what becomes of a baseline, a change, an alarm, a scan that cannot be laid onto its baseline."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from configs import Alarm, CaptureError
from monitor import visit as module
from monitor.baseline import unfit
from monitor.visit import Epoch, Recipe, visit
from pipelines import LEVEL_NONE, Event, Frames, Grid, Scan

from .stand_ins import CALIBRATION, PATTERNS, T0, after

GRID = Grid(120, 160, 0.05)
HOLE = (slice(40, 80), slice(60, 100))


def relief() -> npt.NDArray[np.float32]:
    """A rough surface: registration needs something to hold on to."""
    noise = np.random.default_rng(1).normal(0, 0.02, GRID.shape)
    rough = np.fft.irfft2(np.fft.rfft2(noise) * np.exp(-np.arange(GRID.columns // 2 + 1) / 20), GRID.shape)
    return rough.astype(np.float32)


def scan_at(seconds: float, height: npt.NDArray[np.float32]) -> Scan:
    known = np.isfinite(height)
    sigma = np.where(known, np.float32(0.003), np.float32(np.nan))
    texture = np.full(GRID.shape, 120, np.uint8)
    level = np.where(known, np.uint8(0), np.uint8(LEVEL_NONE))
    return Scan(GRID, after(seconds), height, sigma, texture, level, CALIBRATION.id)


STABLE = np.ones(GRID.shape, np.bool_)
STABLE[20:100, 40:120] = False
RECIPE = Recipe(
    GRID,
    patterns=PATTERNS,
    calibration=CALIBRATION,
    stable=STABLE,
    metrics=("net_volume", "lost_volume"),
    alarms=(Alarm(name="erosion", metric="lost_volume", warn_above=0.5, alarm_above=1.0),),
)
FRAMES = Frames(np.zeros((len(PATTERNS.roles), 4, 5), np.uint8), T0, PATTERNS)


@pytest.fixture
def gives(monkeypatch: pytest.MonkeyPatch) -> list[Scan]:
    """The scans that the reconstruction gives, one after the other, of captures that are fine."""
    scans: list[Scan] = []
    monkeypatch.setattr(module, "remarks", lambda frames: ())
    monkeypatch.setattr(module, "make_scan", lambda frames, calibration, rules: scans.pop(0))
    return scans


def test_the_first_scan_is_the_baseline(gives: list[Scan]) -> None:
    gives.append(scan_at(0, relief()))
    result = visit(FRAMES, RECIPE, None, T0)
    assert result.state == "taken"
    assert result.tick.change is None
    assert result.tick.metrics == {}
    assert result.tick.alarms == {"erosion": "ok"}
    assert result.tick.calibration is CALIBRATION


def test_a_loss_is_measured_and_alarms_once(gives: list[Scan]) -> None:
    lost = relief()
    lost[HOLE] -= 0.5  # 40 x 40 cells of 0.05 mm: 2 mm2 x 2 x 0.5 = 2 mm3
    gives.extend([scan_at(60, lost), scan_at(120, lost)])
    first = visit(FRAMES, RECIPE, Epoch(scan_at(0, relief())), after(60))
    assert first.tick.metrics["lost_volume"].value == pytest.approx(2.0, rel=0.02)
    assert first.tick.alarms == {"erosion": "alarm"}
    (told,) = first.tick.events
    found = r"erosion: ok -> alarm, lost volume (\d\.\d+) ± (0\.0*[1-9]\d) mm³, above the limit of 1 mm³"
    words = re.fullmatch(found, told.text)
    assert words, told.text
    value, sigma = words.groups()
    assert len(value.partition(".")[2]) == len(sigma.partition(".")[2]), "as many decimals as its uncertainty"
    second = visit(FRAMES, RECIPE, Epoch(scan_at(0, relief()), first.watches), after(120))
    assert second.tick.events == (), "an alarm that stays is no event"


def test_another_calibration_starts_an_epoch(gives: list[Scan]) -> None:
    gives.append(scan_at(60, relief()))
    baseline = replace(scan_at(0, relief()), calibration_id="another")
    result = visit(FRAMES, RECIPE, Epoch(baseline), after(60))
    assert result.state == "taken"
    assert result.tick.change is None


def test_a_scan_that_cannot_be_registered_is_kept_flagged_and_measures_nothing(gives: list[Scan]) -> None:
    blind = np.full(GRID.shape, np.nan, np.float32)
    blind[60, 80] = 0.0
    gives.append(scan_at(60, blind))
    result = visit(FRAMES, RECIPE, Epoch(scan_at(0, relief())), after(60))
    assert result.state == "rejected"
    assert result.tick.scan is not None
    assert result.tick.change is not None
    assert result.tick.change.motion.verdict == "failed"
    assert result.tick.metrics == {}
    assert result.tick.alarms == {"erosion": "ok"}, "one slot without a value raises and clears nothing"
    assert result.tick.events[0].kind == "rejected"
    assert result.watches["erosion"].silent == 1


def test_frames_are_kept_only_where_the_campaign_retains_them(gives: list[Scan]) -> None:
    gives.extend([scan_at(0, relief()), scan_at(0, relief())])
    assert visit(FRAMES, RECIPE, None, T0).tick.frames is None
    assert visit(FRAMES, replace(RECIPE, keep_frames=True), None, T0).tick.frames is FRAMES


def test_a_capture_that_would_give_wrong_heights_is_rejected_with_its_cause() -> None:
    with pytest.raises(CaptureError, match="capture rejected: underexposure: white is"):
        visit(FRAMES, RECIPE, None, T0)


SATURATED = Event(T0, "note", "capture: saturation: 3 % of the bright pixels are at 255, where the camera clips")
RETAKEN = Event(T0, "note", "capture: frame 7 (columns 2) was taken again: incompletely grabbed")
MOVED = Event(T0, "note", "capture: movement during the capture: the second half lies 0.4 px beside the first")


@pytest.mark.parametrize(
    ("events", "why"),
    [
        ((), ""),
        ((SATURATED, RETAKEN), ""),  # every capture of this rig says so: to wait for one without would be for ever
        ((SATURATED, MOVED), "not good enough for a baseline: capture: movement during the capture"),
    ],
)
def test_only_what_disturbed_this_one_capture_keeps_it_from_being_a_baseline(
    events: tuple[Event, ...], why: str
) -> None:
    told = unfit(scan_at(0, relief()), events)
    assert told.startswith(why)
    assert bool(told) == bool(why)


def test_a_small_sample_in_a_large_image_is_a_baseline_and_a_few_cells_are_not() -> None:
    small = np.full(GRID.shape, np.nan, np.float32)
    small[:20, :20] = 0.1  # 2 % of the grid
    assert unfit(scan_at(0, small)) == ""
    small[:, 2:] = np.nan
    assert "40 cells of the grid were measured" in unfit(scan_at(0, small))

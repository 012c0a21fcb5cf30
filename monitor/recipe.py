"""What a campaign's settings stand for: its patterns, calibration, rig, masks, and the recipe made of them."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import fields
from datetime import timedelta
from pathlib import Path

import numpy as np

from configs import Area, Campaign, InputError
from pipelines import Calibration, Grid, Instant, PatternSet, format_instant
from storage import Store

from . import __version__
from .rigs import (
    BOARD,
    Rig,
    SimulatedRig,
    SimulatedStage,
    Stage,
    calibration_captures,
    make_rig,
    make_stage,
    rig_options,
)
from .visit import Mask, Recipe, Rules

__all__ = [
    "campaign_hash",
    "campaign_rules",
    "known_calibration",
    "make_recipe",
    "masks_of",
    "read_calibration",
    "read_pattern_set",
    "rig_of",
    "simulated_calibration_file",
    "stage_of",
]


def read_pattern_set(campaign: Campaign) -> PatternSet:
    """Give what a campaign projects: its own pattern set, that of its pattern file, or 10-bit Gray code on 608x684.

    Raises
    ------
    InputError
        If it is no pattern set.
    """
    from storage import read_patterns

    if campaign.patterns is None:
        return PatternSet(kind="gray", size=(608, 684))
    if isinstance(campaign.patterns, Path):
        return read_patterns(campaign.patterns)
    try:
        return PatternSet.from_mapping(dict(campaign.patterns))
    except ValueError as error:
        raise InputError(f"patterns: {error}") from None


def known_calibration(campaign: Campaign, patterns: PatternSet) -> Calibration | None:
    """Read a campaign's calibration; None where the simulated rig has yet to make it.

    Raises
    ------
    InputError
        If the file is not there or is no calibration.
    """
    file = campaign.calibration.file
    kept = simulated_calibration_file(campaign, patterns) if file is None else file
    return _calibration_of(kept) if file is not None or kept.exists() else None


def read_calibration(
    campaign: Campaign, patterns: PatternSet, at: Instant, tell: Callable[[str], None] = lambda what: None
) -> Calibration:
    """Read a campaign's calibration, or let the simulated rig make it once and keep it beside the store.

    Raises
    ------
    InputError
        If the file is not there or is no calibration.
    """
    known = known_calibration(campaign, patterns)
    if known is not None:
        return known
    from pipelines.reconstruction import Board, calibrate

    tell("the simulated rig calibrates itself on its simulated board")
    captures = calibration_captures(campaign.rig.options, patterns, at)
    board = Board(BOARD.inner_corners, BOARD.square_mm)
    calibration = calibrate(captures, board, software=f"microrelief {__version__}")
    kept = simulated_calibration_file(campaign, patterns)
    kept.parent.mkdir(parents=True, exist_ok=True)
    part = kept.with_name(f"{kept.name}.{os.getpid()}.part")
    part.write_text(calibration.to_json(), encoding="utf-8")
    part.replace(kept)  # whole or not at all, whoever is killed meanwhile
    return calibration


def simulated_calibration_file(campaign: Campaign, patterns: PatternSet) -> Path:
    """Where a simulated rig's calibration is kept: another rig or other patterns have another file."""
    options = {name: value for name, value in campaign.rig.options.items() if name != "faults"}
    made_of = {"options": options, "patterns": patterns.as_mapping()}
    name = Path(campaign.store.path).stem
    return campaign.store.beside / f"{name}.calibration-{_hash(made_of)[:8]}.json"


def rig_of(campaign: Campaign, store: Store | None) -> Rig:
    """Make a campaign's rig; a scene that ages goes on from the first scan of its store, however often it is restarted.

    Such a rig has an option `started`; what the campaign gives there goes before.
    """
    options = dict(campaign.rig.options)
    ages = "started" in rig_options(campaign.rig.name) and options.get("started") is None
    if ages and store is not None and len(store):
        options["started"] = format_instant(store[0].scan.time)
    return make_rig(campaign.rig.name, options)


def stage_of(area: Area, rig: Rig) -> Stage:
    """Make the stage of an area; a simulated one carries what the simulated rig looks at.

    Raises
    ------
    InputError
        Only one of both is simulated.
    """
    stage = make_stage(area.stage)
    if isinstance(rig, SimulatedRig) and isinstance(stage, SimulatedStage):
        rig.carried_by(stage)
    elif isinstance(rig, SimulatedRig) or isinstance(stage, SimulatedStage):
        raise InputError("area.stage: the simulated stage carries the simulated rig's sample, and no other")
    return stage


def campaign_rules(campaign: Campaign, grid: Grid) -> Rules:
    """Give what is done with every scan of a campaign.

    Raises
    ------
    InputError
        If a polygon holds no cell of the grid.
    """
    stable, region = masks_of(campaign, grid)
    return Rules(
        grid,
        stable,
        region,
        campaign.metrics,
        campaign.alarms,
        campaign.reconstruct.remove_background,
        campaign.reconstruct.local_integration,
        environment=campaign.environment,
    )


def make_recipe(campaign: Campaign, patterns: PatternSet, calibration: Calibration, grid: Grid) -> Recipe:
    """Give what is done with every capture of a campaign."""
    rules, kept = campaign_rules(campaign, grid), campaign.retain.raw_frames
    return Recipe(
        **{each.name: getattr(rules, each.name) for each in fields(rules)},
        patterns=patterns,
        calibration=calibration,
        keep_frames=kept != "off",
        frames_for=np.timedelta64(kept, "ns") if isinstance(kept, timedelta) else None,
        follow=campaign.schedule.video is not None,
    )


def masks_of(campaign: Campaign, grid: Grid) -> tuple[Mask, Mask]:
    """Give the cells that hold still and those that count, each None where the campaign names none."""
    from pipelines.change import polygon_mask

    stable = polygon_mask(campaign.register_.stable_mm, grid) if campaign.register_.stable_mm else None
    region = polygon_mask((campaign.region_mm,), grid) if campaign.region_mm is not None else None
    for mask, key in ((stable, "register.stable_mm"), (region, "region_mm")):
        if mask is not None and not mask.any():
            x_low, x_high, y_low, y_high = grid.extent_mm
            raise InputError(
                f"{key} holds no cell: the height map reaches from {x_low:.2f} to {x_high:.2f} mm in x and "
                f"from {y_low:.2f} to {y_high:.2f} mm in y"
            )
    return stable, region


def campaign_hash(campaign: Campaign, patterns: PatternSet) -> str:
    """Hash of everything in a campaign that numbers depend on: not of where its files lie, or its devices."""
    left_out = {"store", "patterns", "calibration", "notify", "report", "area"}
    settings = campaign.model_dump(mode="json", by_alias=True, exclude=left_out)
    if campaign.area is not None:
        settings["area"] = campaign.area.model_dump(mode="json", exclude={"stage"})
    return _hash({**settings, "patterns": patterns.as_mapping()})


def _calibration_of(file: Path) -> Calibration:
    try:
        return Calibration.from_json(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"no calibration {file}: make it with "
            f"`microrelief calibrate POSE_DIR... --board COLUMNSxROWS --square-mm MM --out {file}`"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"calibration {file} cannot be read: {error}") from None
    except ValueError as error:
        raise InputError(f"{file} is no calibration: {error}") from None


def _hash(value: object) -> str:
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]

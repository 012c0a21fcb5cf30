"""The store of a campaign: opened to go on in it, or made with the grid of its field of view or area."""

from __future__ import annotations

import os

from configs import Campaign, InputError, StoreError
from pipelines import Calibration, Grid, PatternSet
from storage import Store, create_store, open_store, store_exists

from . import __version__
from .area_plan import AreaPlan, check_reach, plan_area
from .environment import units_of
from .outputs import nearest_there
from .recipe import campaign_hash

__all__ = ["create", "grid_of", "open_existing", "plan_of", "units"]

FINEST = 10
"""Cells finer than a tenth of the camera's pixel show nothing more, and a unit forgotten would ask for billions."""
FEWEST = 8
"""So many cells or more lie across the field of view: fewer are no map."""


def units(campaign: Campaign) -> dict[str, str]:
    """Unit of each metric that a campaign keeps."""
    from pipelines.change import METRICS

    return {name: METRICS[name].unit for name in campaign.metrics} | units_of(campaign.environment)


def open_existing(campaign: Campaign) -> Store | None:
    """Open the campaign's store to go on in it; None where there is none yet.

    Raises
    ------
    InputError
        Its place is a file or cannot be written, or it has other cells than the campaign asks for.
    StoreError
        It cannot be opened, or another process writes it.
    """
    path, pitch_mm = campaign.store.path, campaign.grid.pitch_mm
    if not store_exists(path):
        _make_room(campaign)
        return None
    store = open_store(path, write=True, metrics=units(campaign))
    kept = store.about.grid
    if pitch_mm is not None and kept is not None and abs(kept.pitch_mm - pitch_mm) > 1e-9:
        store.close()
        raise InputError(
            f"grid.pitch_mm is {pitch_mm:g}, but the store {path} has cells of {kept.pitch_mm:g} mm: "
            "take the store's pitch, or give store.path another name"
        )
    return store


def _make_room(campaign: Campaign) -> None:
    """Make the folder that store, calibration and ledger lie in, before the work that ends there."""
    path, beside = campaign.store.path, campaign.store.beside.absolute()
    above = nearest_there(beside)
    if not above.is_dir():
        raise InputError(f"store.path {path}: {above} is a file, not a folder; name another place")
    try:
        beside.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"store.path {path}: the folder {beside} cannot be made: {error.strerror}; name another place"
        ) from None
    if not os.access(beside, os.W_OK):
        raise InputError(
            f"store.path {path}: this user may not write into {beside}; name another place, or give the right to write"
        )


def plan_of(campaign: Campaign, calibration: Calibration, store: Store | None) -> AreaPlan | None:
    """Plan a campaign's area, for the cells of its store where there is one; None where it follows one field of view.

    Raises
    ------
    InputError
        It is not said how the stage's axes lie, or the store is of another area.
    """
    if campaign.area is None:
        return None
    kept = store.about.grid if store is not None else None
    plan = plan_area(campaign.area, _footprint(calibration, kept.pitch_mm if kept else campaign.grid.pitch_mm))
    if kept is not None:
        check_reach(plan, kept, campaign.store.path)
    return plan


def create(campaign: Campaign, calibration: Calibration, patterns: PatternSet, text: str) -> Store:
    """Make a campaign's store.

    Raises
    ------
    InputError
        The calibration sees no grid of that pitch.
    StoreError
        It cannot be made, or another process has made it meanwhile.
    """
    plan = plan_of(campaign, calibration, None)
    grid = _footprint(calibration, campaign.grid.pitch_mm) if plan is None else plan.grid
    try:
        return create_store(
            campaign.store.path,
            site=campaign.site.name,
            grid=grid,
            campaign=text,
            campaign_hash=campaign_hash(campaign, patterns),
            metrics=units(campaign),
            software=f"microrelief {__version__}",
            kind=campaign.store.kind,
        )
    except StoreError:
        if not store_exists(campaign.store.path):
            raise
        raise StoreError(
            f"{campaign.store.path}: another process began this campaign a moment ago and writes there: "
            "end one of the two"
        ) from None


def _footprint(calibration: Calibration, pitch_mm: float | None) -> Grid:
    from pipelines.reconstruction import footprint_grid

    try:
        natural = footprint_grid(calibration, None)
    except ValueError as error:
        raise InputError(f"calibration {calibration.id}: {error}") from None
    if pitch_mm is None:
        return natural
    finest, coarsest = natural.pitch_mm / FINEST, min(natural.shape) * natural.pitch_mm / FEWEST
    if not finest <= pitch_mm <= coarsest:
        raise InputError(
            f"grid.pitch_mm is {pitch_mm:g}: a camera pixel is about {natural.pitch_mm:g} mm wide on the object, so "
            f"give {finest:g} to {coarsest:.2g} mm, or leave it out"
        )
    return footprint_grid(calibration, pitch_mm)


def grid_of(store: Store) -> Grid:
    """Give a store's grid. Raises InputError where it has none."""
    grid = store.about.grid
    if grid is None:
        raise InputError(f"{store.about.location} has no grid: give store.path another name")
    return grid

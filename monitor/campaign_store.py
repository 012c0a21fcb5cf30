"""The store of a campaign: opened to go on in it, or made with the grid of its field of view or area."""

from __future__ import annotations

from configs import Campaign, InputError
from pipelines import Calibration, Grid, PatternSet
from storage import Store, create_store, open_store, store_exists

from . import __version__
from .area_plan import AreaPlan, check_reach, plan_area
from .environment import units_of
from .recipe import campaign_hash

__all__ = ["create", "grid_of", "open_existing", "plan_of", "units"]


def units(campaign: Campaign) -> dict[str, str]:
    """Unit of each metric that a campaign keeps."""
    from pipelines.change import METRICS

    return {name: METRICS[name].unit for name in campaign.metrics} | units_of(campaign.environment)


def open_existing(campaign: Campaign) -> Store | None:
    """Open the campaign's store to go on in it; None where there is none yet.

    Raises
    ------
    InputError
        Its place is a file, or it has other cells than the campaign asks for.
    StoreError
        It cannot be opened, or another process writes it.
    """
    path, pitch_mm = campaign.store.path, campaign.grid.pitch_mm
    if not store_exists(path):
        beside = campaign.store.beside.absolute()
        above = next(folder for folder in (beside, *beside.parents) if folder.exists())
        if not above.is_dir():
            raise InputError(f"store.path {path}: {above} is a file, not a folder; name another place")
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
    """Make a campaign's store. Raises InputError where the calibration sees no grid of that pitch."""
    plan = plan_of(campaign, calibration, None)
    grid = _footprint(calibration, campaign.grid.pitch_mm) if plan is None else plan.grid
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


def _footprint(calibration: Calibration, pitch_mm: float | None) -> Grid:
    from pipelines.reconstruction import footprint_grid

    try:
        return footprint_grid(calibration, pitch_mm)
    except ValueError as error:
        raise InputError(f"calibration {calibration.id}: {error}") from None


def grid_of(store: Store) -> Grid:
    """Give a store's grid. Raises InputError where it has none."""
    grid = store.about.grid
    if grid is None:
        raise InputError(f"{store.about.location} has no grid: give store.path another name")
    return grid

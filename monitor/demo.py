"""The demo: a drying-soil campaign on the simulated rig and an accelerated clock, and how well it was measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Event as Flag

import numpy as np
import numpy.typing as npt

from configs import Campaign, InputError, read_campaign
from pipelines import Calibration, Instant, parse_instant
from pipelines.change import polygon_mask
from pipelines.scenes import Ground, Soil
from storage import Store, open_store, store_exists

from .campaign import run_campaign
from .check import load_scheduled
from .clock import AcceleratedClock
from .rigs.optics_model import Device, paper_optics
from .rigs.simulated import sample_motion
from .settled import Outcome, Settled

__all__ = ["CAMPAIGN_FILE", "Judged", "JudgedScan", "judge_store", "prepare", "run_demo"]

CAMPAIGN_FILE = "demo.yaml"
HOUR = np.timedelta64(3600 * 10**9, "ns")


@dataclass(frozen=True, slots=True)
class Judged:
    """One number of one scan: measured, its standard uncertainty, and what the simulator knows to be true."""

    metric: str
    value: float
    sigma: float
    truth: float

    @property
    def error(self) -> float:
        """Measured less true; NaN where it was not measured."""
        return self.value - self.truth


@dataclass(frozen=True, slots=True)
class JudgedScan:
    """One scan's numbers beside the truth, `elapsed_h` after its baseline.

    `covered` is the share of the region that was measured in both scans; `whole_volume_mm3` the true net volume of
    all of it, crack floors that no ray reaches included.
    """

    number: int
    elapsed_h: float
    judged: tuple[Judged, ...]
    covered: float
    whole_volume_mm3: float


def prepare(out: Path) -> Path:
    """Give the demo's campaign file in a folder; made there from the shipped one unless it is there already.

    Raises
    ------
    InputError
        The folder cannot be made or written.
    """
    file = out / CAMPAIGN_FILE
    if file.exists():
        return file
    from importlib.resources import files

    text = files("configs").joinpath(CAMPAIGN_FILE).read_text(encoding="utf-8")
    try:
        out.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror}); name another folder") from None
    return file


def run_demo(
    file: Path,
    scans: int,
    on_settled: Callable[[Settled], None] | None = None,
    on_stage: Callable[[str], None] | None = None,
    stop: Flag | None = None,
) -> Outcome | None:
    """Run the campaign until its store holds `scans` scans, by the code path of `run` with another clock.

    Returns
    -------
    Outcome or None
        None where the store holds so many already.
    """
    checked = load_scheduled(file)
    campaign = checked.campaign
    there = count_scans(campaign)
    if there >= scans:
        return None
    if campaign.start is None:
        raise InputError(f"{file}: schedule.start: the demo needs one, for its clock to start at")
    clock = AcceleratedClock(np.datetime64(campaign.start.replace(tzinfo=None), "ns"))
    return run_campaign(
        campaign,
        clock=clock,
        on_settled=on_settled,
        on_stage=on_stage,
        max_scans=scans - there,
        stop=stop,
        text=checked.text,
    )


def count_scans(campaign: Campaign) -> int:
    """Count what the campaign's store holds; 0 where there is none yet."""
    if not store_exists(campaign.store.path):
        return 0
    store = open_store(campaign.store.path)
    try:
        return len(store)
    finally:
        store.close()


def judge_store(store: Store, file: Path) -> list[JudgedScan]:
    """Lay each scan's net volume, crack opening and edge lift beside the simulator's truth.

    The truth of the volume is the closed form summed over the very cells that were measured in both scans, for that is
    what the metric claims; opening and lift are those of `pipelines.scenes.SceneTruth` over the region.

    Parameters
    ----------
    store : Store
    file : Path
        The campaign that filled it.

    Returns
    -------
    list of JudgedScan
        In the order of the scans; baselines are left out.

    Raises
    ------
    InputError
        The campaign's rig shows no soil of known age, so there is no truth to judge by.
    """
    campaign = read_campaign(file).campaign
    options = campaign.rig.options
    grid = store.about.grid
    if campaign.rig.name != "simulated" or options.get("scene", "soil") != "soil" or grid is None:
        raise InputError(
            f"{file}: rig: the demo judges by the simulated rig's soil, which this campaign does not look at"
        )
    if "started" not in options:
        raise InputError(f"{file}: rig.options.started: must be given, for the soil's age to be known")
    soil = Soil(**options.get("scene_options", {}))
    started = parse_instant(str(options["started"]), "UTC")
    pace = float(options.get("pace", 1.0))
    columns, rows = options.get("camera", (960, 720))
    calibration = store.calibration(store[0].scan.calibration_id)
    to_scene = _scene_from_site(calibration, paper_optics((int(columns), int(rows))).camera)
    x, y = np.meshgrid(grid.x_mm, grid.y_mm)
    region = np.ones(grid.shape, np.bool_)
    inset = 0.0
    if campaign.region_mm is not None:
        region = polygon_mask((campaign.region_mm,), grid)
        inset = soil.side_mm / 2 - max(abs(side) for corner in campaign.region_mm for side in corner)
    world = [to_scene[axis, 0] * x + to_scene[axis, 1] * y + to_scene[axis, 2] for axis in (0, 1)]
    drift = {name: options[name] for name in ("seed", "drift_mm") if name in options}

    def age(moment: Instant) -> float:
        return float((moment - started) / HOUR) * pace

    ground: tuple[int, Ground] | None = (
        None  # the soil under the grid's cells, as it lay at the baseline of that number
    )
    series = store.series()
    judged = []
    for number in range(len(store)):
        stored = store[number]
        if stored.change is None:
            continue
        before, after = age(stored.change.baseline_time), age(stored.scan.time)
        truth = soil.truth(before, after, pitch_mm=0.02, inset_mm=max(0.0, inset))
        if ground is None or ground[0] != stored.baseline:
            lay = sample_motion(stored.change.baseline_time, **drift)
            beside = [place - lay[axis, 3] for axis, place in enumerate(world)]
            ground = stored.baseline, soil.at(*(lay[0, axis] * beside[0] + lay[1, axis] * beside[1] for axis in (0, 1)))
        seen = np.isfinite(stored.change.dz) & region
        true_dz = (ground[1].height(after) - ground[1].height(before))[seen]
        truths = {
            "net_volume": float(true_dz.sum()) * grid.cell_mm2,
            "crack_opening": truth.crack_opening_mm,
            "edge_lift": truth.edge_lift_mm,
        }
        row = series[series["scan"] == number].iloc[0]
        numbers = tuple(
            Judged(name, float(row[name]), float(row[f"{name}_sigma"]), value)
            for name, value in truths.items()
            if name in row.index
        )
        covered = float(seen.sum() / region.sum())
        judged.append(JudgedScan(number, after - before, numbers, covered, truth.net_volume_mm3))
    return judged


def _scene_from_site(calibration: Calibration, camera: Device) -> npt.NDArray[np.float64]:
    """Lay the calibration's site frame over the scene: the turn and shift, 2x3, that fit what each pixel sees.

    The site's origin lies where the calibrated axis meets the reference, and long focal lengths leave that axis loose.
    """
    turn, shift = calibration.reference[:, :3], calibration.reference[:, 3]
    as_calibrated = Device(calibration.camera, turn.T, -turn.T @ shift, camera.focus_mm, camera.aperture)
    site, scene = (device.on_plane()[::20, ::20].reshape(-1, 2) for device in (as_calibrated, camera))
    middle_site, middle_scene = site.mean(axis=0), scene.mean(axis=0)
    u, _, vt = np.linalg.svd((scene - middle_scene).T @ (site - middle_site))  # Kabsch
    rotation = u @ np.diag([1.0, np.linalg.det(u @ vt)]) @ vt
    return np.column_stack([rotation, middle_scene - rotation @ middle_site])

"""``microrelief repeatability``: how much scans differ between which nothing changed, for levels of detection."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter

from configs import InputError
from pipelines import Comparison, Event, Tick
from storage import Store, open_store, whole_file

from .. import __version__
from ..clock import RealClock
from ..progress import progress
from ..recipe import masks_of
from ..reprocess import campaign_of
from .process import scan_number

if TYPE_CHECKING:
    from pipelines.change import NoiseModel

__all__ = ["repeatability"]

MOST_UNREST = 1.5
"""So much more may the first and last scan differ than neighbours do; at rest it is 1 within some per cent."""
MOST_SCANS = 12
"""More repeat scans than this hardly tell more, and all lie in memory at once."""


def repeatability(
    store: str,
    *,
    from_: Annotated[str | None, Parameter(name="--from")] = None,
    to: str | None = None,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
    dry_run: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Calibrate the level of detection on scans between which nothing changed.

    Says by how much such scans differ, depending on the sigma that they predict and on the slope, how far an error
    reaches, and keeps this noise model in the store. Change, metrics and alarms of later scans then rest on it;
    `microrelief process STORE` works earlier ones out anew. Stop the campaign meanwhile, or use --dry-run.

    Take five or more scans of the sample at rest, and move it or the rig by some cells and back between them: a scan
    that nobody touched repeats its errors and looks better than it is.

    Parameters
    ----------
    store
        The store's folder or address.
    from_
        First scan at rest: a number, or a time such as 2026-11-22T21:00:00Z. Without --from and --to all scans are
        used, on the stable areas of the campaign alone.
    to
        Last scan at rest, likewise.
    out
        Write the model to this .json file too.
    dry_run
        Show the model, keep nothing.

    Examples
    --------
    microrelief repeatability site.icechunk --from 0 --to 9
    """
    if out is not None and (out.suffix.lower() != ".json" or not out.parent.is_dir()):
        raise InputError(f"--out {out}: must be a .json file in a folder that is there")
    with closing(open_store(store, write=not dry_run)) as opened:
        model = _worked_out(opened, store, from_, to)
        text = model.to_json()
        if not dry_run:
            now = RealClock().now()
            note = f"levels of detection rest on noise model {model.id} from now on: {_summary(model)}"
            opened.append(Tick(now, events=(Event(now, "note", note),), noise=model))
    if out is not None:
        with whole_file(out) as file:
            file.write_text(text + "\n", encoding="utf-8")
    print("\n".join(_told(model)))
    print(f"noise model {model.id}" + ("" if dry_run else f" kept in {store}") + (f", wrote {out}" if out else ""))


def _worked_out(opened: Store, store: str, from_: str | None, to: str | None) -> NoiseModel:
    from pipelines.change import compare, noise_model, unrest

    if len(opened) < 2:
        raise InputError(f"{store}: holds {len(opened)} scans, repeatability needs two or more")
    settings = campaign_of(opened)
    zone = settings.site.zone if settings is not None else "UTC"
    grid = opened.about.grid
    assert grid is not None
    stable = masks_of(settings, grid)[0] if settings is not None else None
    given = from_ is not None or to is not None
    if not given and stable is None:
        raise InputError(
            f"{store}: its campaign names no stable areas: say between which scans nothing changed, --from N --to N"
        )
    first = scan_number(opened, from_, zone, "--from") if from_ is not None else 0
    last = scan_number(opened, to, zone, "--to") if to is not None else len(opened) - 1
    if first >= last:
        raise InputError(f"--from {from_} --to {to}: two or more scans are needed")
    chosen = np.unique(np.linspace(first, last, min(MOST_SCANS, last - first + 1)).round().astype(int))
    reference = opened[int(chosen[0])]
    repeats: list[Comparison] = []
    with progress("reading repeat scans") as step:
        for done, number in enumerate(chosen[1:], start=2):
            stored = opened[int(number)]
            if stored.scan.calibration_id != reference.scan.calibration_id:
                raise InputError(
                    f"scan {number} has another calibration than scan {chosen[0]}: give a range of one epoch"
                )
            compared = compare(stored.scan, reference.scan, stable)
            if compared.change.motion.verdict == "failed":
                print(f"scan {number} is left out: {compared.change.motion.reason}")
            else:
                repeats.append(compared)
            step(done, len(chosen))
    use: npt.NDArray[np.bool_] | None = None if given else stable
    try:
        model = noise_model(repeats, use)
    except ValueError as error:
        raise InputError(f"{store}: {error}") from None
    if (ratio := unrest(repeats, use)) > MOST_UNREST:
        print(
            f"WARNING: the first and the last scan differ {ratio:.1f} times as much as neighbours do: something "
            "changed, and the model takes that for noise. Choose scans at rest with --from and --to"
        )
    return replace(model, snapshot=opened.about.snapshot, software=f"microrelief {__version__}")


def _summary(model: NoiseModel) -> str:
    return (
        f"{model.scans} scans from {model.first} to {model.last}, {model.ground}; "
        f"sd^2 = ({1000 * model.floor_mm:.3g} um)^2 + ({model.gain:.3g} sigma)^2 + "
        f"({1000 * model.sideways_mm:.3g} um x slope)^2"
    )


def _told(model: NoiseModel) -> list[str]:
    reach = float(np.interp(-0.5, -model.correlation, np.arange(model.correlation.size))) * model.pitch_mm
    lines = [f"noise of a difference: {_summary(model)}"]
    lines.append(f"errors are half alike {reach:.3g} mm apart; registration leaves {1000 * model.sigma_z_mm:.3g} um up")
    if np.isfinite(model.false_positives):
        lines.append(f"beyond the 95 % level, in pairs not fitted to: {100 * model.false_positives:.1f} % of the cells")
    lines.append("   sigma um   slope   cells   sd um   model um   beyond %")
    lines += [
        f"{1000 * cell.sigma_mm:11.3g}{cell.slope:8.2f}{cell.count:8d}{1000 * cell.observed_mm:8.3g}"
        f"{1000 * cell.model_mm:11.3g}{100 * cell.beyond:11.1f}"
        for cell in model.cells
    ]
    return lines

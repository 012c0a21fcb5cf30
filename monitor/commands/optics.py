"""The command `optics`."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Annotated, Any

from cyclopts import Parameter

from configs import InputError
from pipelines.reconstruction import PAPER_SETUP, Figure, OpticsSetup, conflicts, work_out

__all__ = ["optics"]


def optics(
    *,
    theta_deg: Annotated[float | None, Parameter(name=["--theta-deg", "--theta"])] = None,
    working_distance_mm: float | None = None,
    lens_radius_mm: float | None = None,
    filter_mm: float | None = None,
    na: float | None = None,
    na_camera: float | None = None,
    na_projector: float | None = None,
    wavelength_nm: float | None = None,
    field_mm: str | None = None,
    depth_of_field_mm: float | None = None,
    camera: str | None = None,
    projector: str | None = None,
    chip: str | None = None,
    magnification: float | None = None,
    magnification_camera: float | None = None,
    magnification_projector: float | None = None,
    camera_pitch_um: float | None = None,
    line_um: float | None = None,
    paper: Annotated[bool, Parameter(negative="")] = False,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> None:
    """Work out what a rig can see: angles, overlap, depth per pixel, blur, diffraction; and what excludes what.

    Nothing is assumed: a figure that cannot be worked out names the inputs that it lacks.

    Parameters
    ----------
    theta_deg
        Angle between the axes of camera and projector.
    working_distance_mm
        From each lens to the object, along its axis.
    lens_radius_mm
        Outer radius of each lens.
    filter_mm
        Thickness of the filter before a lens.
    na
        Working numerical aperture of both, where --na-camera or --na-projector does not say otherwise.
    na_camera
        Working numerical aperture of the camera's lens.
    na_projector
        Working numerical aperture of the projector's lens.
    wavelength_nm
        Wavelength of the light.
    field_mm
        Field of view on the object: one number, or across x along.
    depth_of_field_mm
        Its whole extent: +-3 mm are 6.
    camera
        Camera columns x rows.
    projector
        Projector columns x rows.
    chip
        Mirror array of the projector: DLP3000 or DLP3010.
    magnification
        Of both, where --magnification-camera or --magnification-projector does not say otherwise.
    magnification_camera
        Of the camera's lens.
    magnification_projector
        Of the projector's lens.
    camera_pitch_um
        Pixel on the camera's sensor.
    line_um
        Line width to resolve.
    paper
        Take what is not given from the paper's sections 3 to 5.
    as_json
        Print JSON: inputs, figures (value, unit, formula, source, missing), conflicts.

    Examples
    --------
    microrelief optics --theta-deg 31 --working-distance-mm 100 --lens-radius-mm 20
    microrelief optics --paper --wavelength-nm 550 --json
    """
    given: dict[str, Any] = {
        "theta_deg": theta_deg,
        "working_distance_mm": working_distance_mm,
        "lens_radius_mm": lens_radius_mm,
        "filter_mm": filter_mm,
        "na_camera": na_camera if na_camera is not None else na,
        "na_projector": na_projector if na_projector is not None else na,
        "wavelength_nm": wavelength_nm,
        "field_mm": _pair("--field-mm", field_mm),
        "depth_of_field_mm": depth_of_field_mm,
        "camera": _pixels("--camera", camera),
        "projector": _pixels("--projector", projector),
        "chip": chip,
        "magnification_camera": magnification_camera if magnification_camera is not None else magnification,
        "magnification_projector": magnification_projector if magnification_projector is not None else magnification,
        "camera_pitch_um": camera_pitch_um,
        "line_um": line_um,
    }
    try:
        setup = replace(
            PAPER_SETUP if paper else OpticsSetup(),
            **{name: value for name, value in given.items() if value is not None},
        )
    except ValueError as error:
        name, _, why = str(error).partition(":")
        raise InputError(f"{_option(name)}:{why}") from None
    figures = work_out(setup)
    clashes = conflicts(setup, figures)
    if as_json:
        print(json.dumps(_as_mapping(setup, figures, clashes), indent=1))
        return
    for line in _lines(figures, clashes):
        print(line)
    if not setup.known():
        print("nothing was given: --paper takes the paper's figures, `microrelief optics --help` lists the inputs")


def _as_mapping(setup: OpticsSetup, figures: dict[str, Figure], clashes: tuple[str, ...]) -> dict[str, Any]:
    return {
        "inputs": setup.known(),
        "figures": {
            name: {
                "value": figure.value,
                "unit": figure.formula.unit,
                "about": figure.formula.about,
                "formula": figure.formula.text,
                "source": figure.formula.source,
                "missing": list(figure.missing),
            }
            for name, figure in figures.items()
        },
        "conflicts": list(clashes),
    }


def _lines(figures: dict[str, Figure], clashes: tuple[str, ...]) -> list[str]:
    lines = []
    for name, figure in figures.items():
        if figure.value is not None:
            unit = "" if figure.formula.unit == "1" else figure.formula.unit
            lines.append(f"{name:27}{figure.value:>10.4g} {unit:4}{figure.formula.text}: {figure.formula.about}")
    for name, figure in figures.items():
        if figure.value is None:
            lines.append(f"{name:27}{'-':>10}     needs {', '.join(map(_option, figure.missing))}")
    return [*lines, *(f"conflict: {clash}" for clash in clashes)]


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


def _pair(option: str, text: str | None) -> tuple[float, float] | None:
    """Read `10` or `10x8`."""
    if text is None:
        return None
    try:
        values = [float(part) for part in re.split(r"[x,]", text.strip().lower())]
    except ValueError:
        values = []
    if len(values) not in (1, 2):
        raise InputError(f"{option} {text}: give one number, or across and along such as 10x8")
    return values[0], values[-1]


def _pixels(option: str, text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"\s*(\d+)\s*[x,]\s*(\d+)\s*", text.lower())
    if not found:
        raise InputError(f"{option} {text}: give columns and rows, such as 2560x1440")
    return int(found[1]), int(found[2])

"""The command `resolution`."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter

from configs import InputError
from pipelines import Calibration
from pipelines.reconstruction import (
    ContrastCurve,
    Roi,
    StripeContrast,
    depth_of_field,
    edge_contrast,
    object_pixel_um,
    stripe_contrast,
    usaf_contrast,
)
from storage import read_capture, read_image, read_patterns

from .reconstruct import read_calibration

__all__ = ["resolution"]

LINES_UM = (200.0, 100.0, 50.0, 30.0, 20.0, 15.0, 10.0, 7.0, 5.0)


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A chart's image, and how sharp projected stripes are in the same capture."""

    path: Path
    grey: npt.NDArray[np.generic]
    stripes: tuple[StripeContrast, ...]


def resolution(
    *charts: Path,
    pixel_um: float | None = None,
    calibration: Path | None = None,
    roi: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    levels: str | None = None,
    z_mm: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    line_um: float | None = None,
    threshold: float = 0.02,
    patterns: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> None:
    """Measure contrast against line width on a chart; with several focus positions, the depth of field.

    A slanted edge is found by itself or lies in a box (--roi COLUMN,ROW,WIDTH,HEIGHT). Elements of a USAF 1951 chart
    are given by a box each (--roi 5.2:COLUMN,ROW,WIDTH,HEIGHT). Contrast is that of a sine of the same line
    width, 1 for wide lines. Captures also tell the contrast of their stripes, single and integrated over 15 px.

    Parameters
    ----------
    charts
        Images of the chart, or capture folders (their white frame); several with --z-mm.
    pixel_um
        Camera pixel on the object.
    calibration
        A calibration.json that tells the pixel instead.
    roi
        Box of the edge, or GROUP.ELEMENT: and the box of its three bars; may be given again.
    levels
        Grey of large dark and bright areas, DARK,BRIGHT (USAF only); by default those of the image.
    z_mm
        Heights at which the images were taken, such as -3,0,3.
    line_um
        Line width whose depth of field is wanted.
    threshold
        Contrast at which lines count as resolved.
    patterns
        Pattern file, where a capture does not say what was projected.
    as_json
        Print JSON.

    Examples
    --------
    microrelief resolution chart.png --pixel-um 3.9
    microrelief resolution m3.png z0.png p3.png --z-mm -3,0,3 --line-um 15 --calibration calibration.json
    microrelief resolution chart.png --pixel-um 2 --roi 4.1:300,220,90,90 --roi 5.2:520,240,44,44
    """
    if not charts:
        raise InputError("no chart: give an image or a capture folder")
    if not 0 < threshold < 1:
        raise InputError(f"--threshold {threshold}: must lie between 0 and 1")
    heights = _heights(z_mm, charts)
    if line_um is not None and heights is None:
        raise InputError("--line-um: a depth of field needs several images and --z-mm")
    rig = read_calibration(calibration) if calibration is not None else None
    pixels = [_pixel(pixel_um, rig, height) for height in heights or [0.0] * len(charts)]
    pictures = [_picture(chart, patterns) for chart in charts]
    curves = _curves(pictures, pixels, roi, _levels(levels))
    depth: dict[str, Any] | None = None
    if heights is not None and line_um is not None:
        depth = _depth(heights, curves, line_um, threshold)
    if as_json:
        print(json.dumps(_as_mapping(pictures, curves, heights, threshold, depth), indent=1))
        return
    for number, (picture, curve) in enumerate(zip(pictures, curves, strict=True)):
        where = f" at z {heights[number]:+g} mm" if heights is not None else ""
        print(f"{picture.path}{where}: {_told(curve, threshold)}")
        for line in _table(curve):
            print(line)
        for each in picture.stripes[-1:] if picture.stripes else ():
            print(
                f"  finest stripes ({each.axis}): contrast {each.single:.3f} with noise {each.noise:.3f} in a pixel, "
                f"{each.integrated:.3f} with noise {each.noise_integrated:.3f} integrated along them"
            )
    if depth is not None:
        print(depth["told"])


def _curves(
    pictures: list[Picture], pixels: list[float], roi: tuple[str, ...], levels: tuple[float, float] | None
) -> list[ContrastCurve]:
    boxes = [_box(text) for text in roi]
    bars = {element: box for element, box in boxes if element is not None}
    if bars and len(bars) < len(boxes):
        raise InputError("--roi: give boxes of USAF elements, or one box of an edge, not both or one twice")
    if not bars and len(boxes) > 1:
        raise InputError("--roi: one box of an edge is enough; USAF elements are written GROUP.ELEMENT:COLUMN,ROW,...")
    if levels is not None and not bars:
        raise InputError("--levels: an edge brings its own levels, they serve USAF elements only")
    curves = []
    for picture, pixel in zip(pictures, pixels, strict=True):
        try:
            if bars:
                curves.append(usaf_contrast(picture.grey, bars, pixel, levels))
            else:
                curves.append(edge_contrast(picture.grey, pixel, boxes[0][1] if boxes else None))
        except ValueError as error:
            raise InputError(f"{picture.path}: {error}") from None
    return curves


def _picture(path: Path, patterns: Path | None) -> Picture:
    if not path.is_dir():
        if not path.exists():
            raise InputError(f"{path}: no such image or capture folder")
        return Picture(path, read_image(path), ())
    frames = read_capture(path, read_patterns(patterns) if patterns is not None else None)
    whites = [at for at, role in enumerate(frames.patterns.roles) if role.what == "white"]
    if not whites:
        raise InputError(f"{path}: its patterns have no white frame to show the chart")
    return Picture(path, frames.stack[whites[0]], stripe_contrast(frames))


def _heights(text: str | None, charts: tuple[Path, ...]) -> list[float] | None:
    if text is None:
        if len(charts) > 1:
            raise InputError("--z-mm is missing: say at which heights the images were taken, such as --z-mm -3,0,3")
        return None
    try:
        heights = [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"--z-mm {text}: give heights with commas, such as -3,0,3") from None
    if len(heights) != len(charts):
        raise InputError(f"--z-mm {text}: {len(heights)} heights for {len(charts)} images")
    if len(set(heights)) < max(2, len(heights)) or not np.isfinite(heights).all():
        raise InputError(f"--z-mm {text}: a focus series needs two or more different heights")
    return heights


def _pixel(pixel_um: float | None, rig: Calibration | None, height: float) -> float:
    if (pixel_um is None) == (rig is None):
        raise InputError("give the camera's pixel on the object: --pixel-um or --calibration, one of them")
    if rig is not None:
        return object_pixel_um(rig, height)
    assert pixel_um is not None
    if not (np.isfinite(pixel_um) and pixel_um > 0):
        raise InputError(f"--pixel-um {pixel_um}: must be above 0")
    return pixel_um


def _box(text: str) -> tuple[tuple[int, int] | None, Roi]:
    found = re.fullmatch(r"(?:(-?\d)[.,](\d):)?(\d+),(\d+),(\d+),(\d+)", text.replace(" ", ""))
    if not found:
        raise InputError(
            f"--roi {text}: give COLUMN,ROW,WIDTH,HEIGHT, or GROUP.ELEMENT: and that, such as 5.2:90,40,60,60"
        )
    element = (int(found[1]), int(found[2])) if found[1] is not None else None
    return element, (int(found[3]), int(found[4]), int(found[5]), int(found[6]))


def _levels(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        dark, bright = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--levels {text}: give two greys, DARK,BRIGHT") from None
    return dark, bright


def _depth(heights: list[float], curves: list[ContrastCurve], line_um: float, threshold: float) -> dict[str, Any]:
    contrasts = [curve.at(line_um) for curve in curves]
    if not np.isfinite(contrasts).any():
        low, high = max(curve.line_um[-1] for curve in curves), min(curve.line_um[0] for curve in curves)
        raise InputError(f"--line-um {line_um:g}: the images tell of lines of {low:.3g} to {high:.3g} um")
    found = depth_of_field(heights, contrasts, threshold)
    about: dict[str, Any] = {"line_um": line_um, "contrast": contrasts, "low_mm": None, "high_mm": None}
    if found is None:
        return about | {"told": f"lines of {line_um:g} um: below the contrast of {threshold:g} at every height"}
    ends = f"{found.low_mm:+.2f} to {found.high_mm:+.2f} mm"
    least = found.open_low or found.open_high
    told = f"depth of field for lines of {line_um:g} um: {'at least ' if least else ''}{found.extent_mm:.2f} mm, {ends}"
    return about | {
        "low_mm": found.low_mm,
        "high_mm": found.high_mm,
        "open_low": found.open_low,
        "open_high": found.open_high,
        "told": told,
    }


def _told(curve: ContrastCurve, threshold: float) -> str:
    width = curve.resolution_um(threshold)
    if np.isnan(width):
        return f"no line of {curve.line_um[0]:.3g} um or less has a contrast of {threshold:g}"
    if not curve.reaches(threshold):
        limit = "one pixel" if width == curve.pixel_um else "the narrowest that was measured"
        return f"resolves {width:.3g} um, {limit}: the contrast is above {threshold:g} there"
    return f"resolves lines of {width:.3g} um (+-{curve.uncertainty_um(threshold):.2g}) at contrast {threshold:g}"


def _table(curve: ContrastCurve) -> list[str]:
    widths = curve.line_um if len(curve.line_um) <= 30 else [w for w in LINES_UM if np.isfinite(curve.at(w))]
    rows = [(float(w), curve.at(float(w)), float(np.interp(1 / w, 1 / curve.line_um, curve.noise))) for w in widths]
    return [f"  {width:8.2f} um  contrast {contrast:6.3f} +-{noise:.3f}" for width, contrast, noise in rows]


def _as_mapping(
    pictures: list[Picture],
    curves: list[ContrastCurve],
    heights: list[float] | None,
    threshold: float,
    depth: dict[str, Any] | None,
) -> dict[str, Any]:
    charts = []
    for number, (picture, curve) in enumerate(zip(pictures, curves, strict=True)):
        width, uncertainty = curve.resolution_um(threshold), curve.uncertainty_um(threshold)
        charts.append(
            {
                "chart": str(picture.path),
                "z_mm": heights[number] if heights is not None else None,
                "resolution_um": width if np.isfinite(width) else None,
                "uncertainty_um": uncertainty if np.isfinite(uncertainty) else None,
                "threshold_reached": curve.reaches(threshold),
                "pixel_um": curve.pixel_um,
                "roi": list(curve.roi),
                "tilt_deg": curve.tilt_deg,
                "line_um": curve.line_um.tolist(),
                "contrast": curve.contrast.tolist(),
                "noise": curve.noise.tolist(),
                "stripes": [
                    {name: getattr(each, name) for name in StripeContrast.__slots__} for each in picture.stripes
                ],
            }
        )
    return {"threshold": threshold, "charts": charts, "depth_of_field": depth}

"""``microrelief diagnose``: what is wrong with a capture, and how to mend it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter

from configs import InputError
from pipelines import PatternSet
from pipelines.reconstruction import Diagnosis, diagnose_stack, reconstruct
from storage import read_capture, read_image, read_patterns

from .reconstruct import read_calibration

__all__ = ["diagnose"]

EXIT_CODES = {"fine": 0, "flag": 4, "reject": 1}
VERDICTS = {"fine": "fine", "flag": "usable with care", "reject": "take it again"}
LEAST_MEASURED = 0.1
"""Share of the camera's pixels that a calibration must give a height to fit the capture."""
IMAGES = (".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg")


def diagnose(
    capture: Path,
    *,
    patterns: Path | None = None,
    calibration: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative="")] = False,
) -> int:
    """Say what is wrong with a capture, and how to mend it.

    Exit code 0: fine; 4: usable with care; 1: take it again. `microrelief run` rejects or notes scans by the same
    verdict.

    Parameters
    ----------
    capture
        The capture folder.
    patterns
        Pattern file, where the capture does not say what was projected.
    calibration
        The calibration.json of the rig: heights must come out for at least a tenth of the pixels.
    as_json
        Print JSON: verdict and findings, each with cause, severity, frames, value, limit, measure, text and advice.

    Examples
    --------
    microrelief diagnose captures/0001
    microrelief diagnose captures/0001 --patterns patterns.yaml --json
    """
    named = read_patterns(patterns) if patterns is not None else None
    rig = read_calibration(calibration) if calibration is not None else None
    measured = None
    try:
        frames = read_capture(capture, named)
    except InputError as error:
        loose = _loose_frames(capture, named)
        if loose is None:
            raise error
        found = diagnose_stack(*loose)
        if not found.findings:
            raise error
    else:
        found = diagnose_stack(frames.stack, frames.patterns)
        if rig is not None and found.verdict != "reject":
            try:
                measured = float(reconstruct(frames, rig).valid.mean())
            except ValueError as error:
                raise InputError(f"{capture}: {error}") from error
    unfit = measured is not None and measured < LEAST_MEASURED
    if as_json:
        print(json.dumps(_mapping(found, measured), indent=1))
    else:
        print(f"{capture}: {'take it again' if unfit else VERDICTS[found.verdict]}")
        for finding in found.findings:
            print(f"  {finding.severity}: {finding.line}: {finding.advice}")
            if finding.frames:
                print(f"    frames {', '.join(finding.frames)}")
        if measured is not None:
            hint = "; is it of this rig, and of how it stands now?" if unfit else ""
            print(f"  the calibration gives {100 * measured:.1f} % of the pixels a place{hint}")
    return 1 if unfit else EXIT_CODES[found.verdict]


def _mapping(found: Diagnosis, measured: float | None) -> dict[str, Any]:
    findings = [
        {
            "cause": each.cause,
            "severity": each.severity,
            "frames": list(each.frames),
            "value": each.value,
            "limit": each.limit,
            "measure": each.measure,
            "text": each.text,
            "advice": each.advice,
        }
        for each in found.findings
    ]
    return {"verdict": found.verdict, "findings": findings, "measured_share": measured}


def _loose_frames(folder: Path, patterns: PatternSet | None) -> tuple[npt.NDArray[Any], PatternSet] | None:
    """Read images that make no capture, in natural order: too few, too many, or in another order than the set's."""
    if not folder.is_dir():
        return None
    if patterns is None:
        patterns = _patterns_near(folder)
    files = sorted((file for file in folder.iterdir() if file.suffix.lower() in IMAGES), key=_natural)
    if patterns is None or len(files) < 4:
        return None
    images = [read_image(file) for file in files]
    if len({(image.shape, image.dtype) for image in images}) > 1 or images[0].dtype not in (np.uint8, np.uint16):
        return None
    return np.stack(images), patterns


def _patterns_near(folder: Path) -> PatternSet | None:
    about = folder / "capture.json"
    try:
        if about.is_file():
            return PatternSet.from_mapping(json.loads(about.read_text(encoding="utf-8"))["patterns"])
        near = [place / "patterns.yaml" for place in (folder, folder.resolve().parent)]
        return next((read_patterns(file) for file in near if file.is_file()), None)
    except (OSError, ValueError, KeyError, TypeError):
        return None  # what is wrong with it has been said


def _natural(file: Path) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", file.name)]

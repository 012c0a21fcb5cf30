"""What is wrong with a capture, which frames show it, and how to mend it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt
from typing import Literal

import numpy as np
import numpy.typing as npt

from .diagnose_light import LightFigures, light_figures
from .diagnose_motion import image_motion
from .diagnose_order import OrderFault, find_order_faults, pairs_of
from .diagnose_sample import LIT_SDS, Sample, take_sample
from .frames import Frames
from .patterns import PatternSet

__all__ = ["CAUSES", "Cause", "Diagnosis", "Finding", "diagnose", "diagnose_stack"]

Severity = Literal["note", "flag", "reject"]
SEVERITIES: tuple[Severity, ...] = ("note", "flag", "reject")


@dataclass(frozen=True, slots=True)
class Cause:
    """A fault that a capture may have: what it is called, how it is found, what to do about it."""

    title: str
    found_by: str
    advice: str


CAUSES: Mapping[str, Cause] = {
    "missing": Cause(
        "frame missing",
        "too few frames, a dark one, or all later ones pair up again when each moves by one",
        "take it again; wait for each frame before the next pattern, and check the camera's dropped-frame counter",
    ),
    "repeated": Cause(
        "repeated frame",
        "a frame shows what another one shows, or there is one too many",
        "take it again; empty the camera's buffer before each trigger and give the display time to change",
    ),
    "shifted": Cause(
        "sequence off by one",
        "every frame pairs up, and white and black are found, one place beside",
        "start the camera and the patterns on the same trigger; throw away the frame that the camera held back",
    ),
    "pair": Cause(
        "swapped pair",
        "the sign of a pattern at the edges of coarser ones, or words that the set does not have",
        "check the order of pattern and inverse in the projector and in the file names",
    ),
    "swapped": Cause(
        "two frames swapped",
        "two frames pair up only in each other's places",
        "check the file names and the order in which the frames were stored",
    ),
    "saturated": Cause(
        "saturation",
        "share of the bright pixels at the count where the camera clips",
        "shorten the exposure, lower the gain or the projector's light, or close the iris",
    ),
    "dark": Cause(
        "underexposure",
        "white less black of the brightest tenth of the image, in standard deviations of its noise",
        "lengthen the exposure, open the iris, raise the projector's light; is the lens cap off and the lamp on?",
    ),
    "flicker": Cause(
        "light flicker",
        "light of a pattern against its inverse, of white against the median, from sums of pairs",
        "let the lamp warm up; make the exposure a whole number of periods of mains (10 or 8.33 ms) and of projector",
    ),
    "ambient": Cause(
        "ambient drift",
        "dark level of each frame, read where its pattern is black",
        "shield the sample from lamps and windows, or raise the projector's light against the room's",
    ),
    "moved": Cause(
        "movement during the capture",
        "where the mean of each pattern and its inverse lies beside that of white and black",
        "let vibrations settle before the capture, fix the sample and the camera, shorten the sequence",
    ),
    "defocus": Cause(
        "out of focus",
        "share of the image where the decoder is not certain of the finest stripes",
        "bring the object into the depth of field, refocus, or project coarser patterns",
    ),
    "patterns": Cause(
        "wrong pattern set",
        "signs at the edges of coarser stripes, and words that the set does not have",
        "name the set that was projected with --patterns, or correct the pattern file",
    ),
    "interrupted": Cause(
        "interrupted exposure",
        "share of a neighbouring pattern in a frame, by least squares against its inverse",
        "end each exposure before the pattern changes: shorten it, or delay the pattern; check the trigger's edge",
    ),
}
"""Every cause that `diagnose` names, by its id."""

SATURATED_FLAG, SATURATED_REJECT = 0.02, 0.5
"""Share of the bright pixels; glints stay below the one, and above the other less than half can be measured."""
SUBPIXEL_SNR = sqrt(2) / (0.289 / 4)
"""White less black over noise at which an edge 1 px wide is placed four times better than whole px are (20)."""
EDGE_SHIFT_SNR = 2 * sqrt(2)
"""Over the snr: difference of light that moves an edge (a quarter of its 2 px) by its own noise, sqrt(2)/snr px."""
LIGHT_LEAST = 0.05
"""No smaller difference of light within a pair is told: 4.4 standard deviations of a lamp that flickers by 0.8 %."""
LEVEL_DRIFT = 0.2
"""Dark level that stripes wide enough to read may have from blur (0.1), and the decoder's least swing (0.1)."""
HALF_LIGHT = 0.5
"""A frame with less light than this is rejected; so is a dark level above it."""
MIXED_FLAG, MIXED_REJECT = 0.1, 0.25
"""Of an exposure: the decoder's least swing (less passes for flicker); an edge moves by a quarter of its width."""
MOVED_FLAG_PX, MOVED_REJECT_PX = 0.2, 1.0
"""Camera px. Sub-pixel places are good to about 0.1; above one, pattern and inverse do not belong to one pixel."""
MOVED_SDS = 5
LIKE_MOVED = ("pair", "patterns")
"""What a movement by more than a stripe looks like to the code; a fault of the order moves no image."""
BLURRED_TILES = 0.5
"""Share of the image's tiles in which half of the pixels have lost a pattern."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong with a capture.

    Parameters
    ----------
    cause : str
        Key of `CAUSES`.
    severity : {"note", "flag", "reject"}
        A flag: usable with care. Reject: heights would be wrong.
    frames : tuple of str
        Names of the frames concerned, as in `FrameRole.name`; empty where it is all of them or cannot be told.
    value, limit : float
        What was measured, and the limit that it passed.
    measure : str
        What the two are.
    text : str
        The finding in words.
    """

    cause: str
    severity: Severity
    frames: tuple[str, ...]
    value: float
    limit: float
    measure: str
    text: str

    @property
    def title(self) -> str:
        """The cause in words."""
        return CAUSES[self.cause].title

    @property
    def advice(self) -> str:
        """What to do about it."""
        return CAUSES[self.cause].advice

    @property
    def line(self) -> str:
        """One line: cause, words, figure against limit."""
        return f"{self.title}: {self.text} ({self.measure} {self.value:.3g}, limit {self.limit:.3g})"


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What was found wrong with a capture, the worst first; nothing where it is fine."""

    findings: tuple[Finding, ...] = ()

    @property
    def verdict(self) -> Literal["fine", "flag", "reject"]:
        """The worst of the findings; notes are fine."""
        severities = {finding.severity for finding in self.findings}
        return "reject" if "reject" in severities else "flag" if "flag" in severities else "fine"

    @property
    def causes(self) -> tuple[str, ...]:
        """Ids of what was found, the worst first."""
        return tuple(finding.cause for finding in self.findings)


def diagnose(frames: Frames) -> Diagnosis:
    """Say what is wrong with a capture.

    Looks at tiles of pixels from all over the image. The limits follow from the capture's own noise and from what the
    decoder needs. Of a capture whose frames are not in order only that, its exposure and saturation are told:
    the rest would be an echo.

    Parameters
    ----------
    frames : Frames

    Returns
    -------
    Diagnosis
    """
    return diagnose_stack(frames.stack, frames.patterns)


def diagnose_stack(stack: npt.NDArray[np.uint8] | npt.NDArray[np.uint16], patterns: PatternSet) -> Diagnosis:
    """Diagnose frames of which there may be too few or too many.

    Parameters
    ----------
    stack : ndarray of uint8 or uint16, shape (frame, row, column)
    patterns : PatternSet

    Returns
    -------
    Diagnosis
    """
    if stack.ndim != 3 or not stack.size or stack.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"frames must be (frame, row, column) in uint8 or uint16, not {stack.dtype} {stack.shape}")
    sample = take_sample(stack, patterns)
    findings = [*_saturated(sample)]
    snr = sample.strong / sample.noise
    if snr < LIT_SDS and not findings:
        return Diagnosis((_too_dark(sample, snr, LIT_SDS, "reject"),))
    faults = find_order_faults(sample) if sample.lit.any() else ()
    moved = _moved(sample) if sample.lit.any() and all(fault.cause in LIKE_MOVED for fault in faults) else []
    far = any(finding.severity == "reject" for finding in moved)
    if faults and not far:
        findings += [_of_order(sample, fault) for fault in faults]
    elif sample.lit.any():
        figures = light_figures(sample)
        light = [] if far else _light(sample, figures)  # light levels echo a movement
        if figures.snr < SUBPIXEL_SNR and not (light or far):
            light = [_too_dark(sample, figures.snr, SUBPIXEL_SNR, "flag")]
        findings += [*light, *moved, *_blurred(figures)]
    return Diagnosis(tuple(sorted(findings, key=lambda finding: -SEVERITIES.index(finding.severity))))


def _of_order(sample: Sample, fault: OrderFault) -> Finding:
    roles = sample.roles
    names = tuple(roles[n].name if n < len(roles) else f"frame {n}" for n in fault.slots)
    every = len(names) == len(roles)
    return Finding(fault.cause, "reject", () if every else names, fault.value, fault.limit, fault.measure, fault.told)


def _names(sample: Sample, frames: npt.ArrayLike) -> tuple[str, ...]:
    return tuple(sample.roles[int(n)].name for n in np.atleast_1d(np.asarray(frames)))


def _saturated(sample: Sample) -> list[Finding]:
    place = [n for n, role in enumerate(sample.roles) if role.what == "white" and n < len(sample.tiles)]
    share = float(np.median(np.sort(sample.saturated)[-max(3, len(sample.tiles) // 3) :]))  # stripes clip where white
    if place:
        share = max(share, float(sample.saturated[place[0]]))
    if share <= SATURATED_FLAG:
        return []
    severity: Severity = "reject" if share > SATURATED_REJECT else "flag"
    limit = SATURATED_REJECT if severity == "reject" else SATURATED_FLAG
    text = f"{100 * share:.0f} % of the bright pixels are at {sample.top:g}, where the camera clips"
    return [Finding("saturated", severity, (), share, limit, "share of bright pixels", text)]


def _too_dark(sample: Sample, snr: float, limit: float, severity: Severity) -> Finding:
    text = f"white is {sample.strong:.3g} counts above black in the brightest tenth, the ratio to its noise {snr:.2g}"
    return Finding("dark", severity, (), snr, limit, "white less black over noise", text)


def _light(sample: Sample, figures: LightFigures) -> list[Finding]:
    findings = []
    limit = max(LIGHT_LEAST, EDGE_SHIFT_SNR / figures.snr)
    mixed = np.nan_to_num(figures.mixed, nan=0.0)
    light, ambient = figures.light, figures.ambient
    pairs = [(p, n) for _, _, p, n in pairs_of(sample.patterns) if n >= 0]
    least = max(MIXED_FLAG, limit)
    if mixed.max(initial=0.0) > least:
        worst, frames = float(mixed.max()), np.flatnonzero(mixed > limit)
        severity: Severity = "reject" if worst > MIXED_REJECT else "flag"
        text = f"{100 * worst:.0f} % of the light of {_some(sample, frames, mixed)} belongs to the pattern beside it"
        findings.append(
            Finding("interrupted", severity, _names(sample, frames), worst, least, "share of another pattern", text)
        )
        return findings  # light levels echo it
    dark_steps = np.array([abs(ambient[p] - ambient[n]) for p, n in pairs] or [0.0])
    drift = float(np.nanmax(ambient) - np.nanmin(ambient)) if np.isfinite(ambient).any() else 0.0
    step = float(np.nanmax(dark_steps)) if np.isfinite(dark_steps).any() else 0.0
    count = 1 / max(1.0, float(np.median(sample.swing[sample.lit])))  # medians of whole counts come in such steps
    step, drift = step - count, drift - count
    if step > limit or drift > LEVEL_DRIFT:
        value, bound = (step, limit) if step > limit else (drift, LEVEL_DRIFT)
        measure = "dark level, pattern less inverse" if step > limit else "dark level, highest less lowest"
        severity = "reject" if max(step, drift) > HALF_LIGHT else "flag"
        text = f"the room's light changed by {100 * max(step, drift):.0f} % of white less black"
        findings.append(Finding("ambient", severity, (), value, bound, measure, text))
        return findings
    odd = np.abs(light - 1)
    for p, n in pairs:  # what pattern and inverse share does not move an edge
        if not abs(light[p] - light[n]) > limit:
            odd[[p, n]] = np.where(odd[[p, n]] > LEVEL_DRIFT, odd[[p, n]], 0)
        else:
            odd[n if odd[p] > odd[n] else p] = 0
    odd = np.nan_to_num(odd, nan=0.0)
    if odd.max(initial=0.0) > limit:
        frames, worst = np.flatnonzero(odd > limit), float(odd.max())
        severity = "reject" if worst > HALF_LIGHT else "flag"
        text = f"the light of {_some(sample, frames, odd)} is {100 * worst:.0f} % beside that of the others"
        findings.append(Finding("flicker", severity, _names(sample, frames), worst, limit, "share of the light", text))
    return findings


def _some(sample: Sample, frames: npt.NDArray[np.int64], size: npt.NDArray[np.float64]) -> str:
    first = sample.roles[int(frames[np.argmax(size[frames])])].name
    return first if len(frames) == 1 else f"{first} and {len(frames) - 1} more"


def _moved(sample: Sample) -> list[Finding]:
    motion = image_motion(sample)
    if not motion.frames:
        return []
    places = np.concatenate([motion.shift_px, np.zeros((1, 2))])
    size = np.hypot(*(places - np.median(places, axis=0)).T)[:-1]
    reach = float(np.hypot(*(places[:, np.newaxis] - places).transpose(2, 0, 1)).max())
    limit = max(MOVED_FLAG_PX, MOVED_SDS * float(np.median(motion.sigma_px)))
    if reach <= limit:
        return []
    frames = [n for group, far in zip(motion.frames, size, strict=True) if far > limit / 2 for n in group]
    severity: Severity = "reject" if reach > MOVED_REJECT_PX else "flag"
    bound = MOVED_REJECT_PX if severity == "reject" else limit
    text = f"the image moved by {reach:.2g} camera px while the frames were taken"
    return [Finding("moved", severity, _names(sample, frames), reach, bound, "px", text)]


def _blurred(figures: LightFigures) -> list[Finding]:
    findings = []
    for axis, finest, coarser in figures.blurred:
        if finest <= BLURRED_TILES:
            continue
        severity: Severity = "reject" if coarser > BLURRED_TILES else "flag"
        share = coarser if severity == "reject" else finest
        what = "even stripes four times as wide as the finest" if severity == "reject" else "the finest stripes"
        text = f"{what} along {axis} are lost in {100 * share:.0f} % of the image"
        findings.append(Finding("defocus", severity, (), share, BLURRED_TILES, "share of the image", text))
    return findings

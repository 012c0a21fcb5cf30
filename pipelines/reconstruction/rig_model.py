"""Calibration: two lenses, the pose between them, and the plane that heights are measured from."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["BoardCheck", "Calibration", "CornerResidual", "Lens", "PoseResidual"]

Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """A pinhole with Brown's distortion (OpenCV's model), or its limit for far away: an affine (telecentric) lens.

    Parameters
    ----------
    size : (int, int)
        Columns, rows.
    K : ndarray of float64, shape (3, 3)
        px; px per mm in its first two columns where the lens is affine. ``K[0, 0]`` is negative where the optics mirror
        the image.
    dist : ndarray of float64, shape (5,)
        k1 k2 p1 p2 k3.
    model : {"pinhole", "affine"}
        What is distorted and scaled to pixels: x/z and y/z of a point in the device's frame, or its x and y in mm. All
        rays of an affine lens run along z.
    """

    size: tuple[int, int]
    K: Matrix
    dist: Matrix
    model: Literal["pinhole", "affine"] = "pinhole"

    def __post_init__(self) -> None:
        if self.K.shape != (3, 3) or self.dist.shape != (5,):
            raise ValueError(f"a lens has a 3x3 K and 5 distortion terms, not {self.K.shape} and {self.dist.shape}")

    @property
    def parallel(self) -> bool:
        """Whether the lens is affine: its rays are parallel."""
        return self.model == "affine"

    @property
    def mirrored(self) -> bool:
        """Whether the optics mirror the image."""
        return bool(self.K[0, 0] < 0)


class CornerResidual(NamedTuple):
    """One corner: where camera and projector see it, by how much that misses the fit (seen less fitted), px."""

    column: float
    row: float
    off_column: float
    off_row: float
    projector_column: float | None
    projector_row: float | None
    projector_off_column: float | None
    projector_off_row: float | None
    used: bool


@dataclass(frozen=True, slots=True)
class PoseResidual:
    """How well one board pose fits: rms in px of camera and projector, corners kept of corners found.

    `rejected` names the corners that were left out by where they are in the camera's image, (column, row) px.
    `advice` is empty for a pose that counts; a bad pose is left out as a whole, and `advice` says why and what to do.
    """

    name: str
    camera_px: float
    projector_px: float
    kept: int
    found: int
    rejected: tuple[tuple[float, float], ...] = ()
    advice: str = ""
    corners: tuple[CornerResidual, ...] = ()


@dataclass(frozen=True, slots=True)
class BoardCheck:
    """A board measured in 3D: robust sd of its corners about a plane; mean and sd of its squares' sides; mm."""

    name: str
    flatness_mm: float
    square_mm: float
    square_sd_mm: float
    squares: int


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A calibrated rig.

    Parameters
    ----------
    camera, projector : Lens
    R : ndarray of float64, shape (3, 3)
    t_mm : ndarray of float64, shape (3,)
        Camera to projector: ``x_p = R x_c + t``.
    reference : ndarray of float64, shape (3, 4)
        Camera frame to site frame: ``x_s = reference[:, :3] x_c + reference[:, 3]``, mm.
    rms_px : mapping
        ``camera``, ``projector``, ``stereo``: root mean square reprojection error in OpenCV's definition.
    poses : tuple of PoseResidual
    board : mapping
        ``inner_corners`` [columns, rows] and ``square_mm``.
    software : str
        Name and version of what made it.
    sigma : mapping, optional
        Standard uncertainties: ``camera`` and ``projector`` (px, and none for the distortion), ``turn_deg`` and
        ``t_mm`` of the pose between them, ``poses``; ``weak`` names what the corners leave open; ``field`` says what
        all of it together does to a height map; see `parameter_sigma`.
    squares : tuple of BoardCheck
        Each board measured with this calibration in its own pose.
    held_out : tuple of BoardCheck
        Each board measured with a calibration from all other poses; empty for fewer than 4 poses.
    notes : tuple of str
        What the corners could not tell, and had to be assumed, in words.
    """

    camera: Lens
    projector: Lens
    R: Matrix
    t_mm: Matrix
    reference: Matrix
    rms_px: Mapping[str, float]
    poses: tuple[PoseResidual, ...] = ()
    board: Mapping[str, Any] | None = None
    software: str = ""
    sigma: Mapping[str, Any] | None = None
    squares: tuple[BoardCheck, ...] = ()
    held_out: tuple[BoardCheck, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.R.shape != (3, 3) or self.t_mm.shape != (3,) or self.reference.shape != (3, 4):
            raise ValueError("a calibration has a 3x3 R, 3 numbers t_mm and a 3x4 reference")

    @property
    def id(self) -> str:
        """Hash of the numbers that place points: the same ones give the same id, whoever computed them and when."""
        everything = self.as_mapping()
        numbers = {key: everything[key] for key in ("camera", "projector", "R", "t_mm", "reference", "board")}
        text = json.dumps(numbers, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def as_mapping(self) -> dict[str, Any]:
        """What ``calibration.json`` holds, less the id."""
        return {
            "camera": _lens_mapping(self.camera),
            "projector": _lens_mapping(self.projector),
            "R": self.R.tolist(),
            "t_mm": self.t_mm.tolist(),
            "reference": self.reference.tolist(),
            "rms_px": {name: float(value) for name, value in self.rms_px.items()},
            "poses": [
                {
                    "name": pose.name,
                    "camera_px": pose.camera_px,
                    "projector_px": pose.projector_px,
                    "kept": pose.kept,
                    "found": pose.found,
                    "rejected": [list(corner) for corner in pose.rejected],
                    "advice": pose.advice,
                    "corners": [list(corner) for corner in pose.corners],
                }
                for pose in self.poses
            ],
            "sigma": dict(self.sigma) if self.sigma is not None else None,
            "squares": [asdict(check) for check in self.squares],
            "held_out": [asdict(check) for check in self.held_out],
            "notes": list(self.notes),
            "board": dict(self.board) if self.board is not None else None,
            "software": self.software,
        }

    def to_json(self) -> str:
        """The text of ``calibration.json``."""
        text = json.dumps({"id": self.id, **self.as_mapping()}, indent=1, allow_nan=False)
        return re.sub(r"\[[^][{}\"]*\]", lambda numbers: " ".join(numbers[0].split()), text)  # a row of numbers, a line

    @staticmethod
    def from_json(text: str) -> Calibration:
        """Read the text of ``calibration.json``.

        Raises
        ------
        ValueError
            If the text is no calibration, or a key is missing or holds what it cannot; the message names the key.
        """
        from .rig_json import read_rig

        return read_rig(text)


def _lens_mapping(lens: Lens) -> dict[str, Any]:
    model = {"model": lens.model} if lens.parallel else {}  # a file without it tells of a pinhole, as it always did
    return {**model, "size": list(lens.size), "K": lens.K.tolist(), "dist": lens.dist.tolist()}

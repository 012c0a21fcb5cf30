"""Calibration: two lenses, the pose between them, and the plane that heights are measured from."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["BoardCheck", "Calibration", "CornerResidual", "Lens", "PoseResidual"]

Matrix = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """A pinhole with Brown's distortion (OpenCV's model).

    Parameters
    ----------
    size : (int, int)
        Columns, rows.
    K : ndarray of float64, shape (3, 3)
        px. ``K[0, 0]`` is negative where the optics mirror the image.
    dist : ndarray of float64, shape (5,)
        k1 k2 p1 p2 k3.
    """

    size: tuple[int, int]
    K: Matrix
    dist: Matrix

    def __post_init__(self) -> None:
        if self.K.shape != (3, 3) or self.dist.shape != (5,):
            raise ValueError(f"a lens has a 3x3 K and 5 distortion terms, not {self.K.shape} and {self.dist.shape}")

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
            If the text is no calibration, or a key is missing; the message names it.
        """
        try:
            data = json.loads(text)
        except json.JSONDecodeError as error:
            raise ValueError(f"not JSON: {error}") from None
        try:
            return Calibration(
                camera=_lens(data["camera"]),
                projector=_lens(data["projector"]),
                R=np.array(data["R"], dtype=np.float64),
                t_mm=np.array(data["t_mm"], dtype=np.float64),
                reference=np.array(data["reference"], dtype=np.float64),
                rms_px=data["rms_px"],
                poses=tuple(_pose(pose) for pose in data.get("poses", ())),
                board=data.get("board"),
                software=data.get("software", ""),
                sigma=data.get("sigma"),
                squares=tuple(BoardCheck(**check) for check in data.get("squares", ())),
                held_out=tuple(BoardCheck(**check) for check in data.get("held_out", ())),
            )
        except KeyError as error:
            raise ValueError(f"calibration lacks {error.args[0]!r}") from None
        except TypeError as error:
            raise ValueError(f"not a calibration: {error}") from None


def _lens_mapping(lens: Lens) -> dict[str, Any]:
    return {"size": list(lens.size), "K": lens.K.tolist(), "dist": lens.dist.tolist()}


def _pose(data: Mapping[str, Any]) -> PoseResidual:
    rejected = tuple((float(column), float(row)) for column, row in data.get("rejected", ()))
    corners = tuple(CornerResidual(*corner) for corner in data.get("corners", ()))
    return PoseResidual(**{**data, "rejected": rejected, "corners": corners})


def _lens(data: Mapping[str, Any]) -> Lens:
    columns, rows = data["size"]
    return Lens((int(columns), int(rows)), np.array(data["K"], dtype=np.float64), np.array(data["dist"], np.float64))

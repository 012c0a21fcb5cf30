"""The simulated rig's calibration as the rig is built: for tests in which calibrating is not the matter."""

from __future__ import annotations

import numpy as np

from monitor.rigs.optics_model import paper_optics
from pipelines import Calibration

__all__ = ["exact_calibration"]


def exact_calibration(camera_size: tuple[int, int]) -> Calibration:
    """Give it with the scene's frame as its site frame."""
    optics = paper_optics(camera_size)
    camera, projector = optics.camera, optics.projector
    turn = projector.R @ camera.R.T
    site = np.c_[camera.R.T, -camera.R.T @ camera.t_mm]
    return Calibration(camera.lens, projector.lens, turn, projector.t_mm - turn @ camera.t_mm, site, {"stereo": 0.1})

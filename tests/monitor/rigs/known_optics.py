"""The simulated rig's optics themselves as a calibration: what is left is decoding's error, and no calibration's."""

from __future__ import annotations

from functools import cache

import numpy as np

from monitor.rigs.optics_model import paper_optics
from pipelines import Calibration


@cache
def known_geometry(camera_size: tuple[int, int]) -> Calibration:
    """The site frame is the scene's."""
    optics = paper_optics(camera_size)
    camera, projector = optics.camera, optics.projector
    turn = projector.R @ camera.R.T
    to_scene = np.column_stack([camera.R.T, camera.centre_mm])
    return Calibration(
        camera.lens, projector.lens, turn, projector.t_mm - turn @ camera.t_mm, to_scene, {"stereo": 0.0}
    )

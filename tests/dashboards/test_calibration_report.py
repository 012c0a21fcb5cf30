"""The calibration's page: whole, offline, and empty nowhere."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree

import numpy as np

from dashboards import calibration_page
from pipelines import Calibration
from pipelines.reconstruction import BoardCheck, CornerResidual, Lens, PoseResidual


@cache
def rig() -> Calibration:
    lens = Lens((640, 480), np.array([[1000.0, 0, 320], [0, 1000, 240], [0, 0, 1]]), np.zeros(5))
    corners = tuple(
        CornerResidual(100.0 + 40 * n, 90.0 + 30 * n, 0.1, -0.2, 50.0 + 20 * n, 70.0, 0.1, 0.1, n != 3)
        for n in range(6)
    )
    lost = CornerResidual(300.0, 200.0, 0.1, 0.1, None, None, None, None, False)
    return Calibration(
        camera=lens,
        projector=replace(lens, size=(608, 684)),
        R=np.eye(3),
        t_mm=np.array([20.0, 0, 0]),
        reference=np.eye(3, 4),
        rms_px={"camera": 0.1, "projector": 0.2, "stereo": 0.16},
        poses=(
            PoseResidual("flat <1>", 0.1, 0.2, 5, 6, ((220.0, 180.0),), corners=corners),
            PoseResidual("tilted", 0.3, 9.0, 0, 7, advice="it does not fit the others", corners=(*corners, lost)),
        ),
        board={"inner_corners": [3, 3], "square_mm": 1.0},
        sigma={
            "camera": dict.fromkeys(("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"), 0.5),
            "projector": dict.fromkeys(("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"), 0.25),
            "turn_deg": [0.1, 0.1, 0.1],
            "t_mm": [0.01, 0.02, 0.03],
            "poses": [],
            "weak": ["camera: principal point known to ±9, 8 px"],
            "field": {
                "height_scale_percent": 0.03,
                "lateral_scale_percent": 0.002,
                "bow_um": 0.42,
                "bow_image_um": 1.7,
            },
        },
        squares=(BoardCheck("flat <1>", 0.0003, 1.0001, 0.002, 12),),
        held_out=(BoardCheck("flat <1>", 0.0004, 1.0002, 0.003, 12),),
    )


def test_the_page_says_what_is_known() -> None:
    page = calibration_page(rig())
    for words in (
        "stereo rms 0.160 px: good",
        "bad pose tilted, left out: it does not fit the others",
        "flat &lt;1&gt;",
        "5 of 6",
        "principal point known to ±9, 8 px",
        "0.42 um",
        "1.0002",
        rig().id,
    ):
        assert words in page, words
    assert "<1>" not in page


def test_the_page_needs_nothing_else() -> None:
    page = calibration_page(rig())
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert "<script" not in page


def test_pictures_show_every_corner() -> None:
    pictures = [
        ElementTree.fromstring(text) for text in re.findall(r"<svg.*?</svg>", calibration_page(rig()), re.DOTALL)
    ]
    space = "{http://www.w3.org/2000/svg}"
    assert len(pictures) == 4  # two poses, two coverages
    kinds = [[child.tag.removeprefix(space) for child in picture] for picture in pictures]
    assert kinds[0].count("circle") == 5
    assert kinds[0].count("path") == 6  # five arrows and a cross
    assert kinds[1].count("path") == 7
    assert kinds[2].count("circle") == kinds[3].count("circle") == 10


def test_a_calibration_from_before_has_a_page_too() -> None:
    old = replace(rig(), sigma=None, squares=(), held_out=(), poses=(PoseResidual("flat", 0.1, 0.2, 5, 6),))
    page = calibration_page(old)
    assert "keeps no residuals of its corners" in page
    assert "Not kept with this calibration" in page

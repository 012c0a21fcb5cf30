"""``calibration.json`` edited by hand: each mistake is one line that names the key."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.cli import run_tokens
from pipelines.reconstruction import BoardCheck, Calibration, CornerResidual, PoseResidual

from .exact_rig import make_rig

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")


def whole() -> Calibration:
    """A calibration that has every key."""
    corner = CornerResidual(10.0, 20.0, 0.1, -0.1, 30.0, 40.0, 0.1, 0.1, True)
    lost = CornerResidual(10.0, 20.0, 0.1, -0.1, None, None, None, None, False)
    check = BoardCheck("flat", 0.0003, 0.9, 0.002, 110)
    return replace(
        make_rig(),
        poses=(PoseResidual("flat", 0.1, 0.2, 62, 63, ((10.0, 20.0),), corners=(corner, lost)),),
        board={"inner_corners": [9, 7], "square_mm": 0.9},
        software="microrelief 0",
        sigma={
            "camera": dict.fromkeys(NAMES, 0.5),
            "projector": dict.fromkeys(NAMES, 0.5),
            "turn_deg": [0.1, 0.1, 0.1],
            "t_mm": [0.1, 0.1, 0.1],
            "poses": [],
            "weak": ["camera: principal point known to ±9, 8 px"],
            "field": {
                "height_scale_percent": 0.03,
                "lateral_scale_percent": 0.002,
                "bow_um": 0.4,
                "bow_image_um": 1.7,
                "map_um": [[1.0, 2.0], [3.0, 4.0]],
            },
        },
        squares=(check,),
        held_out=(check,),
        notes=("the projector is taken to stand right of the camera",),
    )


def put(*path: str | int, to: Any) -> Callable[[dict[str, Any]], None]:
    def edit(data: dict[str, Any]) -> None:
        here: Any = data
        for key in path[:-1]:
            here = here[key]
        here[path[-1]] = to

    return edit


def drop(*path: str | int) -> Callable[[dict[str, Any]], None]:
    def edit(data: dict[str, Any]) -> None:
        here: Any = data
        for key in path[:-1]:
            here = here[key]
        del here[path[-1]]

    return edit


NAN, INF = float("nan"), float("inf")
MIRROR = np.diag([1.0, 1.0, -1.0]).tolist()
EDITS: list[tuple[Callable[[dict[str, Any]], None], str]] = [
    *((drop(key), f"calibration lacks '{key}'") for key in ("camera", "projector", "R", "t_mm", "reference", "rms_px")),
    *((drop("camera", key), f"calibration lacks 'camera.{key}'") for key in ("size", "K", "dist")),
    (put("camera", to=None), "camera: must be a mapping, not null"),
    (put("projector", to=[1, 2]), "projector: must be a mapping, not a list"),
    (put("rms_px", to=None), "rms_px: must be a mapping, not null"),
    (put("rms_px", to=0.3), "rms_px: must be a mapping, not 0.3"),
    (put("rms_px", "stereo", to=None), "rms_px.stereo: must be a number, not null"),
    (put("rms_px", "stereo", to="0.1"), "rms_px.stereo: must be a number, not a text"),
    (put("rms_px", "stereo", to=NAN), "rms_px.stereo: must be a number of at least 0, not nan"),
    (put("rms_px", "stereo", to=-1), "rms_px.stereo: must be a number of at least 0, not -1"),
    (put("R", 0, 1, to=NAN), "R: must be 3x3 numbers, all finite, but one is nan"),
    (put("R", 0, 1, to=INF), "R: must be 3x3 numbers, all finite, but one is inf"),
    (put("R", 0, 1, to=True), "R: must be 3x3 numbers, all finite, but one is true or false"),
    (put("R", 0, 1, to="0.1"), "R: must be 3x3 numbers, all finite, but one is a text"),
    (put("R", 0, 0, to=2.0), "R: it is no rotation: rows times columns miss 1 and 0 by"),
    (put("R", to=MIRROR), "R: it is no rotation but a mirror"),
    (put("R", to=[1, 2, 3]), "R: must be 3x3 numbers, not 3"),
    (put("R", to=[[1, 0], [0, 1]]), "R: must be 3x3 numbers, not 2x2"),
    (put("R", 1, to=[1, 0]), "R: must be 3x3 numbers"),
    (put("t_mm", to=[1, 2]), "t_mm: must be 3 numbers in a row, not 2"),
    (put("t_mm", to={"x": 1}), "t_mm: must be 3 numbers in a row, not a mapping"),
    (put("t_mm", 0, to=10**400), "t_mm: must be 3 numbers in a row, all finite"),
    (put("reference", to=[[1, 0, 0, 0]]), "reference: must be 3x4 numbers, not 1x4"),
    (put("reference", 2, 2, to=0.5), "reference: its first three columns are no rotation"),
    (put("camera", "size", to=[640]), "camera.size: must be two whole numbers"),
    (put("camera", "size", to=[640.5, 400]), "camera.size: must be two whole numbers"),
    (put("camera", "size", to=[0, 400]), "camera.size: must be two whole numbers"),
    (put("camera", "size", to="640x400"), "camera.size: must be two whole numbers"),
    (put("camera", "K", 0, 0, to=0), "camera.K: must be .*fx and fy other than 0"),
    (put("camera", "K", 2, 2, to=2), "camera.K: must be .*fx and fy other than 0"),
    (put("camera", "K", to=[1, 2, 3]), "camera.K: must be 3x3 numbers, not 3"),
    (put("camera", "dist", to=[0, 0, 0, 0]), "camera.dist: must be 5 numbers in a row, not 4"),
    (put("camera", "model", to="fisheye"), "camera.model: must be pinhole or affine, not fisheye"),
    (put("camera", "model", to=3), "camera.model: must be pinhole or affine, not 3"),
    (put("poses", to={}), "poses: must be a list, not a mapping"),
    (put("poses", 0, to="flat"), r"poses\[0\]: must be a mapping, not a text"),
    (drop("poses", 0, "kept"), r"calibration lacks 'poses\[0\].kept'"),
    (put("poses", 0, "camera_px", to=None), r"poses\[0\].camera_px: must be a number, not null"),
    (put("poses", 0, "name", to=3), r"poses\[0\].name: must be a text, not 3"),
    (put("poses", 0, "rejected", to=[[1]]), r"poses\[0\].rejected: must be a list of rows of 2"),
    (put("poses", 0, "corners", to=[[1, 2]]), r"poses\[0\].corners: must be a list of rows of 9"),
    (put("poses", 0, "corners", 0, 0, to="x"), r"poses\[0\].corners: must be numbers, all finite, but one is a text"),
    (put("poses", 0, "corners", 0, 8, to=1), r"poses\[0\].corners: must be rows of"),
    (put("squares", 0, "square_mm", to="0.9"), r"squares\[0\].square_mm: must be a number, not a text"),
    (drop("held_out", 0, "flatness_mm"), r"calibration lacks 'held_out\[0\].flatness_mm'"),
    (put("board", to=[9, 7]), "board: must be a mapping, not a list"),
    (put("software", to=None), "software: must be a text, not null"),
    (put("notes", to=[1]), r"notes\[0\]: must be a text, not 1"),
    (put("sigma", to=0.1), "sigma: must be a mapping, not 0.1"),
    (drop("sigma", "field"), "calibration lacks 'sigma.field'"),
    (put("sigma", "field", to=None), "sigma.field: must be a mapping, not null"),
    (put("sigma", "field", "bow_image_um", to=None), "sigma.field.bow_image_um: must be a number, not null"),
    (put("sigma", "field", "bow_image_um", to=-1), "sigma.field.bow_image_um: must be a number of at least 0"),
    (drop("sigma", "field", "bow_um"), "calibration lacks 'sigma.field.bow_um'"),
    (put("sigma", "field", "map_um", to=[[1.0]]), "sigma.field.map_um: must be 2x2 numbers, not 1x1"),
    (
        put("sigma", "field", "map_um", 0, 0, to=-1.0),
        "sigma.field.map_um: must be standard uncertainties of at least 0",
    ),
    (put("sigma", "camera", "fx", to="wide"), "sigma.camera.fx: must be a number, not a text"),
    (put("sigma", "weak", to="nothing"), "sigma.weak: must be a list, not a text"),
]


def test_a_calibration_with_every_key_comes_back() -> None:
    rig = whole()
    again = Calibration.from_json(rig.to_json())
    assert again.as_mapping() == rig.as_mapping()
    assert again.id == rig.id


@pytest.mark.parametrize(("edit", "expected"), EDITS, ids=[expected for _, expected in EDITS])
def test_a_mistake_is_named_by_its_key(edit: Callable[[dict[str, Any]], None], expected: str) -> None:
    data = json.loads(whole().to_json())
    edit(data)
    with pytest.raises(ValueError, match=expected) as caught:
        Calibration.from_json(json.dumps(data))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "not JSON: line 1, column 1: expecting value"),
        ("null", "not a calibration: a mapping with camera, projector, R, ... is needed, not null"),
        ("[]", "not a calibration: .*not a list"),
        ("3", "not a calibration: .*not 3"),
        ('{"camera": 1,}', "not JSON: line 1, column"),
        ("[" * 100_000, "not a calibration: brackets in brackets|not JSON"),
    ],
)
def test_what_is_no_calibration_at_all(text: str, expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        Calibration.from_json(text)


@settings(max_examples=40, deadline=None)
@given(st.floats(0, 0.999))
def test_a_file_cut_anywhere_is_refused(share: float) -> None:
    text = whole().to_json()
    with pytest.raises(ValueError, match=r"^not JSON: line "):
        Calibration.from_json(text[: int(share * len(text))])


KEYS = st.sampled_from(
    ["camera", "projector", "R", "t_mm", "reference", "rms_px", "poses", "sigma", "squares", "board"]
)
JUNK = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(["size", "K", "field"]), inner),
    max_leaves=8,
)


@settings(max_examples=150, deadline=None)
@given(KEYS, JUNK)
def test_nothing_but_a_clear_line_comes_of_junk(key: str, junk: Any) -> None:
    data = json.loads(whole().to_json())
    data[key] = junk
    said = ""
    try:
        Calibration.from_json(json.dumps(data))
    except ValueError as error:
        said = str(error)
    assert not said or key in said


def test_the_command_line_names_file_and_key(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = json.loads(whole().to_json())
    data["rms_px"] = None
    file = tmp_path / "rig.json"
    file.write_text(json.dumps(data))
    for command in ("reconstruct", "diagnose"):
        line = [command, str(tmp_path), "--calibration", str(file)]
        assert run_tokens([*line, "--out", str(tmp_path / "o.npz")] if command == "reconstruct" else line) == 2
        assert capsys.readouterr().err.splitlines() == [
            f"microrelief: {file}: rms_px: must be a mapping, not null: calibrate again, or take the file from a backup"
        ]

"""The text of ``calibration.json`` to a calibration: every key is checked, and what is wrong is said by its name."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any, Literal, TypeVar

import numpy as np
import numpy.typing as npt

from .rig_model import BoardCheck, Calibration, CornerResidual, Lens, PoseResidual

__all__ = ["read_rig"]

ROTATION = 1e-4  # what rounding by hand to five digits leaves of R R^T = 1
T = TypeVar("T")
AGAIN = "calibrate again, or take the file from a backup"


def read_rig(text: str) -> Calibration:
    """Read the text of ``calibration.json``.

    Raises
    ------
    ValueError
        One line that names the key, such as ``camera.K``, and says what it should hold.
    """
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        cut = error.pos >= len(text.rstrip())
        what = "the file ends too early" if cut and text.strip() else error.msg[:1].lower() + error.msg[1:]
        raise ValueError(f"not JSON: line {error.lineno}, column {error.colno}: {what}: {AGAIN}") from None
    except RecursionError:
        raise ValueError(f"not a calibration: brackets in brackets without end: {AGAIN}") from None
    if not isinstance(data, dict):
        raise ValueError(f"not a calibration: a mapping with camera, projector, R, ... is needed, not {_told(data)}")
    camera, projector = _lens(data, "camera"), _lens(data, "projector")
    reference = _numbers(data, "reference", (3, 4))
    _rotation(reference[:, :3], "reference", "its first three columns are")
    R = _numbers(data, "R", (3, 3))
    _rotation(R, "R", "it is")
    return Calibration(
        camera=camera,
        projector=projector,
        R=R,
        t_mm=_numbers(data, "t_mm", (3,)),
        reference=reference,
        rms_px={str(name): _number(value, f"rms_px.{name}") for name, value in _mapping(data, "rms_px").items()},
        poses=_each(data, "poses", _pose),
        board=_board(data),
        software=_text(data, "software"),
        sigma=_sigma(data),
        squares=_each(data, "squares", _check),
        held_out=_each(data, "held_out", _check),
        notes=_each(data, "notes", _line),
    )


def _told(value: Any) -> str:
    names = {dict: "a mapping", list: "a list", str: "a text", bool: "true or false", type(None): "null"}
    if type(value) in (int, float):
        return f"{value}"
    return names.get(type(value), "this")


def _value(data: Mapping[str, Any], key: str, where: str = "") -> Any:
    if key not in data:
        raise ValueError(f"calibration lacks {where + key!r}: {AGAIN}")
    return data[key]


def _mapping(data: Mapping[str, Any], key: str, where: str = "") -> Mapping[str, Any]:
    value = _value(data, key, where)
    if not isinstance(value, dict):
        raise ValueError(f"{where}{key}: must be a mapping, not {_told(value)}: {AGAIN}")
    return value


def _number(value: Any, name: str, least: float = 0.0) -> float:
    if type(value) not in (int, float):
        raise ValueError(f"{name}: must be a number, not {_told(value)}: {AGAIN}")
    if not (abs(value) < 1e300 and value >= least):
        raise ValueError(f"{name}: must be a number of at least {least:g}, not {value}: {AGAIN}")
    return float(value)


def _numbers(data: Mapping[str, Any], key: str, shape: tuple[int, ...], where: str = "") -> npt.NDArray[np.float64]:
    value, name = _value(data, key, where), where + key
    wanted = "x".join(map(str, shape))
    kind = f"{wanted} numbers" if len(shape) > 1 else f"{wanted} numbers in a row"
    flat, level = [value], 0
    for size in shape:  # by hand: numpy would read "1", true and 1e999 without a word
        if any(not isinstance(part, list) or len(part) != size for part in flat):
            raise ValueError(f"{name}: must be {kind}, not {_shape(value)}: {AGAIN}")
        flat, level = [each for part in flat for each in part], level + 1
    for each in flat:
        if type(each) not in (int, float) or not abs(each) < 1e300:
            raise ValueError(f"{name}: must be {kind}, all finite, but one is {_told(each)}: {AGAIN}")
    return np.array(flat, dtype=np.float64).reshape(shape)


def _shape(value: Any) -> str:
    sizes, here = [], value
    while isinstance(here, list):
        sizes.append(str(len(here)))
        here = here[0] if here else None
    return "x".join(sizes) if sizes else _told(value)


def _rotation(R: npt.NDArray[np.float64], key: str, who: str) -> None:
    off = float(np.abs(R @ R.T - np.eye(3)).max())
    if off > ROTATION:
        raise ValueError(f"{key}: {who} no rotation: rows times columns miss 1 and 0 by {off:.2g}: {AGAIN}")
    if np.linalg.det(R) < 0:
        raise ValueError(f"{key}: {who} no rotation but a mirror (determinant -1): {AGAIN}")


def _lens(data: Mapping[str, Any], key: str) -> Lens:
    lens, where = _mapping(data, key), f"{key}."
    size = _value(lens, "size", where)
    if not (isinstance(size, list) and len(size) == 2 and all(type(n) is int and 0 < n < 1_000_000 for n in size)):
        raise ValueError(f"{where}size: must be two whole numbers, columns and rows of the image: {AGAIN}")
    K, dist = _numbers(lens, "K", (3, 3), where), _numbers(lens, "dist", (5,), where)
    if not (K[0, 0] and K[1, 1]) or K[1, 0] or (K[2] != (0, 0, 1)).any():
        raise ValueError(f"{where}K: must be [fx s cx], [0 fy cy], [0 0 1], with fx and fy other than 0: {AGAIN}")
    return Lens((size[0], size[1]), K, dist, _model(lens, where))


def _model(lens: Mapping[str, Any], where: str) -> Literal["pinhole", "affine"]:
    model = lens.get("model", "pinhole")
    if model == "affine":
        return "affine"
    if model != "pinhole":
        raise ValueError(
            f"{where}model: must be pinhole or affine, not {model if isinstance(model, str) else _told(model)}"
        )
    return "pinhole"


def _each(data: Mapping[str, Any], key: str, one: Callable[[Any, str], T]) -> tuple[T, ...]:
    values = data.get(key, [])
    if not isinstance(values, list):
        raise ValueError(f"{key}: must be a list, not {_told(values)}: {AGAIN}")
    return tuple(one(value, f"{key}[{n}]") for n, value in enumerate(values))


def _line(value: Any, name: str) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{name}: must be a text, not {_told(value)}: {AGAIN}")
    return value


def _text(data: Mapping[str, Any], key: str) -> str:
    return _line(data.get(key, ""), key)


def _part(value: Any, name: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{name}: must be a mapping, not {_told(value)}: {AGAIN}")
    return value


def _pose(value: Any, name: str) -> PoseResidual:
    pose, where = _part(value, name), f"{name}."
    return PoseResidual(
        name=_line(_value(pose, "name", where), f"{where}name"),
        camera_px=_number(_value(pose, "camera_px", where), f"{where}camera_px"),
        projector_px=_number(_value(pose, "projector_px", where), f"{where}projector_px"),
        kept=int(_number(_value(pose, "kept", where), f"{where}kept")),
        found=int(_number(_value(pose, "found", where), f"{where}found")),
        rejected=tuple((a, b) for a, b in _rows(pose, "rejected", 2, where)),
        advice=_line(pose.get("advice", ""), f"{where}advice"),
        corners=tuple(_corner(row, f"{where}corners") for row in _rows(pose, "corners", 9, where)),
    )


def _rows(data: Mapping[str, Any], key: str, width: int, where: str) -> list[list[Any]]:
    rows = data.get(key, [])
    if not isinstance(rows, list) or any(not isinstance(row, list) or len(row) != width for row in rows):
        raise ValueError(f"{where}{key}: must be a list of rows of {width}: {AGAIN}")
    for row in rows:
        for each in row:
            if each is not None and not (type(each) in (int, float, bool) and math.isfinite(each)):
                raise ValueError(f"{where}{key}: must be numbers, all finite, but one is {_told(each)}: {AGAIN}")
    return rows


def _corner(row: list[Any], name: str) -> CornerResidual:
    if any(each is None for each in row[:4]) or type(row[8]) is not bool:
        raise ValueError(
            f"{name}: must be rows of column, row, their errors (camera, projector), true or false: {AGAIN}"
        )
    return CornerResidual(*row)


def _check(value: Any, name: str) -> BoardCheck:
    check, where = _part(value, name), f"{name}."
    flat, side, spread, count = (
        _number(_value(check, key, where), where + key)
        for key in ("flatness_mm", "square_mm", "square_sd_mm", "squares")
    )
    return BoardCheck(_line(_value(check, "name", where), f"{where}name"), flat, side, spread, int(count))


def _board(data: Mapping[str, Any]) -> Mapping[str, Any] | None:
    board = data.get("board")
    return None if board is None else _part(board, "board")


def _sigma(data: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Standard uncertainties: what is computed with or shown is checked, other keys are passed on."""
    sigma = data.get("sigma")
    if sigma is None:
        return None
    sigma = _part(sigma, "sigma")
    for key in ("camera", "projector", "field"):
        for name, value in _mapping(sigma, key, "sigma.").items():
            if name != "map_um":
                _number(value, f"sigma.{key}.{name}")
    for key in ("turn_deg", "t_mm"):
        _numbers(sigma, key, (3,), "sigma.")
    _each({"sigma.weak": _value(sigma, "weak", "sigma.")}, "sigma.weak", _line)
    field = sigma["field"]
    for key in ("height_scale_percent", "lateral_scale_percent", "bow_um", "bow_image_um"):
        _value(field, key, "sigma.field.")
    if "map_um" in field:
        rows = field["map_um"]
        shape = (len(rows), len(rows[0])) if isinstance(rows, list) and rows and isinstance(rows[0], list) else (2, 2)
        if (_numbers(field, "map_um", (max(shape[0], 2), max(shape[1], 2)), "sigma.field.") < 0).any():
            raise ValueError(f"sigma.field.map_um: must be standard uncertainties of at least 0: {AGAIN}")
    return sigma

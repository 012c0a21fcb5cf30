"""YAML to plain values, remembering the line and column of every key and value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .errors import ConfigError

__all__ = ["Document", "Place", "Route", "read_yaml", "route_text"]

Route = tuple[str | int, ...]
"""The way to a value from the root: keys and list indices."""


@dataclass(frozen=True, slots=True)
class Place:
    """Line and column, both from 1."""

    line: int
    column: int


@dataclass(frozen=True, slots=True)
class Document:
    """A YAML file as plain values, with the place of every key and value.

    Parameters
    ----------
    file : str
        Name for messages.
    data : object
        dict, list, str, int, float, bool or None. Times stay text: their zone is the campaign's business.
    keys, values : mapping of Route to Place
        Where each key stands, and where each value begins.
    """

    file: str
    data: Any
    keys: Mapping[Route, Place] = field(default_factory=dict)
    values: Mapping[Route, Place] = field(default_factory=dict)

    def line(self, route: Route, text: str, *, at_key: bool = False) -> str:
        """Write ``FILE:LINE:COLUMN: KEY: text`` for a value, or for the nearest thing above it that the file has.

        What begins on a line below its key is placed at the key.
        """
        found = route
        while found and found not in self.values:
            found = found[:-1]
        place, key = self.values.get(found, Place(1, 1)), self.keys.get(found)
        if key is not None and (at_key or place.line > key.line):
            place = key
        where = f"{route_text(route)}: " if route else ""
        return f"{self.file}:{place.line}:{place.column}: {where}{text}"


def route_text(route: Route) -> str:
    """Write a route as people do: ``alarms[0].metric``."""
    text = ""
    for step in route:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def read_yaml(text: str, file: str) -> Document:
    """Read one YAML 1.2 document.

    Parameters
    ----------
    text : str
    file : str
        Name for messages.

    Raises
    ------
    ConfigError
        If the text is not YAML, holds several documents, or has a key twice.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        root = YAML(typ="rt").compose(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"{mark.line + 1}:{mark.column + 1}" if mark is not None else "1:1"
        raise ConfigError(f"{file}:{place}: not YAML: {_syntax(text, mark, error.problem or str(error))}") from None
    except YAMLError as error:
        raise ConfigError(f"{file}:1:1: not YAML: {str(error).splitlines()[0]}") from None
    keys: dict[Route, Place] = {}
    values: dict[Route, Place] = {}
    problems: list[str] = []

    def plain(node: Any, route: Route) -> Any:
        values[route] = _place(node)
        if node.id == "mapping":
            result: dict[str | int, Any] = {}
            for key_node, value_node in node.value:
                key = _key(key_node)
                here = (*route, key)
                if key in result:
                    place = _place(key_node)
                    first = keys[here]
                    where = f"{file}:{place.line}:{place.column}: {route_text(here)}"
                    problems.append(f"{where}: given twice, first in line {first.line}")
                    continue
                keys[here] = _place(key_node)
                result[key] = plain(value_node, here)
            return result
        if node.id == "sequence":
            return [plain(item, (*route, index)) for index, item in enumerate(node.value)]
        return _scalar(node)

    data = plain(root, ()) if root is not None else None
    if problems:
        raise ConfigError("\n".join(problems))
    return Document(file, data, keys, values)


def _place(node: Any) -> Place:
    return Place(node.start_mark.line + 1, node.start_mark.column + 1)


def _key(node: Any) -> str | int:
    """A key as it is written, save that a whole number is one."""
    if node.id != "scalar":
        return "?"
    value = _scalar(node)
    return value if isinstance(value, int) and not isinstance(value, bool) else str(node.value)


def _scalar(node: Any) -> str | int | float | bool | None:
    """The value of a plain scalar by YAML 1.2's core schema, as its tag says."""
    text = str(node.value)
    match str(node.tag).rpartition(":")[2]:
        case "null":
            return None
        case "bool":
            return text.lower() == "true"
        case "int":
            digits = text.replace("_", "")
            return int(digits, 0) if digits.lstrip("+-")[:2].lower() in ("0x", "0o", "0b") else int(digits)
        case "float":
            return float(text.replace("_", "").replace(".inf", "inf").replace(".nan", "nan").replace(".NaN", "nan"))
        case _:
            return text


def _syntax(text: str, mark: Any, problem: str) -> str:
    """Say in plain words what beginners trip over most."""
    line = text.splitlines()[mark.line] if mark is not None and mark.line < len(text.splitlines()) else ""
    if "\t" in line[: mark.column + 1 if mark is not None else 0]:
        return "a tab: indent with spaces"
    if problem == "mapping values are not allowed here":
        return "a ':' where none can be: indent the line like its neighbours, or put quotes around the text"
    return problem

"""Pattern files: a pattern set as YAML, and its images to project."""

from __future__ import annotations

import re
from pathlib import Path

from configs import InputError
from pipelines import PatternSet

__all__ = ["natural_key", "read_patterns", "write_patterns"]


def natural_key(name: str) -> tuple[tuple[int, int | str], ...]:
    """Sort key that puts 2 before 10: numbers count as numbers, letters without case."""
    parts = re.split(r"(\d+)", name.lower())
    return tuple((0, int(part)) if part.isdigit() else (1, part) for part in parts if part)


def read_patterns(file: str | Path) -> PatternSet:
    """Read a pattern file.

    Parameters
    ----------
    file : path
        YAML with the fields of `PatternSet`.

    Raises
    ------
    InputError
        If there is no such file, or it is no pattern set; the message names the line where it can.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    file = Path(file)
    if file.is_dir():
        raise InputError(f"{file}: is a folder, give the pattern file in it")
    try:
        text = file.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{file}: no such pattern file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: cannot be read: {error}") from None
    try:
        mapping = YAML(typ="safe", pure=True).load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark
        where = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise InputError(f"{file}{where}: not YAML: {error.problem}") from None
    except YAMLError as error:
        raise InputError(f"{file}: not YAML: {' '.join(str(error).split())}") from None
    try:
        return PatternSet.from_mapping(mapping)
    except ValueError as error:
        key = re.match(r"[a-z_]+", str(error))
        line = _line_of(text, key.group()) if key else ""
        raise InputError(f"{file}{line}: {error}") from None


def write_patterns(patterns: PatternSet, folder: str | Path) -> None:
    """Write the images to project, ``00_white.png`` and on, and ``patterns.yaml``, which says what they are.

    Parameters
    ----------
    patterns : PatternSet
    folder : path
        Made if it is not there; files of the same name are replaced.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    import cv2
    from ruamel.yaml import YAML

    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for number, (role, image) in enumerate(zip(patterns.roles, patterns.images(), strict=True)):
            (folder / f"{number:02d}_{role.name}.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
        yaml = YAML(typ="safe", pure=True)
        yaml.default_flow_style = None
        yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # its stub knows only None
        with (folder / "patterns.yaml").open("w", encoding="utf-8") as out:
            yaml.dump(patterns.as_mapping(), out)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None


def _line_of(text: str, key: str) -> str:
    found = re.search(rf"^[ \t]*{re.escape(key)}[ \t]*:", text, re.MULTILINE)
    return f":{text.count(chr(10), 0, found.start()) + 1}:1" if found else ""

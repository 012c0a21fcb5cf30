"""The reference pages, written from the code: every command, every key of a campaign, every public name."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from cyclopts import App

from monitor.check import campaign_schema
from monitor.cli import COMMANDS, example_of, load_command
from monitor.rigs import RIGS

__all__ = ["write_reference"]

DOORS = {
    "configs": "Settings: a campaign as a frozen value.",
    "pipelines": "The values that all of it speaks of: grids, scans, ticks.",
    "pipelines.reconstruction": "From frames to a height map.",
    "pipelines.change": "From two height maps to what changed.",
    "pipelines.trends": "From a series to a verdict.",
    "pipelines.scenes": "Surfaces with closed-form truth.",
    "storage": "Stores, imports and exports.",
    "dashboards": "Reviews and reports.",
}
"""The front doors that another program may enter by, with what is behind each."""


def write_reference(folder: Path) -> None:
    """Write the pages of the reference.

    Parameters
    ----------
    folder : pathlib.Path
        Where they go. Pages that are there and would be the same are left alone: Sphinx need not read them again.
    """
    folder.mkdir(exist_ok=True)
    pages = {"commands": _commands(), "campaign": _campaign(), "python": _python()}
    pages |= {door: _door(door, about) for door, about in DOORS.items()}
    for name, text in pages.items():
        page = folder / f"{name}.md"
        if not page.is_file() or page.read_text() != text:
            page.write_text(text)


def _commands() -> str:
    """Tell of each command what its ``--help`` does."""
    parts = ["# Commands", "What `microrelief COMMAND --help` says, of all commands."]
    for name in COMMANDS:
        command = load_command(name)
        app = App(name="microrelief")
        app.command(command, name=name)
        told = app.generate_docs().partition(f"## microrelief {name}\n")[2]
        told = re.sub(r"(?m)^(microrelief \w+) -m \w+", r"\1", told)  # how Python was started
        parts += [f"## {name}", told.replace("```console", "```text").strip(), example_of(command)]
    return "\n\n".join(parts) + "\n"


def _campaign() -> str:
    """Tell every key of a campaign file, and the options of every rig."""
    schema = campaign_schema()
    parts = [
        "# Campaign files",
        "Every key, written from the schema that `microrelief schema` gives to editors. A wrong one is told with its"
        " line, column and the nearest name that exists.",
        *_keys(schema, schema["$defs"]),
    ]
    for name, part in schema["$defs"].items():
        parts += [
            f"({_label(name)})=",
            f"## {_spaced(name)}",
            part.get("description", ""),
            *_keys(part, schema["$defs"]),
        ]
    parts += ["## Options of each rig", "`rig: {name: ..., options: {...}}`"]
    for name, kind in RIGS.items():
        parts += [f"### {name}", f"```{{eval-rst}}\n.. autoclass:: {kind.__module__}.{kind.__name__}\n```"]
    return "\n\n".join(part for part in parts if part) + "\n"


def _keys(part: Mapping[str, Any], parts: Mapping[str, Any]) -> Iterator[str]:
    """Give the table of one part's keys."""
    required = part.get("required", ())
    rows = ["| key | value | default | meaning |", "|---|---|---|---|"]
    for key, value in part.get("properties", {}).items():
        further = parts[value["$ref"].rsplit("/", 1)[1]] if "$ref" in value else {}
        if key in required:
            default = "**required**"
        elif further or value.get("default") in (None, [], {}):
            default = "see there" if further else "none"
        else:
            default = f"`{json.dumps(value['default'])}`"
        told = str(value.get("description") or further.get("description", "")).replace("|", "\\|").replace("\n", " ")
        rows.append(f"| `{key}` | {_kind(value)} | {default} | {told} |")
    if len(rows) > 2:
        yield "\n".join(rows)


def _kind(value: Mapping[str, Any]) -> str:
    """Say what a value may be, in a few words."""
    if "$ref" in value:
        name = value["$ref"].rsplit("/", 1)[1]
        return f"[{_spaced(name)}](#{_label(name)})"
    if "enum" in value:
        few = [f"`{each}`" for each in value["enum"][:8]]
        return ", ".join(few) + (f" and {len(value['enum']) - 8} more" if len(value["enum"]) > 8 else "")
    if "const" in value:
        return f"`{value['const']}`"
    if "anyOf" in value:
        kinds = [_kind(each) for each in value["anyOf"] if each.get("type") != "null"]
        return "a name of the list" if len(kinds) > 8 else " or ".join(dict.fromkeys(kinds))
    if value.get("type") == "array":
        return f"list of {_kind(value['items'])}" if "items" in value else "list"
    if "examples" in value:
        return "such as " + ", ".join(f"`{each}`" for each in value["examples"][:2])
    kind = str(value.get("type", "any"))
    return {"string": "text", "boolean": "true or false", "object": "keys", "integer": "whole number"}.get(kind, kind)


def _label(name: str) -> str:
    return f"campaign-{name.lower()}"


def _spaced(name: str) -> str:
    """``RigSettings`` as ``rig settings``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()


def _python() -> str:
    """List the front doors."""
    rows = [f"| [`{door}`]({door}.md) | {about} |" for door, about in DOORS.items()]
    pages = "\n".join(DOORS)
    return (
        "# From Python\n\nPackages are entered through their front doors; what is not named here may change unsaid.\n\n"
        + "\n".join(["| package | what is there |", "|---|---|", *rows])
        + f"\n\n```{{toctree}}\n:hidden:\n\n{pages}\n```\n"
    )


def _door(door: str, about: str) -> str:
    """Show all that a front door gives; what lives behind a further one is shown there, and named here."""
    module = import_module(door)
    homes = {name: _home(getattr(module, name), door) for name in module.__all__}
    elsewhere = {name: home for name, home in homes.items() if home != door}
    named = ", ".join(f"[`{name}`]({home}.md)" for name, home in sorted(elsewhere.items()))
    excluded = f"\n   :exclude-members: {', '.join(elsewhere)}" if elsewhere else ""
    also = f"\nAlso from here: {named}.\n" if named else ""
    return f"# {door}\n\n{about}\n{also}\n```{{eval-rst}}\n.. automodule:: {door}{excluded}\n```\n"


def _home(value: object, door: str) -> str:
    """Give the front door that is nearest to where a value was written."""
    module = getattr(value, "__module__", None) or door
    return max((each for each in DOORS if f"{module}.".startswith(f"{each}.")), key=len, default=door)

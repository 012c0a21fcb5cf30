"""Campaign files: YAML to a `Campaign`, with the line and column of everything that is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from .campaign import Campaign
from .errors import ConfigError, InputError
from .places import Document, Route, read_yaml

__all__ = ["CampaignFile", "did_you_mean", "load_campaign", "parse_campaign", "read_campaign"]


@dataclass(frozen=True, slots=True)
class CampaignFile:
    """A campaign, the text it was read from, and where each key of it stands."""

    campaign: Campaign
    path: Path
    text: str
    document: Document


def load_campaign(path: str | Path) -> Campaign:
    """Read a campaign file.

    Parameters
    ----------
    path : str or Path
        A YAML file; relative paths in it are relative to its folder.

    Raises
    ------
    InputError
        If there is no such file.
    ConfigError
        If anything in it is wrong: one line per problem, ``FILE:LINE:COLUMN: KEY: what``.
    """
    return read_campaign(path).campaign


def read_campaign(path: str | Path) -> CampaignFile:
    """Read a campaign file and keep its text and places; parameters and errors as `load_campaign`."""
    file = Path(path)
    try:
        text = file.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such campaign file; `microrelief init DIR` writes one to start from") from None
    except IsADirectoryError:
        raise InputError(
            f"{path} is a folder: name the campaign file in it, such as {file / 'campaign.yaml'}"
        ) from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is not a text file: a campaign is YAML in UTF-8") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    document = read_yaml(text, str(path))
    return CampaignFile(_campaign(document, file.parent), file, text, document)


def parse_campaign(text: str, file: str, folder: Path) -> Campaign:
    """Read a campaign from text, such as a store keeps it; relative paths are `folder`'s. Errors as `load_campaign`."""
    return _campaign(read_yaml(text, file), folder)


def _campaign(document: Document, folder: Path) -> Campaign:
    if document.data is None:
        raise ConfigError(f"{document.file}:1:1: empty; `microrelief init DIR` writes a campaign to start from")
    if not isinstance(document.data, dict):
        raise ConfigError(
            f"{document.file}:1:1: a campaign is a list of keys such as `site:`, not {_kind(document.data)}"
        )
    try:
        return Campaign.model_validate(document.data, context={"folder": folder.resolve()})
    except ValidationError as error:
        details = error.errors()
        meant = {_meant(detail) for detail in details}
        kept = [detail for detail in details if detail["loc"] not in meant and not _follows(detail, details)]
        lines = sorted({_line(document, detail) for detail in kept}, key=_position)
        raise ConfigError("\n".join(lines)) from None


def _meant(detail: ErrorDetails) -> Route | None:
    """The key that an unknown key was meant to be: it is not also reported as missing."""
    if detail["type"] != "extra_forbidden":
        return None
    near = get_close_matches(str(detail["loc"][-1]), _keys_at(detail["loc"][:-1]), n=1, cutoff=0.6)
    return (*detail["loc"][:-1], near[0]) if near else None


def _follows(detail: ErrorDetails, details: list[ErrorDetails]) -> bool:
    """Whether a list is only too short because of what is wrong in it."""
    place = detail["loc"]
    return detail["type"] == "too_short" and any(
        len(other["loc"]) > len(place) and other["loc"][: len(place)] == place for other in details
    )


def _position(line: str) -> tuple[int, int, str]:
    """Sort key of a message: its line, its column."""
    numbers = [part for part in line.split(":") if part.isdigit()]
    return int(numbers[0]), int(numbers[1]), line


def _line(document: Document, detail: ErrorDetails) -> str:
    """One pydantic error as one line for people."""
    route = detail["loc"][:1] if detail["loc"][:1] == ("patterns",) else detail["loc"]  # below are branches of a union
    given = detail["input"]
    context = detail.get("ctx", {})
    kind = detail["type"]
    if kind == "extra_forbidden":
        return document.line(route, f"unknown key{did_you_mean(str(route[-1]), _keys_at(route[:-1]))}", at_key=True)
    if kind == "missing":
        known = ", ".join(_keys_at(route))
        text = f"missing: add `{route[-1]}:`" + (f" with {known}" if known else "")
        return document.line(route, text)
    if kind == "at":
        route = (*route, *context["route"])
        return document.line(route, str(context["text"]))
    return document.line(route, _words(kind, detail["msg"], given, context))


def _words(kind: str, message: str, given: Any, context: dict[str, Any]) -> str:
    shown = _shown(given)
    match kind:
        case "value_error":
            return str(context["error"])
        case "float_type" | "float_parsing" | "int_type":
            return f"must be a number, not {shown}"
        case "string_type":
            return f"must be text, not {shown}" + (
                "; put quotes around it" if not isinstance(given, dict | list) else ""
            )
        case "bool_type":
            return f"must be true or false, not {shown}"
        case "model_type" | "model_attributes_type" | "dict_type" | "mapping_type":
            return f"must hold keys of its own, indented below it, not {shown}"
        case "tuple_type" | "list_type":
            return f"must be a list, not {shown}"
        case "path_type":
            return f"must be a path, not {shown}"
        case "greater_than":
            return f"must be more than {context['gt']:g}, not {shown}"
        case "greater_than_equal":
            return f"must be at least {context['ge']:g}, not {shown}"
        case "less_than_equal":
            return f"must be at most {context['le']:g}, not {shown}"
        case "literal_error":
            return f"must be one of {str(context['expected']).replace(' or ', ', ')}, not {shown}"
        case "finite_number":
            return f"must be a finite number, not {shown}"
        case "too_short":
            return f"needs at least {context['min_length']} points, not {context['actual_length']}"
        case _:
            return message


def _shown(given: Any) -> str:
    return _kind(given) if isinstance(given, dict | list) or given is None else repr(given)


def _kind(given: Any) -> str:
    if given is None:
        return "nothing"
    return "keys" if isinstance(given, dict) else "a list" if isinstance(given, list) else "plain text"


def _keys_at(route: Route) -> list[str]:
    """The keys that a campaign knows at a route; empty where it is no mapping of ours."""
    model: Any = Campaign
    for step in route:
        if isinstance(step, int):
            continue
        fields = {field.alias or name: field for name, field in model.model_fields.items()}
        if step not in fields:
            return []
        model = _model_in(fields[step].annotation)
        if model is None:
            return []
    return [field.alias or name for name, field in model.model_fields.items()]


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The model inside ``Model``, ``Model | None`` or ``tuple[Model, ...]``."""
    if isinstance(annotation, type) and get_origin(annotation) is None and issubclass(annotation, BaseModel):
        return annotation
    for inner in get_args(annotation):
        found = _model_in(inner)
        if found is not None:
            return found
    return None


def did_you_mean(word: str, known: list[str]) -> str:
    """``, did you mean 'every'?`` where a known word is near, else the list of known ones."""
    near = get_close_matches(word.lower(), known, n=1, cutoff=0.6)
    if near:
        return f", did you mean {near[0]!r}?"
    return f"; known here: {', '.join(known)}" if known else ""

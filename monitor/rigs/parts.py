"""Parts: makes a rig, a camera or a projector from a registry by name and plain keywords, with messages for people."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from configs import InputError

__all__ = ["make_from_kind", "make_part", "option_names"]

Part = TypeVar("Part")


def option_names(make: Callable[..., object]) -> tuple[str, ...]:
    """Name the options of a part: the keywords of its factory."""
    return tuple(inspect.signature(make).parameters)


def make_part(what: str, registry: Mapping[str, Callable[..., Part]], name: str, options: Mapping[str, Any]) -> Part:
    """Make a part from its name and options.

    Parameters
    ----------
    what : str
        What kind of part, for the messages: "rig", "camera".
    registry : mapping of str to callable
    name : str
        A key of `registry`.
    options : mapping of str to anything
        The part's keywords.

    Raises
    ------
    InputError
        There is no such part or option, an option lacks, or one has an impossible value.
    """
    if name not in registry:
        raise InputError(
            f"{what} name: no {what} {name!r}{_meant(str(name), registry)}; there are {', '.join(registry)}"
        )
    known = option_names(registry[name])
    for option in options:
        if option not in known:
            raise InputError(
                f"{what} option {option}: the {name} {what} has none of that name{_meant(str(option), known)}; "
                f"its options are {', '.join(known)}"
            )
    try:
        return registry[name](**options)
    except InputError:
        raise
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} options of {name}: {error}") from None


def make_from_kind(
    what: str, registry: Mapping[str, Callable[..., Part]], options: object, where: str = "rig option "
) -> Part:
    """Make a part from a mapping that holds its ``kind`` beside its own options.

    Parameters
    ----------
    what : str
        What kind of part, which is also the key under which the user wrote it.
    registry : mapping of str to callable
    options : mapping
    where : str
        Where that key stands, as messages begin.

    Raises
    ------
    InputError
        As `make_part`, said as a problem of that key.
    """
    if not isinstance(options, Mapping) or "kind" not in options:
        raise InputError(
            f"{where}{what}: give its kind and options, such as {{kind: {next(iter(registry))}}}; "
            f"there are {', '.join(registry)}"
        )
    own = {str(key): value for key, value in options.items() if key != "kind"}
    try:
        return make_part(what, registry, str(options["kind"]), own)
    except InputError as error:
        raise InputError(f"{where}{what}: {error}") from None


def _meant(word: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(word, list(known), n=1)
    return f", did you mean {near[0]!r}?" if near else ""

"""The command `patterns`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Literal

from configs import InputError
from pipelines import PatternSet
from storage import read_patterns, write_patterns

__all__ = ["patterns"]


def patterns(
    *,
    out: Path,
    kind: Literal["gray", "stripes", "phase"] = "gray",
    size: str = "608x684",
    bits: str | None = None,
    offset: Literal["none", "centred"] = "none",
    steps: int = 4,
    patterns: Path | None = None,
    force: bool = False,
) -> None:
    """Write the images to project, and the file that says what they are.

    Parameters
    ----------
    out
        Folder for the images, in the order to project them, and ``patterns.yaml``.
    kind
        Gray code, equal-width stripes (the table of the paper), or phase shifting with Gray order.
    size
        Projector columns x rows.
    bits
        Bits along columns x rows, 0 for an axis that is not projected; as many as the size needs if not given.
    offset
        Where the Gray code sits: from its first word, or centred on the axis.
    steps
        Phase shifts of a period (phase only).
    patterns
        Take the set from this pattern file, instead of the options above.
    force
        Write into a folder that holds files.

    Examples
    --------
    microrelief patterns --out to_project --kind stripes --size 608x684
    """
    if patterns is not None:
        chosen = read_patterns(patterns)
    else:
        fields: dict[str, Any] = {"kind": kind, "size": _pair("--size", size)}
        if bits is not None:
            fields["bits"] = _pair("--bits", bits)
        if kind == "gray":
            fields["offset"] = offset
        if kind == "phase":
            fields["steps"] = steps
        try:
            chosen = PatternSet.from_mapping(fields)
        except ValueError as error:
            raise InputError(f"these patterns cannot be: {error}") from None
    if out.is_dir() and any(out.iterdir()) and not force:
        raise InputError(f"{out}: holds files already, give a new folder or --force")
    for remark in chosen.remarks:
        print(f"note: {remark}")
    write_patterns(chosen, out)
    print(f"wrote {len(chosen.roles)} images of {chosen.size[0]}x{chosen.size[1]} and patterns.yaml to {out}")


def _pair(option: str, text: str) -> list[int]:
    found = re.fullmatch(r"\s*(\d+)\s*[x,]\s*(\d+)\s*", text.lower())
    if not found:
        raise InputError(f"{option} {text}: give columns and rows, such as 608x684")
    return [int(found[1]), int(found[2])]

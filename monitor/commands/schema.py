"""The command `schema`."""

from __future__ import annotations

import json
from pathlib import Path

from configs import InputError

from ..check import campaign_schema

__all__ = ["schema", "schema_text"]


def schema_text() -> str:
    """Give the schema as it is written to a file."""
    return json.dumps(campaign_schema(), indent=2, ensure_ascii=False) + "\n"


def schema(*, out: Path | None = None) -> None:
    """Write the JSON schema of campaign files.

    An editor with a YAML language server then completes keys, shows what they mean and marks mistakes. Name the schema
    in the first line of a campaign: ``# yaml-language-server: $schema=campaign.schema.json``.

    Parameters
    ----------
    out
        File to write; without it, standard output.

    Examples
    --------
    microrelief schema --out campaign.schema.json
    """
    if out is None:
        print(schema_text(), end="")
        return
    try:
        out.write_text(schema_text(), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror}") from None
    print(f"wrote {out}")

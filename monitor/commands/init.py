"""The command `init`."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from configs import InputError

from .schema import schema_text

__all__ = ["init"]

NAME = "campaign.yaml"
SCHEMA = "campaign.schema.json"
TEMPLATE = "soil.yaml"


def init(folder: Path) -> None:
    """Write a commented campaign to start from, and the schema with which editors help to fill it in.

    It runs at once, on the simulated rig; its comments say what to change for your own. Nothing is overwritten.

    Parameters
    ----------
    folder
        Made if it is not there.

    Examples
    --------
    microrelief init plot7
    """
    campaign, schema = folder / NAME, folder / SCHEMA
    for file in (campaign, schema):
        if file.exists():
            raise InputError(f"{file} is there already: choose another folder, or move it away")
    text = files("configs").joinpath(TEMPLATE).read_text(encoding="utf-8")
    text = text.replace(TEMPLATE, NAME).replace("soil.icechunk", f"{folder.resolve().name or 'site'}.icechunk")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        campaign.write_text(text, encoding="utf-8")
        schema.write_text(schema_text(), encoding="utf-8")
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{folder} is no folder: choose another name") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    print(f"wrote {campaign}, a campaign on the simulated rig; its comments say what to change")
    print(f"  microrelief run {campaign} --dry-run   what it will do")
    print(f"  microrelief run {campaign}             do it")

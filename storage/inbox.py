"""Inbox: events for a store that another process is writing, in files beside it; the writer takes them in."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from uuid import uuid4

from configs import StoreError
from pipelines import Event, format_instant, parse_instant

from .durable import sync_file
from .folder import Folder
from .location import location_of

__all__ = ["Inbox"]


class Inbox:
    """The folder ``NAME.inbox`` beside a store, one small file per event; there only while something waits.

    Parameters
    ----------
    store : str or Path
    folder : Path, optional
        Of a store on S3: its campaign's; the current one where none is given.
    """

    def __init__(self, store: str | Path, folder: Path | None = None) -> None:
        location = location_of(store)
        if isinstance(location, Folder):
            self._folder = location.path.parent / f"{location.path.stem}.inbox"
        else:
            self._folder = (folder or Path()) / f"{str(location).rstrip('/').rpartition('/')[2]}.inbox"

    def put(self, event: Event) -> None:
        """Leave an event for the writer, durably. Raises StoreError where the disk does not take it."""
        text = json.dumps({"time": format_instant(event.time), "kind": event.kind, "text": event.text})
        draft = self._folder / f".{uuid4().hex}"
        try:
            self._folder.mkdir(exist_ok=True)
            draft.write_text(text, encoding="utf-8")
            sync_file(draft)
            draft.rename(draft.with_name(f"{draft.name[1:]}.json"))
        except OSError as error:
            raise StoreError(f"{self._folder}: cannot be written: {error.strerror}") from None

    def waiting(self) -> tuple[tuple[Path, Event], ...]:
        """Give what waits, oldest first, with its file; a file that is no event stays where it is."""
        found = []
        for file in sorted(self._folder.glob("*.json")) if self._folder.is_dir() else ():
            try:
                kept = json.loads(file.read_text(encoding="utf-8"))
                found.append((file, Event(parse_instant(kept["time"]), str(kept["kind"]), str(kept["text"]))))
            except (OSError, ValueError, KeyError, TypeError):
                continue
        return tuple(sorted(found, key=lambda each: each[1].time))

    def taken(self, files: Sequence[Path]) -> None:
        """Take out what is in the store now."""
        for file in files:
            file.unlink(missing_ok=True)
        if files and not any(self._folder.iterdir()):
            self._folder.rmdir()

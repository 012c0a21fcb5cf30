"""Reviews: the Rerun viewer of a site, drawn and served when somebody asks for it, one at a time."""

from __future__ import annotations

import socket
import threading
from contextlib import ExitStack
from pathlib import Path

import structlog

from dashboards import serve_web
from storage import open_store

from ..reviewing import served_review

__all__ = ["Reviews"]

_log = structlog.get_logger("microrelief.page")


class Reviews:
    """Starts a viewer in the background; a second site's takes the place of the first's."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._key = ""
        self._link = ""
        self._trouble = ""
        self._stack: ExitStack | None = None
        self._thread: threading.Thread | None = None

    def start(self, key: str, store: str | Path) -> None:
        """Begin to record and serve a site's review, unless that is being done."""
        with self._lock:
            busy = self._thread is not None and self._thread.is_alive()
            if busy or (self._key == key and self._link):
                return
            self._end()
            self._key, self._link, self._trouble = key, "", ""
            self._thread = threading.Thread(target=self._work, args=(store,), name="review", daemon=True)
            self._thread.start()

    def state(self, key: str) -> tuple[str, str, str]:
        """Give ``none``, ``preparing``, ``ready`` or ``failed``, the link, and what went wrong."""
        with self._lock:
            if self._key != key:
                return "none", "", ""
            if self._link:
                return "ready", self._link, ""
            return ("failed", "", self._trouble) if self._trouble else ("preparing", "", "")

    def close(self) -> None:
        """End the viewer."""
        thread = self._thread
        if thread is not None:
            thread.join(60)
        with self._lock:
            self._end()

    def _work(self, path: str | Path) -> None:
        stack = ExitStack()
        try:
            page = _two_free_ports()
            address = stack.enter_context(served_review(open_store(path), port=page + 1))
            link, _ = stack.enter_context(serve_web(address, page))
        except Exception as error:  # noqa: BLE001 - the page says why, and goes on
            stack.close()
            _log.error("review", error=f"{type(error).__name__}: {error}")
            with self._lock:
                self._trouble = str(error) or type(error).__name__
            return
        with self._lock:
            self._stack, self._link = stack, link

    def _end(self) -> None:
        if self._stack is not None:
            self._stack.close()
        self._stack, self._key, self._link = None, "", ""


def _two_free_ports() -> int:
    """Find a port that is free now, and the next one too."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port = int(first.getsockname()[1])
            try:
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port

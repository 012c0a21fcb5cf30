"""The page's server: uvicorn, in the foreground for `serve`, on a thread beside a running campaign."""

from __future__ import annotations

import socket
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from configs import InputError, MicroreliefError

from ..clock import RealClock
from .app import make_app
from .guard import check_opening
from .reviews import Reviews
from .sites import Sites, SiteSource

__all__ = ["PageServer", "serve_pages"]


class PageServer:
    """A page of some sites, that listens.

    Parameters
    ----------
    sources : sequence of SiteSource
    host, port
        Port 0 takes a free one; `port` then says which.

    Raises
    ------
    InputError
        If the port does not exist, or the page would be open to others without a token.
    MicroreliefError
        If the port is taken.
    """

    def __init__(self, sources: Sequence[SiteSource], host: str = "127.0.0.1", port: int = 8123) -> None:
        import uvicorn

        if not 0 <= port <= 65535:
            raise InputError(f"--port {port} does not exist: choose one from 1024 to 65535")
        token = check_opening(host)
        self._reviews = Reviews()
        clock = RealClock()
        app = make_app(Sites(sources, clock.now), self._reviews, host=host, token=token)
        self._socket = _listen(host, port)
        self.port: int = self._socket.getsockname()[1]
        self.link = f"http://{host if ':' not in host else f'[{host}]'}:{self.port}/"
        config = uvicorn.Config(app, log_level="error", access_log=False, lifespan="off", server_header=False)
        self._server = uvicorn.Server(config)
        self._thread: threading.Thread | None = None

    def run(self) -> None:
        """Serve until a signal ends it."""
        try:
            self._server.run(sockets=[self._socket])
        finally:
            self._close()

    def __enter__(self) -> Self:
        # uvicorn takes the signals for itself on the main thread only: those stay the campaign's
        self._thread = threading.Thread(
            target=self._server.run, kwargs={"sockets": [self._socket]}, name="page", daemon=True
        )
        self._thread.start()
        return self

    def __exit__(self, *error: Any) -> None:
        self._server.should_exit = True
        if self._thread is not None:
            self._thread.join(10)
        self._close()

    def _close(self) -> None:
        self._reviews.close()
        self._socket.close()


def serve_pages(sources: Sequence[SiteSource], host: str, port: int) -> None:
    """Serve until a signal ends it, saying where."""
    server = PageServer(sources, host, port)
    names = ", ".join(str(Path(source.store).name) for source in sources)
    print(f"status of {names} at {server.link} (Ctrl-C ends it)", flush=True)
    server.run()


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen(64)
    except OSError as error:
        listening.close()
        raise MicroreliefError(
            f"port {port} of {host} cannot be used ({error.strerror or error}): choose another one"
        ) from None
    return listening

"""The command `serve`."""

from __future__ import annotations

from pathlib import Path

from ..page import serve_pages
from ..page.sites import source_of

__all__ = ["serve"]


def serve(first: Path, /, *more: Path, host: str = "127.0.0.1", port: int = 8123) -> int:
    """Show how campaigns stand on a page for browsers, and to Prometheus: state, next scan, picture, trends, events.

    Reads stores only, whoever writes them. Listens on this machine alone; to open it to others give --host, and a token
    in the environment variable MICRORELIEF_TOKEN.

    Parameters
    ----------
    first
        Store (a folder or s3://bucket/prefix), or campaign file.
    more
        Others, for one page of them all.
    host
        Address to listen on.
    port
        Port to listen on; 0 takes a free one.

    Examples
    --------
    microrelief serve site.yaml
    microrelief serve north.yaml south.yaml lab.icechunk --port 8200
    """
    serve_pages([source_of(path) for path in (first, *more)], host, port)
    return 0

"""Serves shards as one recording: a catalog on this machine alone, from which a viewer fetches what it shows."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from . import paths
from .blueprint import Preset, review_blueprint
from .shards import Shards
from .viewer import LOCAL, end, free_port, start, viewer_program, wait_until_listening

__all__ = ["serve_shards"]


@contextmanager
def serve_shards(
    shards: Shards, preset: Preset = "overview", port: int | None = None, *, origin: str = ""
) -> Iterator[str]:
    """Serve shards on 127.0.0.1 until the context ends.

    Parameters
    ----------
    shards : Shards
    preset : str
        What is in front when a viewer opens it.
    port : int, optional
        A free one where none is given.
    origin : str
        Of a page elsewhere that may read it too: ``https://review.example.org``.

    Yields
    ------
    str
        The address to open in a viewer.
    """
    from rerun.catalog import CatalogClient

    port = free_port() if port is None else port
    # a program of its own, which ends when it is told to: a server in this one waits for its viewers to leave
    command = [str(viewer_program()), "server", "--host", LOCAL, "--port", str(port)]
    command += ["--cors-allow-origin", origin] if origin else []
    with tempfile.TemporaryDirectory(prefix="microrelief-") as folder:
        server = start(command)
        try:
            wait_until_listening(server, port)
            dataset = CatalogClient(f"rerun+http://{LOCAL}:{port}").create_dataset(paths.APPLICATION)
            uris = [file.absolute().as_uri() for file in shards.files.values()]
            dataset.register(uris, layer_name=list(shards.files)).wait()
            layout = Path(folder) / "layout.rbl"
            review_blueprint(shards.layout, preset).save(paths.APPLICATION, layout)
            dataset.register_blueprint(layout.as_uri())
            yield str(dataset.segment_url(shards.recording))
        finally:
            end(server)

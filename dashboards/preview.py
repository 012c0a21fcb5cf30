"""Preview: the newest scan in 3D while a video runs. It shows now, and keeps nothing: the review has the timeline."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from pipelines import Scan

from . import paths
from .raster import Range
from .surface import surface, triangles
from .viewer import awaiting_viewer

if TYPE_CHECKING:
    import rerun as rr

__all__ = ["Preview", "open_preview"]

TALLEST, RELIEF = 50.0, 0.1
"""Heights are drawn so much taller that the relief of the first scan is a tenth of its width, at most fifty times."""


class Preview:
    """What a viewer shows of a video; each scan takes the place of the one before."""

    def __init__(self, stream: rr.RecordingStream, link: str, viewer: subprocess.Popen[str]) -> None:
        self.link = link
        self._stream, self._viewer = stream, viewer
        self._span: Range | None = None

    def show(self, scan: Scan) -> bool:
        """Show a scan; False once somebody has closed the viewer."""
        import rerun as rr

        if self._viewer.poll() is not None:
            return False
        known = scan.height[np.isfinite(scan.height)]
        if not known.size:
            return True
        if self._span is None:
            self._span = self._begin(scan, Range(*(float(edge) for edge in np.percentile(known, (2, 98)))))
        shape = surface(scan, self._span)
        mesh = rr.Mesh3D.from_fields(
            vertex_positions=shape.positions, vertex_normals=shape.normals, vertex_colors=shape.colours
        )
        self._stream.log(f"{paths.SURFACE}/mesh", mesh, static=True)  # static: nothing adds up in the viewer
        return True

    def _begin(self, scan: Scan, span: Range) -> Range:
        import rerun as rr

        grid = scan.grid
        width = grid.pitch_mm * max(grid.rows, grid.columns)
        taller = min(TALLEST, max(1.0, RELIEF * width / max(span.high - span.low, 1e-6)))
        self._stream.log(paths.SURFACE, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._stream.log(paths.SURFACE, rr.Transform3D(scale=[1.0, 1.0, taller]), static=True)
        self._stream.log(f"{paths.SURFACE}/mesh", rr.Mesh3D.from_fields(triangle_indices=triangles(grid)), static=True)
        return span


@contextmanager
def open_preview(*, web: bool = False, port: int = 9090) -> Iterator[Preview]:
    """Open a viewer on this machine alone, in a window or for a browser.

    Parameters
    ----------
    web : bool
    port : int
        Of the page; the data come through the next one.

    Yields
    ------
    Preview
        Its `link` is what to open in a browser. The viewer ends with the context.

    Raises
    ------
    MicroreliefError
        If there is no screen, a port is taken, or the viewer does not start.
    """
    import rerun as rr
    import rerun.blueprint as rrb

    with awaiting_viewer(web=web, port=port) as (address, link, viewer):
        stream = rr.RecordingStream(paths.APPLICATION, recording_id="preview")
        layout = rrb.Blueprint(
            rrb.Spatial3DView(origin=paths.SURFACE, name="Newest scan"), collapse_panels=True, auto_views=False
        )
        stream.connect_grpc(address, default_blueprint=layout)
        try:
            yield Preview(stream, link, viewer)
        finally:
            stream.disconnect()

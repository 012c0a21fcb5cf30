"""ExternalProjector: something else projects, in step with the camera: this rig only takes the frames."""

from __future__ import annotations

from pipelines import PatternSet

from .base import Again

__all__ = ["ExternalProjector"]


class ExternalProjector:
    """For a projector that advances by the camera's strobe line, or that pulls the camera's trigger line by itself."""

    again: Again = "never"

    def open(self) -> None:
        """There is nothing to open."""

    def load(self, patterns: PatternSet) -> None:
        """The patterns are in that projector already: `microrelief patterns` writes them."""

    def show(self, frame: int) -> None:
        """That projector does so by itself; `diagnose` proves from the frames that it did."""

    def close(self) -> None:
        """There is nothing to close."""

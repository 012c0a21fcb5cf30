"""Rigs: the registry of everything that can take a capture."""

from .base import Rig

__all__ = ["Rig"]

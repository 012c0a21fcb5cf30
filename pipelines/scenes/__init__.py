"""Surfaces with closed-form truth, for the simulated rig and for tests."""

from collections.abc import Callable

from .board import Chessboard, Plane
from .crack_network import CentreLines, CrackNetwork
from .scene import Ground, Scene, SceneTruth
from .soil import Soil

__all__ = [
    "SCENES",
    "CentreLines",
    "Chessboard",
    "CrackNetwork",
    "Ground",
    "Plane",
    "Scene",
    "SceneTruth",
    "Soil",
]

SCENES: dict[str, Callable[..., Scene]] = {
    "soil": Soil,
    "board": Chessboard,
    "plane": Plane,
}
"""Every scene by name; each is made from plain keywords."""

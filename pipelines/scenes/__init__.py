"""Surfaces with closed-form truth, for the simulated rig and for tests."""

from collections.abc import Callable

from .board import Chessboard, Plane
from .crack_network import CentreLines, CrackNetwork
from .organisms import Organisms, OrganismsTruth
from .scene import Ground, Scene, SceneTruth
from .soil import Soil
from .star import Star

__all__ = [
    "SCENES",
    "CentreLines",
    "Chessboard",
    "CrackNetwork",
    "Ground",
    "Organisms",
    "OrganismsTruth",
    "Plane",
    "Scene",
    "SceneTruth",
    "Soil",
    "Star",
]

SCENES: dict[str, Callable[..., Scene]] = {
    "soil": Soil,
    "board": Chessboard,
    "plane": Plane,
    "star": Star,
    "organisms": Organisms,
}
"""Every scene by name; each is made from plain keywords."""

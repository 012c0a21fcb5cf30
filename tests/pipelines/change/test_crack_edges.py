"""Edges of cracks whose walls are known in closed form, seen through cells: bent and vertical, on plates that curl."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from pipelines.change.crack_edges import STEP, crack_edges

PARTS = 50
"""A cell is the mean over so many points."""
PHASES = 40


def profiles(half: float, power: float, depth: float, curl: float) -> npt.NDArray[np.float64]:
    """Heights from the middle outward in a crack ``depth (1 - (x / half) ** power)`` deep, shape (phase, n).

    The plate beside it rises by `curl` towards the edge, over 80 cells. Each profile lies otherwise to the raster.
    """
    cells, found = np.arange(-3, 70), []
    for phase in np.linspace(-0.5, 0.5, PHASES, endpoint=False):
        x = np.abs(cells[:, None] + phase + (np.arange(PARTS) + 0.5) / PARTS - 0.5)
        surface = curl * np.exp(-np.maximum(0, x - half) / 80) - depth * (1 - np.minimum(x / half, 1) ** power)
        found.append(np.interp(np.arange(0, 60, STEP), cells + phase, surface.mean(axis=1)))
    return np.array(found)


@pytest.mark.parametrize(("power", "within"), [(2.0, 0.06), (4.0, 0.12), (1e3, 0.15)])
@pytest.mark.parametrize("curl", [0.0, 0.2])
@pytest.mark.parametrize("half", [5.0, 8.0, 13.0, 20.0])
def test_an_edge_lies_where_the_closed_form_has_it(half: float, power: float, curl: float, within: float) -> None:
    """In the mean over how the raster lies to it: what noise and raster scatter averages out, a bias does not."""
    z = profiles(half, power, 0.4, curl)
    inside = np.broadcast_to(np.arange(0, 60, STEP) < half - 0.3, z.shape)
    edge, sigma, crossed = crack_edges(z, inside, z.min(axis=1), 0.002)
    assert crossed.all()
    assert abs(float(edge.mean()) - half) < within
    assert float(np.abs(edge - half).max()) < 4 * float(np.median(sigma))

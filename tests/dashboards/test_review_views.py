"""The review as a viewer shows it: every view of every preset is filled, and follows the time."""

from __future__ import annotations

import os
from collections.abc import Collection

import numpy as np
import pytest
from PIL import Image

from dashboards import PRESETS, Preset, Shards, serve_shards, update_shards

from .drying import DryingStore, drying_store
from .take_screenshot import Looker, Picture, coloured, looker, missing_libraries, moved

VIEWS = {"overview": 10, "cracks": 5, "curl": 4, "video": 1, "quality": 6}
"""How many each has that none before it has: the others show the same."""

LEAST = {
    "Surface by change": 0.005,
    "Surface": 0.1,
    "Baseline": 0.1,
    "Change": 0.02,
    "Height": 0.2,
    "Plates,": 0.15,
    "Visits": 0.05,
    "Camera": 0.0,
}
"""Share of a view that is coloured; of what is not named here a little: lines, texts."""

Seen = dict[str, tuple[dict[str, Picture], Picture, Picture, list[str]]]


@pytest.fixture(scope="module")
def shards(tmp_path_factory: pytest.TempPathFactory) -> tuple[DryingStore, Shards]:
    store = drying_store(6, 80)
    return store, update_shards(store, tmp_path_factory.mktemp("site") / "plot.review")


@pytest.fixture(scope="module")
def seen(shards: tuple[DryingStore, Shards], tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """For each preset its views that no earlier one has, the window at the last scan and at the second, complaints."""
    lacking = missing_libraries()
    if lacking and not os.environ.get("MICRORELIEF_REQUIRE_SCREENSHOTS"):
        pytest.skip(lacking)
    found: Seen = {}
    folder = tmp_path_factory.mktemp("pictures")
    with looker(size="1000x640") as look:
        for preset in PRESETS:
            with serve_shards(shards[1], preset) as address:
                found[preset] = _look(look, address, {name for views, *_ in found.values() for name in views})
            Image.fromarray(found[preset][1]).save(folder / f"{preset}.png")
    return found


def _look(look: Looker, address: str, known: Collection[str]) -> tuple[dict[str, Picture], Picture, Picture, list[str]]:
    look.open(address)
    look.show(scan=5)
    late = look.picture()
    views = look.pictures(known)
    look.show(scan=1)
    return views, late, look.picture(), look.complaints()


@pytest.mark.parametrize("preset", PRESETS)
def test_every_view_is_filled_and_none_complains(preset: Preset, seen: Seen) -> None:
    views, _, _, complaints = seen[preset]
    assert complaints == []
    assert len(views) == VIEWS[preset], sorted(views)
    for name, picture in views.items():
        wanted = next((share for start, share in LEAST.items() if name.startswith(start)), 0.0005)
        if "of this scan" not in name and "provenance" not in name:  # texts are grey
            assert coloured(picture) >= wanted, f"{name} shows nothing"
        assert picture.std() > 6, f"{name} is blank"


@pytest.mark.parametrize("preset", PRESETS)
def test_what_is_shown_follows_the_time(preset: Preset, seen: Seen) -> None:
    _, late, early, _ = seen[preset]
    assert moved(late, early) > 0.005


def test_cells_that_were_not_measured_are_holes_in_the_surface(seen: Seen) -> None:
    """The round hole of the synthetic crust shows the view's background inside the surface."""
    picture = seen["overview"][0]["Surface now, mm"].astype(int)
    surface = picture.max(axis=-1) - picture.min(axis=-1) > 40
    inside = np.logical_and.reduce(
        [
            np.maximum.accumulate(surface, axis=0),
            np.maximum.accumulate(surface[::-1], axis=0)[::-1],
            np.maximum.accumulate(surface, axis=1),
            np.maximum.accumulate(surface[:, ::-1], axis=1)[:, ::-1],
        ]
    )
    background = np.abs(picture - np.array([24, 26, 30])).max(axis=-1) <= 2
    share = (inside & background).sum() / inside.sum()
    # the disc has 1.1 % of the area, the lone holes 0.1 % (each opens the triangles around it, of coarser cells)
    assert 0.005 < share < 0.04

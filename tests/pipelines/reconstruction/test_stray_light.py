"""Light from elsewhere: what it would misplace is refused, what it does not touch is kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipelines import PatternSet
from pipelines.reconstruction import decode

from .scattered_light import Stray, take_scattered
from .synthetic_capture import slanted

GRAY = PatternSet("gray", (200, 150), bits=(8, 8))
SHADE = Stray(share=0.3, blur_px=3.0, shift_px=5.0, direct=0.0)


def judged(stray: Stray, lens_px: float) -> tuple[float, int, float]:
    """Share kept of the pixels that the stray light reaches, gross errors anywhere, share kept of the others."""
    view = replace(slanted(120, 300, GRAY.size), light=90.0, noise=1.0, blur_px=lens_px)
    frames, reached = take_scattered(view, GRAY, stray)
    found = decode(frames)
    kept = np.isfinite(found.column) & np.isfinite(found.row)
    off = np.maximum(np.abs(found.column - view.column), np.abs(found.row - view.row))
    gross = int((kept & (off > 2 * 2.0**found.level)).sum())
    print(
        f"lens {lens_px}, {stray}: kept {kept[reached].mean():.3f}, gross {gross}, others {kept[~reached].mean():.3f}"
    )
    return float(kept[reached].mean()), gross, float(kept[~reached].mean())


@pytest.mark.parametrize(
    ("stray", "lens_px", "least"),
    [
        (Stray(share=0.8, blur_px=0.5, shift_px=5.0), 0.5, 0.6),
        (Stray(share=0.8, blur_px=2.0, shift_px=5.0), 0.5, 0.8),
        (Stray(share=0.5, blur_px=0.5, shift_px=5.0), 1.2, 0.5),
        (Stray(share=0.2, blur_px=0.5, shift_px=5.0), 1.6, 0.98),
        (Stray(share=0.8, blur_px=0.5, shift_px=5.0), 1.6, 0.0),  # it drowns what the lens leaves of the stripes
    ],
)
def test_a_wall_that_mirrors_light_misplaces_nothing(stray: Stray, lens_px: float, least: float) -> None:
    kept, gross, others = judged(stray, lens_px)
    assert gross == 0
    assert kept >= least
    assert others >= 0.999


@pytest.mark.parametrize(("lens_px", "direct", "least"), [(1.6, 1.0, 0.98), (0.5, 0.3, 0.95), (0.5, 0.1, 0.0)])
def test_light_scattered_inside_the_soil_misplaces_nothing(lens_px: float, direct: float, least: float) -> None:
    """Below the surface the pattern spreads in place; where hardly any light is direct nothing need be measured."""
    kept, gross, others = judged(Stray(share=0.8, blur_px=6.0, direct=direct), lens_px)
    assert gross == 0
    assert kept >= least
    assert others >= 0.999


@pytest.mark.parametrize(("lens_px", "stray"), [(0.5, SHADE), (1.2, SHADE), (1.2, replace(SHADE, blur_px=1.6))])
def test_a_shadow_lit_by_a_wall_is_not_measured(lens_px: float, stray: Stray) -> None:
    """Such light has lost the finest stripes; where only they are lost, coarser ones would place it on the wall."""
    kept, gross, others = judged(stray, lens_px)
    assert gross <= 2, "1e-4 of the 21,000 that are kept"
    assert kept <= 1e-3
    assert others >= 0.98


def test_a_surface_out_of_focus_beside_a_sharp_one_is_kept() -> None:
    kept, gross, others = judged(Stray(share=1.0, blur_px=3.0, direct=0.0), 0.5)
    assert gross == 0
    assert kept > 0.9
    assert others > 0.99

"""White looks wider than black: pairs do not know it; without inverses the level of the stripes' ends is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.stats import norm

from pipelines import Frames, PatternSet
from pipelines.reconstruction import decode, refine
from pipelines.reconstruction.decode import GrayPass

from .synthetic_capture import NOON, slanted

Floats = npt.NDArray[np.float64]
FINE = 16  # points drawn per projector px
PAIRS = PatternSet("gray", (200, 150), bits=(8, 8))
ALONE = PatternSet("gray", (200, 150), bits=(8, 8), complementary=False)


@dataclass(frozen=True)
class Seen:
    """A capture, where its pixels look, and what was decoded of it."""

    frames: Frames
    column: Floats
    row: Floats

    def judge(self, level: bool = True) -> tuple[float, float, float]:
        """Share of pixels decoded, share of these more than 1.5 px off, and the largest mean error of a kind of cell.

        Cells are of four kinds that alternate; without `level` stripes are taken to end half between white and black.
        """
        with pytest.MonkeyPatch.context() as patch:
            if not level:
                patch.setattr(GrayPass, "levels", lambda *_: (0.0, 0.0))
            found = refine(self.frames, decode(self.frames))
        kept, gross, bias = [], [], []
        for place, truth in ((found.column, self.column), (found.row, self.row)):
            inner = np.s_[4:-4, 4:-4]
            error, kind = (place - truth)[inner], np.floor(truth + 0.5).astype(int)[inner] % 4
            known = np.isfinite(error)
            kept.append(known.mean())
            gross.append((np.abs(error[known]) > 1.5).mean())
            bias.append(max(abs(float(np.mean(error[known & (kind == n)]))) for n in range(4)))
        return float(np.mean(kept)), float(np.mean(gross)), max(bias)


def see(patterns: PatternSet, gamma: float, blur_px: float, narrower_px: float = 0.0) -> Seen:
    """What a camera sees of stripes that a lens blurs, after which gamma makes them unequal.

    `narrower_px` is taken off each side of the white stripes, to fractions of a pixel by a grey one.
    """
    view, random, seen = slanted(70, 260, patterns.size), np.random.default_rng(0), []
    for image, role in zip(patterns.images().astype(np.float64) / 255, patterns.roles, strict=True):
        line, at = (image[:, 0], view.row) if role.axis == "rows" else (image[0], view.column)
        drawn = gaussian_filter1d(np.repeat(_narrower(line, narrower_px), FINE), FINE * blur_px, mode="nearest")
        seen.append(np.interp(FINE * at + (FINE - 1) / 2, np.arange(drawn.size), drawn) ** (1 / gamma))
    value = 12 + 160 * np.stack(seen) + 0.5 * random.standard_normal((len(seen), *view.row.shape))
    return Seen(Frames(np.clip(np.rint(value), 0, 255).astype(np.uint8), NOON, patterns), view.column, view.row)


def _narrower(line: Floats, by: float) -> Floats:
    out = line.copy()
    for edge in np.flatnonzero(np.diff(line)):
        white, way = (edge + 1, 1) if line[edge + 1] > line[edge] else (edge, -1)
        for n in range(2):
            if 0 <= white + n * way < line.size and line[white + n * way]:
                out[white + n * way] -= min(max(by - n, 0), 1)
    return np.clip(out, 0, 1)


@pytest.mark.parametrize("gamma", [1.0, 1.8])
def test_it_moves_no_edge_of_pairs(gamma: float) -> None:
    assert see(PAIRS, gamma, 0.6).judge()[2] < 0.02


@pytest.mark.parametrize("blur_px", [0.6, 1.0, 1.5])
@pytest.mark.parametrize("gamma", [1.8, 2.2])
def test_without_inverses_the_measured_level_does_more_than_narrower_stripes(gamma: float, blur_px: float) -> None:
    """Stripes so much narrower that a single edge lies at half between white and black where it belongs."""
    narrower = -blur_px * float(norm.ppf(0.5**gamma))
    wide = see(ALONE, gamma, blur_px)
    before, now = wide.judge(level=False), wide.judge()
    narrow = see(ALONE, gamma, blur_px, narrower)
    half, both = narrow.judge(level=False), narrow.judge()
    ways = {"half": before, "measured": now, "narrower": half, "narrower, measured": both}
    for what, (kept, gross, bias) in ways.items():
        print(f"gamma {gamma}, blur {blur_px} px, {what}: {kept:.1%} kept, {gross:.2%} gross, bias {bias:.3f} px")
    assert now[0] > 0.99
    assert now[1] == 0
    assert now[2] < 0.05
    assert now[2] < before[2] / 3
    assert all(other[0] <= now[0] + 1e-3 and other[2] >= now[2] - 0.01 for other in (half, both))


def test_even_light_needs_no_level() -> None:
    seen = see(ALONE, 1.0, 0.6)
    assert decode(seen.frames).levels == (0, 0)  # type: ignore[attr-defined]
    assert seen.judge()[2] < 0.02

"""The drawing of docs/change.md that shows what lift, angle and curvature of a plate are: `python -m` this file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipelines.change.curl import EDGE_BAND_MM, INTERIOR_SHARE
from pipelines.change.plates import CURVED_MM

PICTURE = Path(__file__).parents[3] / "docs" / "images" / "curl.svg"
LIFT_MM, DECAY_MM = 0.25, 0.8
DEEPEST_MM = 1.8
"""From the crack's edge to the middle of the plate that is drawn."""
X0, Y0, X_SCALE, Y_SCALE = 90.0, 250.0, 290.0, 560.0
INK, SOIL, EDGE, INNER, LINE = "#333", "#d9c7a8", "#c0504d", "#4f81bd", "#2e7d32"


def drawing() -> str:
    """Give the SVG: a cut through a plate at the baseline and now, bands and lines where the code has them."""

    def at(d: float, rise: float) -> tuple[float, float]:
        return X0 + X_SCALE * d, Y0 - Y_SCALE * rise

    def rise(d: float) -> float:
        return LIFT_MM * float(np.exp(-d / DECAY_MM))

    def path(points: list[tuple[float, float]]) -> str:
        return "M" + " L".join(f"{x:.1f} {y:.1f}" for x, y in points)

    def text(x: float, y: float, words: str, colour: str = INK, anchor: str = "middle") -> str:
        return f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" text-anchor="{anchor}">{words}</text>'

    distances = np.linspace(0, DEEPEST_MM, 60).tolist()
    top = [at(d, rise(d)) for d in distances]
    flat = [at(0, 0), at(DEEPEST_MM, 0)]
    band, inner = EDGE_BAND_MM, (INTERIOR_SHARE * DEEPEST_MM, DEEPEST_MM)
    means = [float(np.mean([rise(d) for d in np.linspace(*ends, 50)])) for ends in (band, inner)]
    near = np.linspace(*band, 50)
    slope, level = np.polyfit(near, [rise(d) for d in near], 1)
    wide = np.linspace(*CURVED_MM, 80)
    bend = np.poly1d(np.polyfit(wide, [rise(d) for d in wide], 2))
    line = [at(d, level + slope * d) for d in (-0.12, 0.5)]
    bottom = Y0 + 70
    x_edge, x_end = at(0, 0)[0], at(DEEPEST_MM, 0)[0]
    arrow = x_end + 30
    parts = [
        f'<path d="{path([*top, (x_end, bottom), (x_edge, bottom)])} Z" fill="{SOIL}"/>',
        f'<path d="{path(flat)}" stroke="{INK}" stroke-dasharray="6 4"/>',
        f'<path d="{path(top)}" fill="none" stroke="{INK}" stroke-width="2"/>',
    ]
    for (low, high), mean, colour in ((band, means[0], EDGE), (inner, means[1], INNER)):
        (x_low, y_mean), (x_high, _) = at(low, mean), at(high, mean)
        parts += [
            f'<rect x="{x_low:.1f}" y="{y_mean:.1f}" width="{x_high - x_low:.1f}" height="{bottom - y_mean:.1f}" '
            f'fill="{colour}" opacity="0.18"/>',
            f'<path d="M{x_low:.1f} {y_mean:.1f} H{x_high:.1f}" stroke="{colour}" stroke-width="3"/>',
            f'<path d="M{x_high:.1f} {y_mean:.1f} H{arrow:.1f}" stroke="{colour}" stroke-dasharray="2 3"/>',
        ]
    curve = [at(d, float(bend(d))) for d in wide.tolist()]
    parts += [
        f'<path d="{path(line)}" stroke="{EDGE}" stroke-width="1.5"/>',
        f'<path d="{path(curve)}" fill="none" stroke="{LINE}" stroke-width="4" opacity="0.45"/>',
        f'<path d="M{arrow:.1f} {at(0, means[0])[1]:.1f} V{at(0, means[1])[1]:.1f}" stroke="{INK}" stroke-width="2"/>',
        text(arrow + 8, (at(0, means[0])[1] + at(0, means[1])[1]) / 2 + 5, "lift", anchor="start"),
        text(line[0][0] + 8, line[0][1] - 14, "angle: slope of the edge band", EDGE, "start"),
        text(curve[-1][0] + 6, curve[-1][1] - 12, "curvature: of this parabola", LINE, "start"),
        text(at(sum(band) / 2, 0)[0], bottom + 20, f"edge {band[0]} to {band[1]} mm", EDGE),
        text(at(sum(inner) / 2, 0)[0], bottom + 20, f"interior: d above {INTERIOR_SHARE} of its greatest", INNER),
        text(x_end - 6, Y0 - 8, "baseline", anchor="end"),
        text(x_edge - 10, bottom - 30, "crack", anchor="end"),
        f'<path d="M{x_edge:.1f} {bottom + 34:.1f} H{x_end:.1f}" stroke="{INK}"/>',
        text((x_edge + x_end) / 2, bottom + 52, "d, distance to the crack's edge"),
    ]
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 720 390" role="img" font-family="sans-serif" '
        'font-size="14" fill="none"><title>Lift, angle and curvature of a plate</title>'
        '<rect width="720" height="390" fill="#fff"/>\n' + "\n".join(parts) + "\n</svg>\n"
    )


if __name__ == "__main__":
    PICTURE.write_text(drawing(), encoding="utf-8")
    print(f"wrote {PICTURE}")

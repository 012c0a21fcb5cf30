"""A calibration as one offline page: the verdict, residual vectors per pose, coverage of both fields, tables."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from pipelines import Calibration
from pipelines.reconstruction import BoardCheck, CornerResidual, PoseResidual, calibration_verdict

from .page import page_style
from .quantities import plain

__all__ = ["calibration_page"]

WIDTH = 420  # of a picture, px
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#8a7f00", "#7f7f7f")  # Okabe and Ito's
LOST = "#D55E00"
VECTOR_SHARE = 0.05  # of the picture's width: the length of an arrow of the typical error


def calibration_page(calibration: Calibration) -> str:
    """Make the page.

    Parameters
    ----------
    calibration : Calibration
        With the residuals of its corners; one from before they were kept gives the tables alone.

    Returns
    -------
    str
        HTML that needs nothing else.
    """
    lines = calibration_verdict(calibration)
    tone = "green" if len(lines) == 1 and calibration.rms_px["stereo"] < 0.5 else "amber"
    tone = "red" if calibration.rms_px["stereo"] >= 1.0 else tone
    parts = [
        _section("Verdict", "".join(f"<p>{escape(line)}</p>" for line in lines), f"verdict {tone}"),
        _section("Residuals", _residuals(calibration)),
        _section("Coverage", _coverage(calibration)),
        _section("Boards measured in 3D", _boards(calibration)),
        _section("Uncertainty", _uncertainty(calibration)),
        _section("Provenance", _provenance(calibration)),
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,">'
        f"<title>Calibration {calibration.id}</title><style>{page_style()}\n{EXTRA}</style></head>\n"
        f'<body><header><p class="kind">Calibration report</p><h1>{escape(calibration.id)}</h1></header>\n'
        f"<main>{''.join(parts)}</main></body></html>\n"
    )


EXTRA = """
.pictures { display: flex; flex-wrap: wrap; gap: 1rem; align-items: flex-start; }
.pictures figure { margin: 0; flex: 0 1 420px; }
.pictures svg { width: 100%; height: auto; background: rgba(128, 128, 128, 0.08); }
.pictures svg text { fill: currentColor; font: 13px sans-serif; }
"""


def _section(title: str, body: str, kind: str = "") -> str:
    if kind:
        word = {"green": "good", "amber": "look", "red": "bad"}[kind.split()[-1]]
        return f'<section class="{kind}"><p class="lamp">{word}</p><div><h2>{title}</h2>{body}</div></section>\n'
    return f"<section><h2>{title}</h2>{body}</section>\n"


def _residuals(calibration: Calibration) -> str:
    shown = [pose for pose in calibration.poses if pose.corners]
    rows = [
        [
            pose.name,
            f"{pose.camera_px:.3f}",
            f"{pose.projector_px:.3f}",
            f"{pose.kept} of {pose.found}",
            pose.advice or "counts",
        ]
        for pose in calibration.poses
    ]
    table = _table(("Pose", "Camera rms, px", "Projector rms, px", "Corners kept", "Use"), rows)
    if not shown:
        return table + "<p>This calibration keeps no residuals of its corners: calibrate again to see them.</p>"
    used = [c for pose in shown for c in pose.corners if c.used]
    size = calibration.camera.size
    typical = float(np.sqrt(np.mean([c.off_column**2 + c.off_row**2 for c in used]))) if used else 1.0
    gain = VECTOR_SHARE * size[0] / max(typical, 1e-6)
    figures = [
        _figure(
            _svg(size, _arrows(pose.corners, gain, size)),
            f"{pose.name}: camera, arrows drawn {gain:.0f} times as long; crosses were left out",
        )
        for pose in shown
    ]
    said = f"An arrow points from where the fit puts a corner to where it was seen. Typical length {typical:.3f} px."
    return f'{table}<p class="prose">{said}</p><div class="pictures">{"".join(figures)}</div>'


def _arrows(corners: Sequence[CornerResidual], gain: float, size: tuple[int, int]) -> str:
    scale = WIDTH / size[0]
    parts = []
    for corner in corners:
        x, y = corner.column * scale, corner.row * scale
        if corner.used:
            dx, dy = corner.off_column * gain * scale, corner.off_row * gain * scale
            parts.append(f'<path d="M{x:.1f} {y:.1f}l{dx:.1f} {dy:.1f}" stroke="{COLOURS[0]}" stroke-width="1.5"/>')
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.6" fill="{COLOURS[0]}"/>')
        else:
            parts.append(
                f'<path d="M{x - 4:.1f} {y - 4:.1f}l8 8m0 -8l-8 8" stroke="{LOST}" stroke-width="2" fill="none"/>'
            )
    return "".join(parts)


def _coverage(calibration: Calibration) -> str:
    shown = [pose for pose in calibration.poses if pose.corners]
    if not shown:
        return "<p>Not known: this calibration keeps no corners.</p>"
    camera = "".join(_dots(pose, n, calibration.camera.size, False) for n, pose in enumerate(shown))
    projector = "".join(_dots(pose, n, calibration.projector.size, True) for n, pose in enumerate(shown))
    seen = _share([(c.column, c.row) for pose in shown for c in pose.corners if c.used], calibration.camera.size)
    lit = _share(
        [
            (c.projector_column, c.projector_row)
            for pose in shown
            for c in pose.corners
            if c.used and c.projector_column is not None and c.projector_row is not None
        ],
        calibration.projector.size,
    )
    words = (
        "Heights outside what the corners cover are extrapolated: tilt and move the board until it has been everywhere."
    )
    return (
        f'<p class="prose">{words}</p><div class="pictures">'
        + _figure(_svg(calibration.camera.size, camera), f"camera: corners reach {seen:.0%} of the image")
        + _figure(_svg(calibration.projector.size, projector), f"projector: corners reach {lit:.0%} of the image")
        + "</div><p>"
        + " ".join(
            f'<span style="color:{COLOURS[n % len(COLOURS)]}">&#9679;</span> {escape(pose.name)}'
            for n, pose in enumerate(shown)
        )
        + "</p>"
    )


def _dots(pose: PoseResidual, n: int, size: tuple[int, int], projector: bool) -> str:
    scale = WIDTH / size[0]
    parts = []
    for c in pose.corners:
        at = (c.projector_column, c.projector_row) if projector else (c.column, c.row)
        if c.used and at[0] is not None and at[1] is not None:
            where = f'cx="{at[0] * scale:.1f}" cy="{at[1] * scale:.1f}"'
            parts.append(f'<circle {where} r="2.4" fill="{COLOURS[n % len(COLOURS)]}" fill-opacity="0.8"/>')
    return "".join(parts)


def _share(points: Sequence[tuple[float, float]], size: tuple[int, int], cells: int = 8) -> float:
    """Share of 8x8 fields of an image that hold a corner."""
    if not points:
        return 0.0
    at = np.array(points) / np.array(size) * cells
    hit = {(int(x), int(y)) for x, y in at if 0 <= x < cells and 0 <= y < cells}
    return len(hit) / cells**2


def _boards(calibration: Calibration) -> str:
    head = ("Board", "Flat to (robust sd), um", "Square, mm", "Its sd, um", "Squares")

    def rows(checks: Sequence[BoardCheck]) -> list[list[str]]:
        return [
            [c.name, plain(1000 * c.flatness_mm), f"{c.square_mm:.5g}", plain(1000 * c.square_sd_mm), str(c.squares)]
            for c in checks
        ]

    body = ""
    if calibration.held_out:
        body += "<h3>By the calibration from all other poses</h3>" + _table(head, rows(calibration.held_out))
    if calibration.squares:
        body += "<h3>In its own pose</h3>" + _table(head, rows(calibration.squares))
    return body or "<p>Not kept with this calibration.</p>"


def _uncertainty(calibration: Calibration) -> str:
    sigma = calibration.sigma
    if not sigma:
        return "<p>Not kept with this calibration.</p>"
    field = sigma["field"]
    rows = [
        ["scale of heights", f"{plain(field['height_scale_percent'], 2)} %"],
        ["scale of lengths", f"{plain(field['lateral_scale_percent'], 2)} %"],
        ["bow of a plane where the board was", f"{plain(field['bow_um'], 2)} um"],
        ["bow of a plane over the whole image", f"{plain(field['bow_image_um'], 2)} um"],
    ]
    body = _table(("What calibration adds to heights", "Standard uncertainty"), rows)
    lens_rows = []
    for who, lens in (("camera", calibration.camera), ("projector", calibration.projector)):
        K = lens.K
        values = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
        values |= dict(zip(("k1", "k2", "p1", "p2"), lens.dist[:4], strict=True))
        lens_rows += [[f"{who} {name}", f"{value:.6g}", f"{sigma[who][name]:.2g}"] for name, value in values.items()]
    for n, axis in enumerate("xyz"):
        lens_rows.append([f"camera to projector {axis}, mm", f"{calibration.t_mm[n]:.6g}", f"{sigma['t_mm'][n]:.2g}"])
    weak = "".join(f"<p>{escape(words)}: no harm to heights beyond the table above.</p>" for words in sigma["weak"])
    return body + weak + _table(("Parameter", "Value", "Standard uncertainty"), lens_rows)


def _provenance(calibration: Calibration) -> str:
    board = calibration.board or {}
    told = ", ".join(f"{name} {value}" for name, value in board.items())
    rows = [["id", calibration.id], ["board", told], ["software", calibration.software or "not told"]]
    return _table(("", ""), rows)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    top = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def _svg(size: tuple[int, int], body: str) -> str:
    height = WIDTH * size[1] / size[0]
    box = f'viewBox="0 0 {WIDTH} {height:.1f}"'
    frame = f'<rect x="0.5" y="0.5" width="{WIDTH - 1}" height="{height - 1:.1f}" fill="none" stroke="#888"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {box} role="img">{frame}{body}</svg>'


def _figure(svg: str, caption: str) -> str:
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"

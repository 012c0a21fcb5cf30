"""Optics: the geometry of a camera and a projector at an angle (the paper's section 3), one formula per figure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields

from .optics_limits import blur_um, diffraction_contrast, disc_contrast, overlap_area_mm2

__all__ = ["CHIPS", "FORMULAS", "PAPER_SETUP", "Figure", "Formula", "OpticsSetup", "conflicts", "work_out"]


@dataclass(frozen=True, slots=True)
class Chip:
    """A projector's mirror array: columns, rows, and its size in mm."""

    size: tuple[int, int]
    size_mm: tuple[float, float]


CHIPS: dict[str, Chip] = {
    "DLP3000": Chip((608, 684), (6.5718, 3.6990)),
    "DLP3010": Chip((1280, 720), (6.912, 3.888)),
}
"""Mirror arrays by name, from Texas Instruments' data sheets (DLPS022, DLPS053): 7.637 um diamond, 5.4 um square."""


@dataclass(frozen=True, slots=True)
class OpticsSetup:
    """What is known of a rig; None is unknown, and no figure is made up from it.

    Parameters
    ----------
    theta_deg : float, optional
        Angle between the axes of camera and projector.
    working_distance_mm, lens_radius_mm, filter_mm : float, optional
        Along each axis from its lens to the object; outer radius of the lens; thickness of the filter before it.
    na_camera, na_projector : float, optional
        Working numerical apertures, on the side of the object.
    wavelength_nm : float, optional
    field_mm : (float, float), optional
        Field of view on the object, across (the direction of the angle) and along.
    depth_of_field_mm : float, optional
        Whole extent: the paper's +-3 mm is 6.
    camera, projector : (int, int), optional
        Columns, rows.
    chip : str, optional
        Mirror array of the projector, a name in `CHIPS`.
    magnification_camera, magnification_projector : float, optional
    camera_pitch_um : float, optional
        Pixel on the sensor.
    line_um : float, optional
        Line width that is to be resolved.

    Raises
    ------
    ValueError
        A figure is impossible.
    """

    theta_deg: float | None = None
    working_distance_mm: float | None = None
    lens_radius_mm: float | None = None
    filter_mm: float | None = None
    na_camera: float | None = None
    na_projector: float | None = None
    wavelength_nm: float | None = None
    field_mm: tuple[float, float] | None = None
    depth_of_field_mm: float | None = None
    camera: tuple[int, int] | None = None
    projector: tuple[int, int] | None = None
    chip: str | None = None
    magnification_camera: float | None = None
    magnification_projector: float | None = None
    camera_pitch_um: float | None = None
    line_um: float | None = None

    def __post_init__(self) -> None:
        for name, value in self.known().items():
            for number in value if isinstance(value, tuple) else (value,):
                if not isinstance(number, str) and not (math.isfinite(number) and number > 0):
                    raise ValueError(f"{name}: must be above 0, not {number}")
        if self.theta_deg is not None and self.theta_deg >= 180:
            raise ValueError(f"theta_deg: must be below 180, not {self.theta_deg}")
        for name in ("na_camera", "na_projector"):
            value = getattr(self, name)
            if value is not None and value >= 1:
                raise ValueError(f"{name}: must be below 1 in air, not {value}")
        if self.chip is not None and self.chip not in CHIPS:
            raise ValueError(f"chip: no array {self.chip!r}; there are {', '.join(CHIPS)}")

    def known(self) -> dict[str, float | str | tuple[float, float]]:
        """What was given, by name."""
        given = {each.name: getattr(self, each.name) for each in fields(self)}
        return {name: value for name, value in given.items() if value is not None}


PAPER_SETUP = OpticsSetup(
    theta_deg=31.0,
    working_distance_mm=100.0,
    na_camera=0.1,
    na_projector=0.25,
    field_mm=(10.0, 10.0),
    depth_of_field_mm=6.0,
    camera=(2560, 1440),
    projector=(608, 684),
    chip="DLP3010",
    magnification_camera=2.0,
    magnification_projector=20.0,
    line_um=15.0,
)
"""What the paper states in its sections 3, 4.2 and 5. It gives no lens radius, filter, wavelength or sensor pitch."""


@dataclass(frozen=True, slots=True)
class Formula:
    """How one figure follows from others: `needs` names inputs of `OpticsSetup` and figures above it."""

    name: str
    unit: str
    about: str
    text: str
    source: str
    needs: tuple[str, ...]
    compute: Callable[..., float]


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure that was worked out, or (`value` None) the inputs that are `missing` for it."""

    formula: Formula
    value: float | None
    missing: tuple[str, ...] = ()


def _half(theta: float) -> float:
    return math.radians(theta / 2)


PAPER, PINHOLE, ABBE, NIKON = (
    "the paper, section 3",
    "trigonometry of straight rays",
    "Abbe's limit",
    "Nikon MicroscopyU",
)
FORMULAS: tuple[Formula, ...] = (
    Formula(
        "largest_lens_radius", "mm", "lenses of this radius just touch", "l tan(theta/2)", PAPER,
        ("working_distance_mm", "theta_deg"), lambda far, t: far * math.tan(_half(t)),
    ),
    Formula(
        "least_theta", "deg", "at this angle the lenses just touch", "2 arctan(r/l)", PAPER,
        ("lens_radius_mm", "working_distance_mm"), lambda r, far: 2 * math.degrees(math.atan(r / far)),
    ),
    Formula(
        "lens_gap", "mm", "between the rims of the two lenses; below 0 they collide",
        "2 (l sin(theta/2) - r cos(theta/2))", PINHOLE, ("working_distance_mm", "lens_radius_mm", "theta_deg"),
        lambda far, r, t: 2 * (far * math.sin(_half(t)) - r * math.cos(_half(t))),
    ),
    Formula(
        "height_over_object", "mm", "lens centres over the object, before lens radius and filter",
        "l cos(theta/2)", "the paper, section 5.3", ("working_distance_mm", "theta_deg"),
        lambda far, t: far * math.cos(_half(t)),
    ),
    Formula(
        "free_height", "mm", "between the object and the lowest rim of lens and filter",
        "(l - filter) cos(theta/2) - r sin(theta/2)", PINHOLE,
        ("working_distance_mm", "filter_mm", "lens_radius_mm", "theta_deg"),
        lambda far, f, r, t: (far - f) * math.cos(_half(t)) - r * math.sin(_half(t)),
    ),
    Formula(
        "sharp_width", "mm", "flat object within both fields and both depths of field",
        "min(field/cos(theta/2), depth/sin(theta/2))", PINHOLE, ("field_mm", "depth_of_field_mm", "theta_deg"),
        lambda w, d, t: min(w[0] / math.cos(_half(t)), d / math.sin(_half(t))),
    ),
    Formula(
        "sharp_height", "mm", "relief that both hold sharp in the middle of the field",
        "min(depth/cos(theta/2), field/sin(theta/2))", PINHOLE, ("field_mm", "depth_of_field_mm", "theta_deg"),
        lambda w, d, t: min(d / math.cos(_half(t)), w[0] / math.sin(_half(t))),
    ),
    Formula(
        "overlap_share", "1", "overlap of the two tilted boxes (field x depth of field), share of one of them",
        "area of the intersection / (field depth)", PINHOLE, ("field_mm", "depth_of_field_mm", "theta_deg"),
        lambda w, d, t: overlap_area_mm2(w[0], d, t) / (w[0] * d),
    ),
    Formula(
        "camera_pixel", "um", "camera pixel on the object, where the whole field is in the picture",
        "max(field across / columns, field along / rows)", PINHOLE, ("field_mm", "camera"),
        lambda w, n: 1000 * max(w[0] / n[0], w[1] / n[1]),
    ),
    Formula(
        "projector_pixel", "um", "projector column on the object", "field across / columns", PINHOLE,
        ("field_mm", "projector"), lambda w, n: 1000 * w[0] / n[0],
    ),
    Formula(
        "depth_per_camera_pixel", "um", "height that shifts the pattern by one camera pixel",
        "camera_pixel / tan(theta)", PINHOLE, ("camera_pixel", "theta_deg"),
        lambda p, t: p / math.tan(math.radians(t)),
    ),
    Formula(
        "depth_per_projector_pixel", "um", "height between two projector columns; their width across the beam is "
        "projector_pixel cos(theta)", "projector_pixel cos(theta) / sin(theta)", PINHOLE,
        ("projector_pixel", "theta_deg"), lambda p, t: p / math.tan(math.radians(t)),
    ),
    Formula(
        "depth_sd_whole_columns", "um", "standard deviation of heights decoded to whole columns",
        "depth_per_projector_pixel / sqrt(12)", "variance of a uniform distribution",
        ("depth_per_projector_pixel",), lambda d: d / math.sqrt(12),
    ),
    Formula(
        "cut_off_period", "um", "line pairs finer than this have no contrast in the camera",
        "wavelength / (2 NA)", ABBE, ("wavelength_nm", "na_camera"), lambda wave, a: wave / 1000 / (2 * a),
    ),
    Formula(
        "finest_stripe_period", "um", "stripe pairs finer than this are not projected", "wavelength / (2 NA)", ABBE,
        ("wavelength_nm", "na_projector"), lambda wave, a: wave / 1000 / (2 * a),
    ),
    Formula(
        "least_na_for_line", "1", "below this aperture the line has no contrast even in focus",
        "wavelength / (4 line)", ABBE, ("wavelength_nm", "line_um"), lambda wave, w: wave / 1000 / (4 * w),
    ),
    Formula(
        "camera_blur", "um", "disc at either end of the depth of field", "2 NA depth/2", PINHOLE,
        ("na_camera", "depth_of_field_mm"), lambda a, d: blur_um(a, d / 2),
    ),
    Formula(
        "projector_blur", "um", "disc at either end of the depth of field", "2 NA depth/2", PINHOLE,
        ("na_projector", "depth_of_field_mm"), lambda a, d: blur_um(a, d / 2),
    ),
    Formula(
        "largest_na_camera", "1", "aperture that blurs by 2 camera pixels at either end of the depth of field",
        "2 camera_pixel / depth", PINHOLE, ("camera_pixel", "depth_of_field_mm"), lambda p, d: 2 * p / 1000 / d,
    ),
    Formula(
        "largest_na_projector", "1", "aperture that blurs by 2 projector pixels at either end of the depth of field",
        "2 projector_pixel / depth", PINHOLE, ("projector_pixel", "depth_of_field_mm"), lambda p, d: 2 * p / 1000 / d,
    ),
    Formula(
        "depth_of_field_by_na", "mm", "depth of field that the camera's aperture and pixel allow",
        "wavelength / NA^2 + camera_pixel / NA", NIKON, ("wavelength_nm", "na_camera", "camera_pixel"),
        lambda wave, a, p: wave / 1e6 / a**2 + p / 1000 / a,
    ),
    Formula(
        "contrast_in_focus", "1", "contrast of the line in the camera, diffraction alone",
        "2/pi (arccos s - s sqrt(1 - s^2)), s = cut_off_period / (2 line)", "Goodman, Fourier Optics, 6.4",
        ("cut_off_period", "line_um"), lambda c, w: diffraction_contrast(c / (2 * w)),
    ),
    Formula(
        "contrast_at_depth_end", "1", "contrast of the line at either end of the depth of field",
        "contrast_in_focus |2 J1(a) / a|, a = pi camera_blur / (2 line)", "Goodman, Fourier Optics, 6.4",
        ("contrast_in_focus", "camera_blur", "line_um"), lambda c, b, w: c * disc_contrast(b / (2 * w)),
    ),
    Formula(
        "projected_width", "mm", "the mirror array on the object", "array width / magnification", PINHOLE,
        ("chip", "magnification_projector"), lambda c, m: CHIPS[c].size_mm[0] / m,
    ),
    Formula(
        "imaged_width", "mm", "the sensor on the object", "columns pitch / magnification", PINHOLE,
        ("camera", "camera_pitch_um", "magnification_camera"), lambda n, p, m: n[0] * p / 1000 / m,
    ),
)  # fmt: skip
"""Every figure, in the order in which they are worked out."""


def work_out(setup: OpticsSetup) -> dict[str, Figure]:
    """Work out each figure that the inputs allow; the others name what is missing.

    Returns
    -------
    dict of str to Figure
        In the order of `FORMULAS`.
    """
    known: dict[str, object] = dict(setup.known())
    figures: dict[str, Figure] = {}
    for formula in FORMULAS:
        missing: dict[str, None] = {}
        for need in formula.needs:
            if need in figures:
                missing.update(dict.fromkeys(figures[need].missing))
            elif need not in known:
                missing[need] = None
        if missing:
            figures[formula.name] = Figure(formula, None, tuple(missing))
        else:
            value = formula.compute(*(known[need] for need in formula.needs))
            known[formula.name] = value
            figures[formula.name] = Figure(formula, value)
    return figures


def conflicts(setup: OpticsSetup, figures: Mapping[str, Figure]) -> tuple[str, ...]:
    """Name inputs that exclude each other, a line each.

    Parameters
    ----------
    setup : OpticsSetup
    figures : mapping
        `work_out` of the same setup.
    """
    at = {name: figure.value for name, figure in figures.items()}
    said = []
    radius, limit = setup.lens_radius_mm, at["largest_lens_radius"]
    if radius is not None and limit is not None and radius >= limit:
        said.append(
            f"lenses of radius {radius:g} mm collide at theta {setup.theta_deg:g} deg and "
            f"{setup.working_distance_mm:g} mm: the radius must be below {limit:.1f} mm, or theta above "
            f"{at['least_theta']:.1f} deg"
        )
    for side in ("camera", "projector"):
        said += _aperture(setup, side, at)
    if setup.chip is not None and setup.projector is not None and CHIPS[setup.chip].size != setup.projector:
        wide, high = CHIPS[setup.chip].size
        said.append(
            f"a projector of {setup.projector[0]}x{setup.projector[1]} is no {setup.chip}, which has {wide}x{high}"
            + "".join(f"; it may be a {name}" for name, chip in CHIPS.items() if chip.size == setup.projector)
        )
    for name, of_what in (("projected_width", "projected"), ("imaged_width", "imaged")):
        width = at[name]
        if width is not None and setup.field_mm is not None and width < setup.field_mm[0]:
            times = setup.magnification_projector if name == "projected_width" else setup.magnification_camera
            said.append(
                f"a magnification of {times:g}x makes the {of_what} field {width:.2g} mm wide, "
                f"not {setup.field_mm[0]:g} mm"
            )
    if (cut := at["cut_off_period"]) is not None and setup.line_um is not None and cut >= 2 * setup.line_um:
        said.append(
            f"lines of {setup.line_um:g} um have no contrast at NA {setup.na_camera:g}: diffraction ends at "
            f"{cut / 2:.3g} um; NA must be above {at['least_na_for_line']:.2g}"
        )
    return tuple(said)


def _aperture(setup: OpticsSetup, side: str, at: Mapping[str, float | None]) -> list[str]:
    """Conflicts of one aperture: with the depth of field, and with the lens or the angle that must hold its cone."""
    aperture: float | None = getattr(setup, f"na_{side}")
    if aperture is None:
        return []
    said = []
    blur, pixel, depth = at[f"{side}_blur"], at[f"{side}_pixel"], setup.depth_of_field_mm
    finest = pixel if pixel is not None else setup.line_um
    if blur is not None and depth is not None and finest is not None and blur > 2 * finest:
        told = f"{blur / 1000:.2g} mm" if blur >= 100 else f"{blur:.3g} um"
        what = f"{side} pixels" if pixel is not None else "line widths"
        said.append(
            f"NA {aperture:g} of the {side} and a depth of field of +-{depth / 2:g} mm: "
            f"{depth / 2:g} mm out of focus blur by {told}, {blur / finest:.0f} {what}; "
            f"2 of them need a working NA of {2 * finest / 1000 / depth:.2g}"
        )
    cone = math.sin(_half(setup.theta_deg)) if setup.theta_deg is not None else None
    if setup.lens_radius_mm is not None and setup.working_distance_mm is not None:
        holds = math.sin(math.atan(setup.lens_radius_mm / setup.working_distance_mm))
        if aperture > holds:
            said.append(
                f"NA {aperture:g} of the {side} needs a lens of radius "
                f"{setup.working_distance_mm * math.tan(math.asin(aperture)):.1f} mm at "
                f"{setup.working_distance_mm:g} mm, not {setup.lens_radius_mm:g} mm"
            )
    elif cone is not None and aperture > cone:
        said.append(
            f"NA {aperture:g} of the {side} does not fit beside the other at theta {setup.theta_deg:g} deg: "
            f"each cone has room for NA {cone:.3g}"
        )
    return said

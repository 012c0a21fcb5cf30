"""Limits of optics in closed form: contrast by diffraction and by defocus, and two boxes at an angle."""

from __future__ import annotations

import math
from itertools import pairwise

__all__ = ["blur_um", "diffraction_contrast", "disc_contrast", "overlap_area_mm2"]


def blur_um(aperture: float, defocus_mm: float) -> float:
    """Diameter of the disc that a point blurs to, um: 2 NA times the defocus (small angles)."""
    return 2000 * aperture * defocus_mm


def diffraction_contrast(share: float) -> float:
    """Contrast of a sine wave through an aberration-free round aperture, incoherent light.

    Parameters
    ----------
    share : float
        Frequency as a share of the cut-off frequency 2 NA / wavelength.

    Notes
    -----
    Goodman, Introduction to Fourier Optics, section 6.4: 2/pi (arccos s - s sqrt(1 - s^2)).
    """
    if share >= 1:
        return 0.0
    return 2 / math.pi * (math.acos(share) - share * math.sqrt(1 - share * share))


def disc_contrast(cycles: float) -> float:
    """Contrast of a sine wave blurred by an even disc, |2 J1(a) / a| with a = pi times `cycles` per diameter."""
    from scipy.special import j1

    a = math.pi * cycles
    return 1.0 if a < 1e-6 else abs(2 * float(j1(a)) / a)


def overlap_area_mm2(field_mm: float, depth_mm: float, theta_deg: float) -> float:
    """Area in which two rectangles with one centre overlap, turned by theta against each other.

    At the height z over the object's plane the overlap reaches to both sides by the smaller of
    (depth/2 - z cos(theta/2)) / sin(theta/2) and (field/2 - z sin(theta/2)) / cos(theta/2): straight pieces.
    """
    s, c = math.sin(math.radians(theta_deg) / 2), math.cos(math.radians(theta_deg) / 2)
    half_field, half_depth = field_mm / 2, depth_mm / 2

    def reach(z: float) -> float:
        return max(0.0, min((half_depth - z * c) / s, (half_field - z * s) / c))

    top = min(half_depth / c, half_field / s)
    bends = [0.0, top]
    if abs(c * c - s * s) > 1e-12:
        bends.append((half_depth * c - half_field * s) / (c * c - s * s))  # where the two limits are equal
    marks = sorted(z for z in bends if 0 <= z <= top)
    return 4 * sum((b - a) * (reach(a) + reach(b)) / 2 for a, b in pairwise(marks))

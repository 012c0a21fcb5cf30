"""``microrelief roughness``: ISO 25178-2 parameters of a height map or a stored scan, with their filter chain."""

from __future__ import annotations

import json as json_text
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from configs import InputError
from pipelines import with_uncertainty

from ..compared import read_compared

__all__ = ["roughness"]


def roughness(
    surface: str,
    *,
    s_filter: float | None = None,
    l_filter: float | None = None,
    form: int = 1,
    json: Annotated[bool, Parameter(negative="")] = False,
) -> None:
    """Measure a surface's roughness after ISO 25178-2.

    Parameters of the scale-limited surface: finer structure is taken out by the S-filter, the form by a polynomial,
    coarser structure by the L-filter (both Gaussian regressions, ISO 16610-61 and -71). The chain is printed with the
    values, which mean nothing without it. The uncertainty is what the scan's noise makes of each, its bias included.

    Parameters
    ----------
    surface
        A height map of any scanner, or a scan of a store: STORE@12, STORE@-1 (the newest), STORE@TIME.
    s_filter
        Nesting index of the S-filter, mm; by default three cells. 0: not used.
    l_filter
        Nesting index of the L-filter, mm; not used unless given.
    form
        Order of the polynomial that is taken out: 0 the mean, 1 a plane, 2 a second-order surface.
    json
        Print JSON.

    Examples
    --------
    microrelief roughness site.icechunk@-1 --l-filter 0.8
    """
    from pipelines.change import ROUGHNESS, Filters
    from pipelines.change import roughness as measured

    scan = read_compared(surface).scan
    pitch = scan.grid.pitch_mm
    fine = 3 * pitch if s_filter is None else (s_filter or None)
    try:
        filters = Filters(fine, l_filter, form)
        found = measured(scan.height, pitch, filters, scan.sigma)
    except ValueError as error:
        raise InputError(f"{surface}: {error}") from None
    if json:
        values = {name: {"value": _finite(one.value), "sigma": _finite(one.sigma)} for name, one in found.items()}
        chain = {"s_mm": filters.s_mm, "l_mm": filters.l_mm, "form": filters.form}
        print(json_text.dumps({"filters": chain, "parameters": values}))
        return
    print(f"scale-limited surface: {filters}")
    for name, (unit, meaning) in ROUGHNESS.items():
        print(f"{name:<5} {with_uncertainty(found[name], unit):<24} {meaning}")


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None

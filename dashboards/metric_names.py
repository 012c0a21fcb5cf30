"""What people call each metric, how it is defined, and which metrics share a plot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import pandas as pd

from pipelines.change import METRICS

from .quantities import unit_text

__all__ = ["Corner", "Named", "TrendGroup", "name_metric", "trend_groups"]

Corner = Literal["LeftTop", "LeftBottom", "RightTop", "RightBottom"]

_GROUP_TITLES = {"mm3": "Volumes", "mm2": "Areas"}


@dataclass(frozen=True, slots=True)
class Named:
    """A metric's words."""

    name: str
    unit: str
    title: str
    definition: str
    uncertainty: str = ""

    @property
    def anchor(self) -> str:
        """Where a report's page defines it."""
        return f"metric-{self.name}"

    @property
    def link(self) -> str:
        """The anchor, where there is a definition to lead to."""
        return self.anchor if self.definition else ""

    @property
    def label(self) -> str:
        """Title with unit, for an axis."""
        unit = unit_text(self.unit)
        return f"{self.title} ({unit})" if unit else self.title


@dataclass(frozen=True, slots=True)
class TrendGroup:
    """Metrics of one unit and alike magnitude, which one pair of axes can show; their names hide least in a corner."""

    title: str
    unit: str
    metrics: tuple[Named, ...]
    corner: Corner = "LeftTop"


def name_metric(name: str, unit: str) -> Named:
    """Find the words of a metric; one that this version does not know keeps its own name."""
    known = METRICS.get(name)
    if known is not None:
        return Named(name, unit, known.title, known.definition, known.uncertainty)
    words = name.replace("_", " ")
    return Named(name, unit, words[:1].upper() + words[1:], "")


def trend_groups(series: pd.DataFrame, units: Mapping[str, str], alike: float = 8.0) -> tuple[TrendGroup, ...]:
    """Group the metrics of a series that have at least one value.

    Metrics share a plot where they have the same unit and their largest values differ by less than `alike` times:
    otherwise the small one would look flat.
    """
    groups: list[tuple[str, float, list[Named]]] = []
    for name, unit in units.items():
        if name not in series:
            continue
        values = series[name].to_numpy(dtype=np.float64)
        if not np.isfinite(values).any():
            continue
        size = float(np.nanmax(np.abs(values)))
        for group_unit, group_size, members in groups:
            if group_unit == unit and max(size, group_size) < alike * max(min(size, group_size), 1e-12):
                members.append(name_metric(name, unit))
                break
        else:
            groups.append((unit, size, [name_metric(name, unit)]))
    return tuple(
        TrendGroup(
            members[0].title if len(members) == 1 else _GROUP_TITLES.get(unit, _joined(members)),
            unit,
            tuple(members),
            _freest_corner(series[[member.name for member in members]].to_numpy(dtype=np.float64)),
        )
        for unit, _, members in groups
    )


def _freest_corner(values: npt.NDArray[np.float64]) -> Corner:
    """Give the corner in which fewest values of a plot lie, shape (scans, metrics): a quarter of it is looked at."""
    low, high = np.nanmin(values), np.nanmax(values)
    above = (values - low) / max(high - low, 1e-12)
    left = np.linspace(0, 1, len(values))[:, np.newaxis] <= 0.5
    held: dict[Corner, int] = {
        "LeftTop": int((left & (above >= 0.5)).sum()),
        "LeftBottom": int((left & (above <= 0.5)).sum()),
        "RightTop": int((~left & (above >= 0.5)).sum()),
        "RightBottom": int((~left & (above <= 0.5)).sum()),
    }
    return min(held, key=lambda corner: held[corner])


def _joined(members: list[Named]) -> str:
    first, *others = (metric.title for metric in members)
    *titles, last = [first, *(title[:1].lower() + title[1:] for title in others)]
    return f"{', '.join(titles)} and {last}"

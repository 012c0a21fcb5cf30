"""PatternSet: the images to project, and what each of them tells about a projector pixel."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, cast

import numpy as np
import numpy.typing as npt

from .codebook import MAX_BITS, Codebook, gray_planes, make_codebook, order_cell_px, order_planes, stripe_planes

__all__ = ["PAPER_STRIPES", "FrameRole", "PatternSet"]

PAPER_STRIPES = (2, 3, 5, 9, 15, 30, 60, 120, 240, 480)
"""Stripes per pattern in Table 1 of the paper that started the project."""

KINDS = ("gray", "stripes", "phase")
OFFSETS = ("none", "centred")
GROUPS = ("white", "black", "columns", "rows")
SHORTEST_PERIOD_PX = 4
"""A sinusoid of fewer projector pixels is a stripe pattern."""

Axis = Literal["columns", "rows"]
AXES: tuple[Axis, Axis] = ("columns", "rows")


@dataclass(frozen=True, slots=True)
class FrameRole:
    """What one frame of a capture shows.

    `what` is ``white``, ``black``, ``bit`` (a stripe pattern) or ``phase`` (a sinusoid); `axis` is the
    projector axis that it codes (``columns`` or ``rows``; empty for white and black); `index` counts bits from
    the coarsest (0) and phase steps from 0; `inverted` marks the complementary partner.
    """

    what: Literal["white", "black", "bit", "phase"]
    axis: Literal["", "columns", "rows"] = ""
    index: int = 0
    inverted: bool = False

    @property
    def name(self) -> str:
        """A short name for files and messages: ``white``, ``columns_3_inverted``, ``rows_phase_0``."""
        if not self.axis:
            return self.what
        phase = "_phase" if self.what == "phase" else ""
        return f"{self.axis}{phase}_{self.index}{'_inverted' if self.inverted else ''}"


@dataclass(frozen=True, slots=True)
class PatternSet:
    """A set of patterns; the same fields as the pattern file of the capture folder format.

    Parameters
    ----------
    kind : {"gray", "stripes", "phase"}
        Gray code, equal-width stripes (the paper's Table 1), or phase shifting with Gray order.
    size : (int, int)
        Projector columns, rows.
    bits : (int, int)
        Gray bits along columns, rows; 0 where an axis is not projected. With fewer than the axis needs, a cell
        is 2, 4, ... pixels wide. For ``phase``: bits of the order, which counts half periods. For ``stripes``
        the number of `counts` or 0, whatever else is given.
    offset : {"none", "centred"}
        Where the Gray code sits on the axis: from its first word, or the middle of the code on the middle
        of the axis.
    counts : tuple of int
        Stripes of each pattern, coarsest first (``stripes`` only; `PAPER_STRIPES` if empty).
    steps : int
        Phase shifts of one period (``phase`` only), at least 3.
    complementary : bool
        Each stripe pattern is followed by its inverse.
    msb_first : bool
        Coarsest pattern first.
    order : tuple of str
        Order of the groups ``white``, ``black``, ``columns``, ``rows``.

    Raises
    ------
    ValueError
        If the fields contradict each other, or two projector pixels cannot be told apart.
    """

    kind: Literal["gray", "stripes", "phase"]
    size: tuple[int, int]
    bits: tuple[int, int] = (10, 10)
    offset: Literal["none", "centred"] = "none"
    counts: tuple[int, ...] = ()
    steps: int = 4
    complementary: bool = True
    msb_first: bool = True
    order: tuple[str, ...] = GROUPS

    def __post_init__(self) -> None:
        _check_choice("kind", self.kind, KINDS)
        _check_choice("offset", self.offset, OFFSETS)
        for name, low, high in (("size", 2, 65536), ("bits", 0, MAX_BITS)):
            pair = getattr(self, name)
            if len(pair) != 2 or not all(_is_int(value) and low <= value <= high for value in pair):
                raise ValueError(f"{name} must be two whole numbers (columns, rows) of {low} to {high}, not {pair}")
        if self.kind == "stripes":
            # one canonical form, so that equal sets are equal values
            object.__setattr__(self, "counts", tuple(self.counts) or PAPER_STRIPES)
            if not all(_is_int(count) and count >= 2 for count in self.counts) or len(self.counts) > MAX_BITS:
                raise ValueError(f"counts must be 1 to {MAX_BITS} numbers of at least 2 stripes, not {self.counts}")
            object.__setattr__(self, "bits", tuple(len(self.counts) if bits else 0 for bits in self.bits))
            for length, bits, axis in zip(self.size, self.bits, AXES, strict=True):
                if bits and max(self.counts) > length:
                    raise ValueError(f"counts: {max(self.counts)} stripes do not fit on {length} {axis}")
        elif self.counts:
            raise ValueError(f"counts belong to kind 'stripes', not to {self.kind!r}")
        if not any(self.bits):
            raise ValueError("bits are 0 on both axes: nothing would be projected")
        if self.kind == "phase":
            self._check_phase()
        names = [name for name in GROUPS if name in ("white", "black") or self.bits[AXES.index(cast(Axis, name))]]
        unknown = [name for name in self.order if name not in GROUPS]
        if unknown or len(set(self.order)) < len(self.order) or not set(names) <= set(self.order):
            raise ValueError(f"order must name each of {', '.join(names)} once, not {', '.join(self.order) or 'none'}")
        for axis in AXES:
            if self.bits[AXES.index(axis)]:
                try:
                    self.codebook(axis)
                except ValueError as error:
                    raise ValueError(f"{axis}: {error}") from None

    def _check_phase(self) -> None:
        if not _is_int(self.steps) or not 3 <= self.steps <= 64:
            raise ValueError(f"phase shifting needs 3 to 64 steps, not {self.steps}")
        for axis in AXES:
            length, bits = self.size[AXES.index(axis)], self.bits[AXES.index(axis)]
            if bits and self.period_px(axis) < SHORTEST_PERIOD_PX:
                raise ValueError(
                    f"{bits} order bits make a period of {self.period_px(axis)} px on {length} {axis}; it needs at "
                    f"least {SHORTEST_PERIOD_PX}: use at most {(length - 1).bit_length() - 1} bits"
                )

    @property
    def roles(self) -> tuple[FrameRole, ...]:
        """What each frame shows, in the order of the frames."""
        return _roles(self)

    def period_px(self, axis: Axis) -> int:
        """Period of the sinusoids along an axis of a phase set: two order cells, px."""
        return 2 * order_cell_px(self.size[AXES.index(axis)], self.bits[AXES.index(axis)])

    def codebook(self, axis: Axis) -> Codebook:
        """Which projector pixels carry which word of stripe patterns along an axis (of a phase set: the order)."""
        return _codebook(self, axis)

    def narrowest_px(self, axis: Axis) -> float:
        """Mean width of the finest stripes along an axis, px; below 2 they are uneven on the projector's raster."""
        planes = _planes(self, axis)
        stripes = int((np.diff(planes, axis=1).sum(axis=1) + 1).max())
        return float(planes.shape[1] / stripes)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What to know before projecting: a line for each axis whose finest stripes are narrower than 2 px."""
        if self.kind != "stripes":
            return ()
        return tuple(
            f"{axis}: {max(self.counts)} stripes on {self.size[AXES.index(axis)]} px are "
            f"{self.narrowest_px(axis):.1f} px wide, so they come out uneven; at least 2 px are needed"
            for axis in AXES
            if self.bits[AXES.index(axis)] and self.narrowest_px(axis) < 2
        )

    def images(self) -> npt.NDArray[np.uint8]:
        """Draw the images to project.

        Returns
        -------
        ndarray of uint8, shape (frame, row, column)
            In the order of `roles`; 0 and 255, and all between for sinusoids, linear in light.
        """
        columns, rows = self.size
        images = np.empty((len(self.roles), rows, columns), dtype=np.uint8)
        for image, role in zip(images, self.roles, strict=True):
            if not role.axis:
                image[:] = 255 if role.what == "white" else 0
                continue
            if role.what == "bit":
                line = ((_planes(self, role.axis)[role.index] != role.inverted) * 255).astype(np.uint8)
            else:
                line = self._sinusoid(role.axis, role.index)
            image[:] = line if role.axis == "columns" else line[:, np.newaxis]
        return images

    def _sinusoid(self, axis: Axis, step: int) -> npt.NDArray[np.uint8]:
        # phase 0 on the outer edge of the period's first pixel, so that phase / 2 pi is the share of the period
        x = np.arange(self.size[AXES.index(axis)]) + 0.5
        phase = 2 * np.pi * (x / self.period_px(axis) - step / self.steps)
        return np.rint(127.5 * (1 + np.cos(phase))).astype(np.uint8)

    def as_mapping(self) -> dict[str, Any]:
        """What a pattern file holds: plain lists, numbers and texts, only the keys that the kind knows."""
        mapping: dict[str, Any] = {"kind": self.kind, "size": list(self.size), "bits": list(self.bits)}
        if self.kind == "gray":
            mapping["offset"] = self.offset
        if self.kind == "stripes":
            mapping["counts"] = list(self.counts)
        if self.kind == "phase":
            mapping["steps"] = self.steps
        mapping |= {"complementary": self.complementary, "msb_first": self.msb_first, "order": list(self.order)}
        return mapping

    @staticmethod
    def from_mapping(mapping: Mapping[str, Any]) -> PatternSet:
        """Read what a pattern file holds.

        Parameters
        ----------
        mapping : mapping
            The fields by name; `size` must be there. `kind` is ``gray`` if absent, `bits` as many as the axes
            need (of a phase set: periods of 32 px and less).

        Raises
        ------
        ValueError
            On a key that does not exist, a value of the wrong type, or fields that contradict each other.
        """
        if not isinstance(mapping, Mapping):
            raise ValueError(f"a pattern set is a mapping of kind, size, ..., not {type(mapping).__name__}")
        fields = list(PatternSet.__dataclass_fields__)
        for key in mapping:
            if key not in fields:
                close = difflib.get_close_matches(str(key), fields, 1)
                hint = f"did you mean {close[0]!r}?" if close else f"known are {', '.join(fields)}"
                raise ValueError(f"{key}: unknown key of a pattern set, {hint}")
        if "size" not in mapping:
            raise ValueError("size is missing: give the projector's columns and rows, such as size: [608, 684]")
        values: dict[str, Any] = dict(mapping)
        values.setdefault("kind", "gray")
        for name in ("size", "bits"):
            if name in values:
                values[name] = _tuple_of(int, name, values[name])
        if "bits" not in values and len(values["size"]) == 2:
            less = 4 if values["kind"] == "phase" else 0  # 16 px of order cell: a period of 32
            values["bits"] = tuple(max(1, (length - 1).bit_length() - less) for length in values["size"])
        if "counts" in values:
            values["counts"] = _tuple_of(int, "counts", values["counts"] or ())
        if "order" in values:
            values["order"] = _tuple_of(str, "order", values["order"])
        for name in ("complementary", "msb_first"):
            if not isinstance(values.get(name, True), bool):
                raise ValueError(f"{name} must be true or false, not {values[name]!r}")
        return PatternSet(**values)


def _is_int(value: object) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _tuple_of(kind: type, name: str, value: object) -> tuple[Any, ...]:
    if isinstance(value, str) or not isinstance(value, Sequence):
        raise ValueError(f"{name} must be a list, not {value!r}")
    if not all(isinstance(item, kind) and not isinstance(item, bool) for item in value):
        raise ValueError(f"{name} must be a list of {'whole numbers' if kind is int else 'names'}, not {list(value)}")
    return tuple(value)


def _check_choice(name: str, value: object, choices: Sequence[str]) -> None:
    if value not in choices:
        close = difflib.get_close_matches(str(value), choices, 1)
        hint = f"did you mean {close[0]!r}?" if close else f"use one of {', '.join(choices)}"
        raise ValueError(f"{name}: {value!r} is unknown, {hint}")


@lru_cache(maxsize=64)
def _roles(patterns: PatternSet) -> tuple[FrameRole, ...]:
    return tuple(role for group in patterns.order for role in _group(patterns, group))


def _group(patterns: PatternSet, group: str) -> Iterator[FrameRole]:
    if group not in AXES:
        yield FrameRole("white" if group == "white" else "black")
        return
    axis: Axis = "columns" if group == "columns" else "rows"
    bits = patterns.bits[AXES.index(axis)]
    for index in range(bits) if patterns.msb_first else range(bits - 1, -1, -1):
        yield FrameRole("bit", axis, index)
        if patterns.complementary:
            yield FrameRole("bit", axis, index, inverted=True)
    if patterns.kind == "phase" and bits:
        for step in range(patterns.steps):
            yield FrameRole("phase", axis, step)


def _planes(patterns: PatternSet, axis: Axis) -> npt.NDArray[np.bool_]:
    length, bits = patterns.size[AXES.index(axis)], patterns.bits[AXES.index(axis)]
    if not bits:
        raise ValueError(f"the pattern set does not project {axis}")
    if patterns.kind == "stripes":
        return stripe_planes(length, patterns.counts)
    if patterns.kind == "phase":
        return order_planes(length, bits)
    return gray_planes(length, bits, patterns.offset)


@lru_cache(maxsize=64)
def _codebook(patterns: PatternSet, axis: Axis) -> Codebook:
    return make_codebook(_planes(patterns, axis))

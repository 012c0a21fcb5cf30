"""Objects followed from scan to scan: who is who, where each goes and how fast, and who touches whom."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..instant import Instant
from ..scan import Scan
from .objects import Expected, ObjectRule, StandingObject, find_objects
from .pairing import paired
from .substrate import Substrate, update_substrate

__all__ = ["Sighting", "Sightings", "follow_objects"]

GATE_MM = 0.5
"""An object does not come so far from where it was expected."""
PATIENCE = 10
"""Scans through which an object that is not seen keeps its name."""
MEMORY = 0.5
"""Weight of the newest step in the velocity."""
SIZE_MM = 0.3
"""A volume off by a factor e counts like this distance: after a crossing it tells who is who."""
CUT = 0.3
"""Weight of what is seen of an object that was cut from others, against where it was expected."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """One object at one time.

    Parameters
    ----------
    identity : int
        The same for one object in every scan, from 1.
    object : StandingObject
    speed_mm_s : float
        Of its middle in three dimensions, since it was last seen; NaN at first.
    touches : tuple of int
        Identities of those whose footprints meet its own.
    moved : bool or None
        Whether it came farther than a cell between the first and the last frame of the capture, so that its shape is
        not to be trusted; None where its speed or the time that a capture takes is not known.
    """

    identity: int
    object: StandingObject
    speed_mm_s: float
    touches: tuple[int, ...]
    moved: bool | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """All objects of one scan, and the substrate beneath them.

    Parameters
    ----------
    time : Instant
    seen : tuple of Sighting
        By identity.
    identities : ndarray of int32, shape (rows, columns)
        Identity of the object that each cell belongs to, 0 for none.
    substrate : Substrate
        As it is known after this scan.
    """

    time: Instant
    seen: tuple[Sighting, ...]
    identities: npt.NDArray[np.int32]
    substrate: Substrate


@dataclass(slots=True)
class _Track:
    """An object's name, and what is believed of it: of one that touches others only a part may be seen."""

    identity: int
    last: StandingObject
    at: Instant
    place: npt.NDArray[np.float64]
    moments: tuple[float, float, float]
    volume_mm3: float
    velocity: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    missed: int = 0

    def foretold(self, now: Instant) -> npt.NDArray[np.float64]:
        place: npt.NDArray[np.float64] = self.place + self.velocity * _seconds(self.at, now)
        return place

    def expected(self, now: Instant) -> Expected:
        x, y = self.foretold(now)
        return Expected(float(x), float(y), *self.moments)


def follow_objects(
    scans: Iterable[Scan],
    substrate: Substrate | None = None,
    rule: ObjectRule | None = None,
    *,
    capture_s: float | None = None,
) -> Iterator[Sightings]:
    """Follow objects through scans of one surface.

    Each scan's objects are told apart with the help of where those before are expected (`find_objects`), and named
    by the assignment with the least sum of distances to those places and of differences in volume (Kuhn 1955), no
    distance above 0.5 mm. One that is not seen keeps its name for ten scans. The substrate is learned on the way
    (`update_substrate`).

    Parameters
    ----------
    scans : iterable of Scan
        In the order of time, on one grid.
    substrate : Substrate, optional
        The bare surface, from `bare_substrate`. Without it the first scan is taken for bare, and an object that lay
        there is seen once it has left its place.
    rule : ObjectRule, optional
    capture_s : float, optional
        Seconds from the first frame of a capture to the last: what moves by more than a cell meanwhile is flagged.

    Yields
    ------
    Sightings
        One for each scan.
    """
    tracks: list[_Track] = []
    named = 0
    for scan in scans:
        if substrate is None:
            substrate = update_substrate(None, scan)
        expected = [track.expected(scan.time) for track in tracks]
        labels, objects = find_objects(scan, substrate, rule, expected)
        pairs = _assign(expected, [track.volume_mm3 for track in tracks], objects)
        identity: dict[int, int] = {}
        speeds: dict[int, float] = {}
        for n, one in enumerate(objects):
            if n in pairs:
                track = tracks[pairs[n]]
                speeds[track.identity] = _step(track, one, scan.time)
            else:
                named += 1
                track = _Track(
                    named,
                    one,
                    scan.time,
                    np.array([one.x_mm, one.y_mm]),
                    one.moments_mm2,
                    max(one.volume_mm3.value, 1e-9),
                )
                tracks.append(track)
                speeds[named] = float("nan")
            identity[one.label] = track.identity
        seen_now = set(identity.values())
        for track in tracks:
            track.missed = 0 if track.identity in seen_now else track.missed + 1
        tracks = [track for track in tracks if track.missed <= PATIENCE]
        names = np.zeros(int(labels.max(initial=0)) + 1, np.int32)
        for label, name in identity.items():
            names[label] = name
        identities = names[labels]
        touching = _touching(identities)
        substrate = update_substrate(substrate, _without(scan, identities))
        sightings = [
            Sighting(
                identity[one.label],
                one,
                speeds[identity[one.label]],
                touching.get(identity[one.label], ()),
                _moved(speeds[identity[one.label]], capture_s, scan.grid.pitch_mm),
            )
            for one in objects
        ]
        yield Sightings(scan.time, tuple(sorted(sightings, key=lambda s: s.identity)), identities, substrate)


def _moved(speed_mm_s: float, capture_s: float | None, pitch_mm: float) -> bool | None:
    if capture_s is None or np.isnan(speed_mm_s):
        return None
    return speed_mm_s * capture_s > pitch_mm


def _assign(expected: list[Expected], volumes: list[float], objects: tuple[StandingObject, ...]) -> dict[int, int]:
    """Which expected one each object is; objects and expected ones may stay without a partner."""
    if not expected or not objects:
        return {}
    at = np.array([[one.x_mm, one.y_mm] for one in objects])
    to = np.array([[one.x_mm, one.y_mm] for one in expected])
    cost = np.hypot(*(at[:, None] - to[None]).transpose(2, 0, 1))
    far = cost > GATE_MM
    whole = np.array([one.expected is None and not one.at_border for one in objects])
    sizes = np.array([max(one.volume_mm3.value, 1e-9) for one in objects])
    cost[whole] += SIZE_MM * np.abs(np.log(sizes[whole, None] / np.array(volumes)))
    for n, one in enumerate(objects):
        if one.expected is not None:  # it was cut out by that place
            cost[n, one.expected] = 0.0
            far[n, one.expected] = False
    return paired(cost, ~far, alone=1e6)


def _step(track: _Track, one: StandingObject, now: Instant) -> float:
    """Move a track on to where its object is now; gives the speed."""
    seconds = _seconds(track.at, now)
    if seconds <= 0:
        return float("nan")
    seen = np.array([one.x_mm, one.y_mm])
    move = seen - np.array([track.last.x_mm, track.last.y_mm])
    climb = (one.z_mm - one.height_mm) - (track.last.z_mm - track.last.height_mm)
    cut = one.expected is not None
    # of an object cut from others the middle of what is seen is biased, and its shape is not its own
    place = CUT * seen + (1 - CUT) * track.foretold(now) if cut else seen
    memory = MEMORY * CUT if cut else MEMORY
    track.velocity = (1 - memory) * track.velocity + memory * (place - track.place) / seconds
    track.place, track.last, track.at = place, one, now
    if not cut:
        track.moments = one.moments_mm2
        if not one.at_border:
            track.volume_mm3 = 0.8 * track.volume_mm3 + 0.2 * max(one.volume_mm3.value, 1e-9)
    return float(np.sqrt(move @ move + climb * climb) / seconds)


def _touching(identities: npt.NDArray[np.int32]) -> dict[int, tuple[int, ...]]:
    """Identities whose cells lie beside each other, eight neighbours."""
    found: dict[int, set[int]] = {}
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        rows, columns = identities.shape
        a = identities[: rows - dr, max(0, -dc) : columns - max(0, dc)]
        b = identities[dr:, max(0, dc) : columns - max(0, -dc)]
        meet = (a != b) & (a > 0) & (b > 0)
        for one, two in set(zip(a[meet].tolist(), b[meet].tolist(), strict=True)):
            found.setdefault(one, set()).add(two)
            found.setdefault(two, set()).add(one)
    return {one: tuple(sorted(others)) for one, others in found.items()}


def _without(scan: Scan, identities: npt.NDArray[np.int32]) -> Scan:
    """The scan without its objects and a margin of two cells around them."""
    covered = ndimage.binary_dilation(identities > 0, structure=np.ones((3, 3)), iterations=2)
    height = np.where(covered, np.float32(np.nan), scan.height)
    sigma = np.where(covered, np.float32(np.nan), scan.sigma)
    return Scan(scan.grid, scan.time, height, sigma, scan.texture, scan.level, scan.calibration_id)


def _seconds(first: Instant, last: Instant) -> float:
    return float((last - first) / np.timedelta64(1, "ns")) / 1e9

"""Does each frame show what its place in the sequence says? Explanations compete; the one that mends the most wins."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, pairwise
from math import sqrt

import numpy as np
import numpy.typing as npt

from .diagnose_code import edge_votes, neighbours, planes_of, valid_share
from .diagnose_explanations import difference, exchange, other_sets, shifted, swap, with_extra, without
from .diagnose_sample import Sample
from .patterns import AXES, PatternSet

__all__ = ["OrderFault", "find_order_faults", "pairs_of"]

Ints = npt.NDArray[np.int64]
Doubles = npt.NDArray[np.float64]

UNLIKE = 0.2
"""Two frames are no pair if the mean square of their sum exceeds this share of what unrelated frames give (1); half an
exposure of another pattern gives 0.33, a tenth less light 0.003, noise of a twentieth of the swing 0.003."""
SAME = 0.1
"""Two frames show the same if the mean square of their difference is below this share of what unrelated ones give."""
AGREE = 0.6
"""Stripes follow the code if their sign at the edges of coarser ones is right so much more often than wrong."""
VALID = 0.9
"""Share of the lit pixels that must carry a word which the set projects."""
FLAT = 0.1
"""Variance (of values from -1 to 1) below which a frame shows no pattern; one that is resolved has 0.5 to 1."""
LATE = 0.2
"""Share of another pattern in every frame above which the code is no longer seen."""
UNSEEN = 0.3
"""What a role costs that an explanation leaves without a frame: less than a broken pair, more than any clean one."""
FINALISTS = 8


@dataclass(frozen=True, slots=True)
class OrderFault:
    """A fault of the order: cause, frames (by number in the stack), figure with its limit and what it is, and more."""

    cause: str
    slots: tuple[int, ...]
    value: float
    limit: float
    measure: str
    told: str


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """How well a mapping of roles to frames fits: distance of each pair, signs of the bits, share of valid words."""

    mapping: Ints
    unlike: Doubles
    votes: tuple[Doubles, Doubles]
    agree: float
    valid: float

    @property
    def cost(self) -> float:
        missing = int((self.mapping < 0).sum())
        return float(self.unlike.sum()) + 3 * (1 - self.agree) + 3 * (1 - self.valid) + UNSEEN * missing

    @property
    def sound(self) -> bool:
        flipped = any((votes < -0.5).any() for votes in self.votes)
        return self.paired and self.agree > AGREE and self.valid > VALID and not flipped

    @property
    def paired(self) -> bool:
        return bool((self.unlike < UNLIKE).all())


@lru_cache(maxsize=64)
def pairs_of(patterns: PatternSet) -> list[tuple[str, int, int, int]]:
    """List axis, bit, and the places of pattern and inverse (-1 where there is none) of each stripe pattern."""
    place = {(role.axis, role.index, role.inverted): n for n, role in enumerate(patterns.roles) if role.what == "bit"}
    return [
        (axis, index, n, place.get((axis, index, True), -1))
        for (axis, index, inverted), n in place.items()
        if not inverted
    ]


@lru_cache(maxsize=64)
def _checked(patterns: PatternSet) -> tuple[Ints, Ints, Ints]:
    """Places of white, of black, and of the pairs (pattern, inverse) of a set."""
    whites, blacks = ([n for n, role in enumerate(patterns.roles) if role.what == what] for what in ("white", "black"))
    pairs = [(p, n) for _, _, p, n in pairs_of(patterns) if n >= 0]
    return np.array(whites, np.int64), np.array(blacks, np.int64), np.array(pairs, np.int64).reshape(-1, 2)


def find_order_faults(sample: Sample) -> tuple[OrderFault, ...]:
    """Find frames that are missing, repeated, shifted or swapped, and sets of patterns that were not projected.

    Parameters
    ----------
    sample : Sample
        Its number of frames may differ from that of the pattern set.

    Returns
    -------
    tuple of OrderFault
        Empty where the frames are what and where they should be, as far as frames can tell: a coarsest pattern of a
        code that fills the projector may be inverted unseen.
    """
    return _Order(sample).faults()


class _Order:
    def __init__(self, sample: Sample) -> None:
        self.sample = sample
        self.patterns = sample.patterns
        self.count = len(sample.tiles)
        self.u = np.clip(2 * sample.share - 1, -1.5, 1.5)
        few = np.ascontiguousarray(self.u[:, ::3])
        # einsum, not @: the threads of a BLAS library spin while they wait, which cost as much as all of `diagnose`
        gram = (np.einsum("ip,jp->ij", few, few) / max(1, few.shape[1])).astype(np.float64)
        size = np.diag(gram)
        both = np.maximum(size[:, None] + size, 0.1)  # stripes too faint to see are never unlike
        self.sum_of = np.clip((size[:, None] + size + 2 * gram) / both, 0, 1)
        self.difference_of = np.clip((size[:, None] + size - 2 * gram) / both, 0, 1)
        self.mean = few.mean(axis=1) if few.size else np.zeros(self.count)
        # a frame all light or all dark: mean square of what it lacks, as a share of what stripes lack (2)
        self.not_white = np.clip((size - 2 * self.mean + 1) / 2, 0, 1)
        self.not_black = np.clip((size + 2 * self.mean + 1) / 2, 0, 1)
        self.beside = neighbours(sample.lit)

    def faults(self) -> tuple[OrderFault, ...]:
        roles = len(self.patterns.roles)
        if self.count != roles:
            return (self._wrong_count(),)
        own = self.fit(self.patterns, np.arange(roles))
        if own.sound:
            return ()
        if own.paired:
            return self._paired(own)
        return self._unpaired(own)

    def _wrong_count(self) -> OrderFault:
        roles, count = len(self.patterns.roles), self.count
        said = f"{count} frames instead of {roles}"
        if count == roles - 1:
            best = self._best(self.patterns, [without(roles, n) for n in range(roles)])
            lost = int(np.flatnonzero(best.mapping < 0)[0])
            if best.paired and best.agree > AGREE:
                told = f"{said}; most likely {self._name(lost)}, frame {lost}, is missing"
                return OrderFault("missing", (lost,), count, roles, "frames", told)
        elif count == roles + 1:
            best = self._best(self.patterns, [with_extra(roles, n) for n in range(count)])
            extra = int(np.setdiff1d(np.arange(count), best.mapping)[0])
            if best.paired and best.agree > AGREE:
                twin = self._twin(extra, near=True)
                more = f", it shows what frame {twin} shows" if twin is not None else ""
                told = f"{said}; frame {extra} is one too many{more}"
                return OrderFault("repeated", (extra,), count, roles, "frames", told)
        cause = "missing" if count < roles else "repeated"
        return OrderFault(cause, (), count, roles, "frames", f"{said}; which ones cannot be told")

    def _paired(self, own: _Fit) -> tuple[OrderFault, ...]:
        """Each pattern stands beside its inverse: pairs may be turned, exchanged, or belong to another set."""
        roles = len(self.patterns.roles)
        pairs = [(axis, bit, p, n) for axis, bit, p, n in pairs_of(self.patterns) if n >= 0]
        votes = dict(zip(AXES, own.votes, strict=True))
        turned = [(p, n) for axis, bit, p, n in pairs if votes[axis][bit] < -0.5]  # type: ignore[index]  # an axis
        mended = np.arange(roles)
        for p, n in turned:
            mended[[p, n]] = mended[[n, p]]
        fits = [self.fit(self.patterns, mended)]
        # where no edge of a coarser one is seen, the words tell the sign
        first = [(p, n) for axis, bit, p, n in pairs if bit < 3 and not votes[axis][bit]]  # type: ignore[index]
        for chosen in [c for size in (1, 2) for c in combinations(first, size)]:
            mapping = mended.copy()
            for p, n in chosen:
                mapping[[p, n]] = mapping[[n, p]]
            fits.append(self.fit(self.patterns, mapping))
        best = min(fits, key=lambda fit: fit.cost)
        if best.sound and len(pairs) > np.sum(best.mapping != np.arange(roles)) / 2 and best.cost < own.cost - 0.1:
            moved = tuple(int(n) for n in np.flatnonzero(best.mapping != np.arange(roles)))
            worst = min((float(own.votes[a].min()) for a in range(2) if own.votes[a].size), default=0.0)
            value, limit, measure = (worst, -0.5, "sign at the edges of coarser stripes")
            if worst > -0.5:
                value, limit, measure = own.valid, VALID, "share of the pixels with a word of the set"
            return (OrderFault("pair", moved, value, limit, measure, "pattern and inverse have changed places"),)
        exchanged = self._best(self.patterns, [exchange(roles, a, b) for a, b in pairwise(pairs)])
        if exchanged.sound and exchanged.cost < own.cost - 0.1:
            moved = tuple(int(n) for n in np.flatnonzero(exchanged.mapping != np.arange(roles)))
            return (
                OrderFault(
                    "swapped",
                    moved,
                    own.agree,
                    AGREE,
                    "agreement with the code",
                    "two neighbouring pairs changed places",
                ),
            )
        return (self._wrong_set(own),)

    def _unpaired(self, own: _Fit) -> tuple[OrderFault, ...]:
        roles = len(self.patterns.roles)
        named: list[tuple[str, int, Ints]] = []
        for n in range(roles):
            early, late, lost = without(roles, n), np.arange(roles), np.arange(roles)
            early[n + 1 :] = np.arange(n, roles - 1)
            late[n + 1 :] += 1
            lost[n] = -1
            named += [("early", n, early), ("lost", n, lost)]
            if n < roles - 1:
                late[-1] = -1
                named.append(("late", n, late))
        for shift in (1, 2, -2):
            named.append(("shift", shift, shifted(roles, shift)))
        swaps = [("swap", 0, swap(roles, a, b)) for a, b in combinations(range(roles), 2)]
        ranked = sorted(named + swaps, key=lambda item: self._rough(self.patterns, item[2]))[:FINALISTS]
        fits = [(what, n, self.fit(self.patterns, mapping)) for what, n, mapping in ranked]
        what, n, best = min(fits, key=lambda item: (round(item[2].cost, 3), item[0] == "lost"))
        worst = float(own.unlike.max())
        if best.paired and best.agree > AGREE and best.valid > VALID - 0.05 and best.cost < own.cost - 0.1:
            return (self._explained(what, n, best, worst),)
        if own.agree > AGREE:
            return ()  # in order, but something is wrong with the light of single frames
        return (self._wrong_set(own),)

    def _explained(self, what: str, n: int, best: _Fit, worst: float) -> OrderFault:
        roles = len(self.patterns.roles)
        measure = "|pattern + inverse - white - black|, mean square"
        if what == "swap":
            moved = tuple(int(k) for k in np.flatnonzero(best.mapping != np.arange(roles)))
            return OrderFault("swapped", moved, worst, UNLIKE, measure, "these two frames have changed places")
        if what == "shift" or (what == "early" and n == 0):
            shift = n if what == "shift" else -1
            way = f"{abs(shift)} too {'late' if shift > 0 else 'early'}"
            every = tuple(range(roles))
            return OrderFault("shifted", every, worst, UNLIKE, measure, f"the whole sequence is {way}")
        if what == "early":
            told = f"{self._name(n)} is missing; all frames after it are one too early"
            return OrderFault("missing", (n,), worst, UNLIKE, measure, told)
        if what == "late":
            told = f"{self._name(n)} was taken twice; all frames after it are one too late"
            return OrderFault("repeated", (n, n + 1), worst, UNLIKE, measure, told)
        twin = self._twin(n, near=True)
        if self.not_black[n] < SAME:
            return OrderFault("missing", (n,), worst, UNLIKE, measure, f"frame {n} is dark, {self._name(n)} is missing")
        if self.sample.saturated[n] > 0.5:
            told = f"frame {n} is white all over, {self._name(n)} cannot be seen in it"
            return OrderFault(
                "saturated", (n,), float(self.sample.saturated[n]), 0.5, "share of saturated pixels", told
            )
        if twin is not None:
            told = f"frame {n} shows what frame {twin} shows instead of {self._name(n)}"
            return OrderFault("repeated", (n,), worst, UNLIKE, measure, told)
        if self.u[n].var() < FLAT and abs(self.mean[n]) < 0.5:  # half of a pattern and half of its inverse is grey
            told = f"frame {n} holds about as much of a neighbour as of {self._name(n)}"
            return OrderFault("interrupted", (n,), 0.5, LATE, "share of another pattern", told)
        told = f"frame {n} does not show {self._name(n)}, nor any other pattern"
        return OrderFault("missing", (n,), worst, UNLIKE, measure, told)

    def _late_share(self) -> float:
        """Share of the next frame in each, if all exposures end late: (1 - 2a) of a pattern is left, more of inverses.

        A pattern then has (1 - 2a) of its swing, an inverse, which catches an unrelated one, sqrt((1 - a)^2 + a^2).
        """
        spread = self.u.var(axis=1)
        pairs = [(p, n) for _, _, p, n in pairs_of(self.patterns) if n >= 0 and max(spread[p], spread[n]) > 0.1]
        if not pairs:
            return 0.0
        ratio = float(np.median([spread[p] / max(spread[n], 1e-6) for p, n in pairs]))
        ratio = min(ratio, 1 / max(ratio, 1e-6))
        return (1 - sqrt(max(0.0, 1 - 4 * (1 - ratio) / (4 - 2 * ratio)))) / 2

    def _wrong_set(self, own: _Fit) -> OrderFault:
        roles = len(self.patterns.roles)
        late = self._late_share()
        if late > LATE:
            told = f"every exposure catches about {100 * late:.0f} % of the pattern beside it"
            return OrderFault("interrupted", tuple(range(roles)), late, LATE, "share of another pattern", told)
        others = [p for p in other_sets(self.patterns) if len(p.roles) == roles]
        others.sort(key=lambda patterns: self._rough(patterns, np.arange(roles)))
        fits = [(patterns, self.fit(patterns, np.arange(roles))) for patterns in others[:FINALISTS]]
        patterns, best = min(fits, key=lambda item: item[1].cost, default=(self.patterns, own))
        told = "the frames do not follow the pattern set"
        if best.sound and best.cost < own.cost - 0.1:
            told += f"; {difference(patterns, self.patterns)} would fit"
        value, limit, measure = own.agree, AGREE, "agreement with the code"
        if own.agree > AGREE:
            value, limit, measure = own.valid, VALID, "share of the pixels with a word of the set"
        return OrderFault("patterns", tuple(range(roles)), value, limit, measure, told)

    def _best(self, patterns: PatternSet, mappings: list[Ints]) -> _Fit:
        mappings.sort(key=lambda mapping: self._rough(patterns, mapping))
        return min((self.fit(patterns, mapping) for mapping in mappings[: 2 * FINALISTS]), key=lambda fit: fit.cost)

    def _rough(self, patterns: PatternSet, mapping: Ints) -> float:
        return float(self._unlike(patterns, mapping).sum()) + UNSEEN * int((mapping < 0).sum())

    def _unlike(self, patterns: PatternSet, mapping: Ints) -> Doubles:
        """Of each frame that has something to be compared with: 0 if it fits, 1 if it is unrelated."""
        whites, blacks, pairs = _checked(patterns)
        white, black, both = mapping[whites], mapping[blacks], mapping[pairs]
        both = both[(both >= 0).all(axis=1)]
        far = self.not_white[white[white >= 0]], self.not_black[black[black >= 0]]
        return np.concatenate([*far, self.sum_of[both[:, 0], both[:, 1]]])

    def fit(self, patterns: PatternSet, mapping: Ints) -> _Fit:
        """Judge a mapping of roles to frames (-1: a role without a frame)."""
        votes, agreements, valid = [], [], 1.0
        for number, axis in enumerate(AXES):
            bits = patterns.bits[number]
            if not bits or not self.u.shape[1]:
                votes.append(np.zeros(0))
                continue
            signal = np.zeros((self.u.shape[1], bits), np.float32)
            for name, bit, p, n in pairs_of(patterns):
                if name == axis:
                    signal[:, bit] = self._signal(mapping[p], mapping[n] if n >= 0 else -1)
            vote, agreement = edge_votes(signal, self.beside, planes_of(patterns.codebook(axis)))
            votes.append(vote)
            agreements += agreement
            valid = min(valid, valid_share(signal, patterns.codebook(axis)))
        agree = float(np.mean(agreements)) if agreements else 1.0
        return _Fit(mapping, self._unlike(patterns, mapping), (votes[0], votes[1]), agree, valid)

    def _signal(self, plus: int, minus: int) -> npt.NDArray[np.float32]:
        if plus >= 0 and minus >= 0:
            return np.asarray((self.u[plus] - self.u[minus]) / 2, np.float32)
        if plus >= 0:
            return np.asarray(self.u[plus], np.float32)
        return np.asarray(-self.u[minus], np.float32) if minus >= 0 else np.zeros(self.u.shape[1], np.float32)

    def _twin(self, slot: int, *, near: bool) -> int | None:
        """Give the frame nearest in the sequence that shows the same."""
        far = self.difference_of[slot].copy()
        far[slot] = 1
        same = np.flatnonzero(far < SAME)
        return int(same[np.argmin(np.abs(same - slot))]) if same.size and near else None

    def _name(self, place: int) -> str:
        return self.patterns.roles[place].name

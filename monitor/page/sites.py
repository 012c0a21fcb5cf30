"""Sites: the stores of a page, each looked at no more often than every few seconds however many browsers ask."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from configs import Campaign, InputError, MicroreliefError
from dashboards import Glance, glance, newest_picture
from pipelines import Instant
from storage import open_store, store_exists

from ..check import load_checked
from ..standing import Standing, is_store, look

__all__ = ["Site", "SiteSource", "Sites", "source_of"]

FRESH_S = 5.0
"""A look is good for so long."""


@dataclass(frozen=True, slots=True)
class SiteSource:
    """One store, and the campaign that fills it where it is known."""

    store: str | Path
    campaign: Campaign | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """A store as it was looked at.

    Parameters
    ----------
    key : str
        Its name in addresses.
    title : str
    standing : Standing or None
        None where it cannot be read; `trouble` then says why.
    trouble : str
    """

    key: str
    title: str
    standing: Standing | None
    trouble: str = ""


@dataclass(slots=True)
class _Kept:
    source: SiteSource
    lock: threading.Lock = field(default_factory=threading.Lock)
    looked_at: float = -1e9
    site: Site | None = None
    number: tuple[int, int] = (-1, -1)
    glance: Glance | None = None
    picture: bytes | None = None


class Sites:
    """The stores of a page, by key.

    Parameters
    ----------
    sources : iterable of SiteSource
    now : callable
        Tells the time for what is overdue.
    steady : callable
        Seconds that never go back; another one in tests.
    """

    def __init__(
        self, sources: Iterable[SiteSource], now: Callable[[], Instant], steady: Callable[[], float] = time.monotonic
    ) -> None:
        self._now, self._steady = now, steady
        self._kept: dict[str, _Kept] = {}
        for source in sources:
            self._kept[_key(source, self._kept)] = _Kept(source)

    def __iter__(self) -> Iterator[Site]:
        return (self[key] for key in self._kept)

    def __len__(self) -> int:
        return len(self._kept)

    def __contains__(self, key: str) -> bool:
        return key in self._kept

    def __getitem__(self, key: str) -> Site:
        """Look at a site; raises KeyError where there is none of that name."""
        kept = self._kept[key]
        with kept.lock:
            if kept.site is None or self._steady() - kept.looked_at > FRESH_S:
                kept.site, kept.looked_at = self._look(key, kept.source), self._steady()
            return kept.site

    def source(self, key: str) -> SiteSource:
        """Give what a site is made of."""
        return self._kept[key].source

    def glance(self, key: str) -> Glance | None:
        """Give the newest maps and trends; None where there is no store yet."""
        return self._read(key).glance

    def picture(self, key: str) -> bytes | None:
        """Give the newest picture, PNG."""
        return self._read(key).picture

    def _read(self, key: str) -> _Kept:
        kept = self._kept[key]
        with kept.lock:
            if not store_exists(kept.source.store):
                return kept
            store = open_store(kept.source.store)
            number = len(store), len(store.events)
            if kept.glance is None or number != kept.number:
                kept.glance, kept.picture, kept.number = glance(store), newest_picture(store), number
            return kept

    def _look(self, key: str, source: SiteSource) -> Site:
        title = source.campaign.site.name if source.campaign is not None else Path(source.store).stem
        if not store_exists(source.store):
            return Site(key, title, None, "no store yet: the first scan makes it")
        try:
            standing = look(source.store, self._now(), source.campaign)
        except (MicroreliefError, OSError, ValueError) as error:
            return Site(key, title, None, str(error))
        return Site(key, standing.site or title, standing)


def source_of(path: Path) -> SiteSource:
    """Take a store or a campaign file.

    Raises
    ------
    InputError
        If it is neither.
    """
    if not is_store(path):
        campaign = load_checked(path).campaign
        return SiteSource(campaign.store.path, campaign)
    if not store_exists(path):
        raise InputError(f"{path}: no store there; name a store, or the campaign file that fills it")
    return SiteSource(path)


def _key(source: SiteSource, taken: Iterable[str]) -> str:
    """Make a name for addresses out of a store's: letters, digits and hyphens, each once."""
    plain = re.sub(r"[^a-z0-9]+", "-", Path(source.store).stem.lower()).strip("-") or "site"
    key, count = plain, 1
    while key in set(taken):
        count += 1
        key = f"{plain}-{count}"
    return key

"""Notify: tells people by Apprise what began and what is over, on a thread of its own: no visit waits for it."""

from __future__ import annotations

import logging
import os
import stat
import threading
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import structlog

from configs import Campaign, InputError, Notify
from pipelines import Instant, format_instant
from storage import Store, full_at, used_bytes

from .conditions import Message, changes, observed
from .extras import load_extra
from .outbox import Outbox, Pending
from .settled import Settled

__all__ = ["Notifier", "Targets", "notifier_of", "outbox_file", "read_targets", "send_test"]

LOOK_S = 15.0
"""The sending thread looks for what is due this often."""

LAST_S = 20.0
"""At the end of a run, so long is waited for what is being sent; the rest is sent by the next run."""

DAY = np.timedelta64(86400 * 10**9, "ns")
_log = structlog.get_logger("microrelief.notify")


@dataclass(frozen=True, slots=True, repr=False)
class Targets:
    """Where a group of people is reached. Never shown: addresses hold passwords.

    Parameters
    ----------
    who : str
        Where the addresses stand: ``env NAME`` or ``file NAME``.
    addresses : tuple of str
        Apprise URLs.
    """

    who: str
    addresses: tuple[str, ...]

    def send(self, message: Message) -> tuple[str, ...]:
        """Send; name the targets that did not take it, such as ``target 2 (mailto)``."""
        make, failed = _apprise(), []
        for number, address in enumerate(self.addresses, start=1):
            name = f"target {number} ({address.partition('://')[0]})"
            try:
                target = make()
                if not (target.add(address) and target.notify(title=message.title, body=message.body)):
                    failed.append(name)
            except Exception as error:  # noqa: BLE001 - some plugin's bug; its text may hold the address
                failed.append(f"{name}: {type(error).__name__}")
        return tuple(failed)


def read_targets(rule: Notify) -> Targets:
    """Read the addresses of a group.

    Raises
    ------
    InputError
        If there are none, Apprise does not know one, it is not installed, or others may read the file.
    """
    if rule.env is not None:
        who, text = f"env {rule.env}", os.environ.get(rule.env, "")
        if not text.strip():
            raise InputError(
                f"notify: the environment variable {rule.env} is not set; it holds Apprise URLs, one a line"
            )
    else:
        assert rule.file is not None  # the campaign has one of the two
        who, text = f"file {rule.file.name}", _private_text(rule.file)
    lines = [line.strip() for line in text.splitlines()]
    addresses = tuple(line for line in lines if line and not line.startswith("#"))
    if not addresses:
        raise InputError(f"notify: {who} holds no address: write Apprise URLs into it, one a line")
    make = _apprise()
    for number, address in enumerate(addresses, start=1):
        if not make().add(address):
            kind = address.partition("://")[0] if "://" in address else "no ://"
            raise InputError(f"notify: {who}: address {number} ({kind}) is none that Apprise knows")
    return Targets(who, addresses)


@cache
def _apprise() -> Any:
    """Load Apprise, once, and keep it quiet: what it says may hold an address."""
    Apprise = load_extra("apprise", "notify", "notify").Apprise
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # a plugin of it imports what Python will drop
        Apprise.instantiate("json://localhost")  # loads its plugins, all of them
    quiet = logging.getLogger("apprise")
    quiet.handlers[:], quiet.propagate = [logging.NullHandler()], False
    return Apprise


def _private_text(file: Path) -> str:
    try:
        mode = file.stat().st_mode
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"notify: {file} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if os.name == "posix" and mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise InputError(f"notify: others may read {file}, which holds passwords: `chmod 600 {file}`")
    return text


def outbox_file(campaign: Campaign) -> Path:
    """Where a campaign's messages are kept."""
    return campaign.store.beside / f"{Path(campaign.store.path).stem}.outbox.sqlite"


class Notifier:
    """Goes along with a run: sees what begins and what is over, keeps messages, and sends them on its thread.

    Parameters
    ----------
    site : str
    groups : sequence of (Notify, Targets)
    outbox : Outbox
    disk_full : callable
        Gives when the disk is full at this pace, or None.
    clock : callable
        Tells the time.
    threaded : bool
        False in tests, which send by `deliver`.
    """

    def __init__(
        self,
        site: str,
        groups: Sequence[tuple[Notify, Targets]],
        outbox: Outbox,
        disk_full: Callable[[Instant], Instant | None],
        clock: Callable[[], Instant],
        *,
        threaded: bool = True,
    ) -> None:
        self._site, self._groups, self._outbox = site, groups, outbox
        self._disk_full, self._clock = disk_full, clock
        self._row = 0
        self._full: Instant | None = None
        self._full_known: Instant | None = None
        self._troubles: list[str] = []
        self._failing: set[str] = set()
        self._lock, self._sending = threading.Lock(), threading.Lock()
        self._wake, self._over = threading.Event(), False
        self._thread = threading.Thread(target=self._send_on, name="notify", daemon=True) if threaded else None
        if self._thread is not None:
            self._thread.start()

    def settled(self, settled: Settled) -> Sequence[str]:
        """Keep what is to be told of a slot; give what could not be delivered since."""
        now = self._clock()
        self._row = 0 if settled.state == "taken" else self._row + settled.count
        for rule, targets in self._groups:
            before = self._outbox.standing(targets.who)
            disk = self._disk(settled, now, rule)
            after = observed(before, settled, now, row=self._row, rule=rule, disk=disk)
            messages, stands = changes(before, after, now, self._site, rule.remind)
            if messages or stands != before:
                self._outbox.put(targets.who, messages, stands, now)
        self._wake.set()
        with self._lock:
            troubles, self._troubles = self._troubles, []
        return troubles

    def deliver(self) -> None:
        """Try all that is due."""
        targets = {each.who: each for _, each in self._groups}
        with self._sending:
            for pending in self._outbox.due(self._clock()):
                if pending.who in targets:
                    self._try(pending, targets[pending.who])

    def close(self) -> None:
        """Send what is due, for a while; the rest is kept for the next run."""
        self._over = True
        self._wake.set()
        if self._thread is not None:
            self._thread.join(LAST_S)

    def _send_on(self) -> None:
        over = False
        while not over:
            self._wake.wait(LOOK_S)
            self._wake.clear()
            over = self._over  # asked before the last delivery: what came meanwhile goes with it
            try:
                self.deliver()
            except Exception as error:  # noqa: BLE001 - a full disk; the messages that are kept are tried again
                _log.error("outbox", error=f"{type(error).__name__}: {error}")

    def _try(self, pending: Pending, targets: Targets) -> None:
        failed = targets.send(pending.message)
        if not failed:
            self._outbox.sent(pending)
            self._failing.discard(targets.who)
            return
        again = self._outbox.failed(pending, self._clock())
        told = f"notification not delivered by {targets.who}, {', '.join(failed)}"
        _log.warning("notify", who=targets.who, failed=failed, tries=pending.tries + 1)
        if not again:
            self._say(f"{told}: given up after {pending.tries + 1} tries: {pending.message.title}")
        elif targets.who not in self._failing:
            self._failing.add(targets.who)
            self._say(f"{told}: will be tried again")

    def _say(self, text: str) -> None:
        with self._lock:
            self._troubles.append(text)

    def _disk(self, settled: Settled, now: Instant, rule: Notify) -> str:
        if settled.cause.startswith("disk almost full"):
            return settled.cause
        if self._full_known is None or now - self._full_known >= DAY:
            self._full, self._full_known = self._disk_full(now), now
        if self._full is None or self._full - now > np.timedelta64(round(rule.disk_days * 86400), "s"):
            return ""
        return f"the disk is full on {format_instant(self._full)[:10]} at this pace"


def notifier_of(campaign: Campaign, store: Store, clock: Callable[[], Instant]) -> Notifier | None:
    """Make a campaign's notifier; None where it tells nobody.

    Raises
    ------
    InputError
        If an address cannot be read or is none.
    """
    groups = [(rule, read_targets(rule)) for rule in campaign.notify]
    if not groups:
        return None
    path = campaign.store.path

    def disk_full(now: Instant) -> Instant | None:
        count = len(store)
        if count < 2 or not isinstance(path, Path):
            return None
        import shutil

        first, last = store[0].scan.time, store[-1].scan.time
        return full_at(now, shutil.disk_usage(path).free, used_bytes(path), first, last, count)

    return Notifier(campaign.site.name, groups, Outbox(outbox_file(campaign)), disk_full, clock)


def send_test(campaign: Campaign) -> list[tuple[str, tuple[str, ...]]]:
    """Send a test message to every group; give for each which targets did not take it."""
    message = Message(f"{campaign.site.name}: test", "microrelief can reach you: this is a test message.")
    groups: list[Any] = [read_targets(rule) for rule in campaign.notify]
    return [(targets.who, targets.send(message)) for targets in groups]

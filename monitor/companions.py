"""Companions: what goes along with a run and is told of every settled slot; none of them can harm a visit."""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import structlog

from .settled import Settled

__all__ = ["Companion", "Companions"]

_log = structlog.get_logger("microrelief.companions")


class Companion(Protocol):
    """Somebody who is told how each slot ended."""

    def settled(self, settled: Settled) -> Sequence[str]:
        """Take it into account; give what is to be noted in the store."""
        ...

    def close(self) -> None:
        """The run is over."""
        ...


@dataclass(slots=True)
class Companions:
    """Several of them; what one raises is logged, noted once, and ends there."""

    members: Sequence[Companion] = ()
    _asides: list[str] = field(default_factory=list)
    _failed: set[str] = field(default_factory=set)

    def settled(self, settled: Settled) -> None:
        """Tell all of them."""
        for member in self.members:
            try:
                self._asides += member.settled(settled)
            except Exception as error:  # noqa: BLE001 - the scan is durable; what goes along must not end a campaign
                self._fail(member, error)

    def asides(self) -> Sequence[str]:
        """Give what is to be noted in the store since this was last asked."""
        told, self._asides = self._asides, []
        return told

    def close(self) -> None:
        """End all of them."""
        for member in self.members:
            try:
                member.close()
            except Exception as error:  # noqa: BLE001 - see above
                self._fail(member, error)

    def _fail(self, member: Companion, error: Exception) -> None:
        name = type(member).__name__
        _log.error("companion", name=name, error=f"{type(error).__name__}: {error}", traceback=traceback.format_exc())
        if name not in self._failed:
            self._failed.add(name)
            self._asides.append(f"{name} failed: {type(error).__name__}: {error}")

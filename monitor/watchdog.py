"""Watchdog: tells systemd that the campaign is ready and alive, from the loop itself, so that a stuck visit shows."""

from __future__ import annotations

import os
import socket
from collections.abc import Sequence

from .settled import Settled

__all__ = ["Watchdog", "tell_systemd"]


def tell_systemd(words: str) -> bool:
    """Send a message of the protocol of `sd_notify(3)`; whether somebody was there to hear it."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address or not hasattr(socket, "AF_UNIX"):
        return False
    if address.startswith("@"):  # Linux's abstract sockets
        address = "\0" + address[1:]
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as out:
            out.sendto(words.encode(), address)
    except OSError:
        return False
    return True


class Watchdog:
    """Goes along with a run: alive at each slot and, as the clock's nap, at each half minute of a wait."""

    def __init__(self) -> None:
        tell_systemd("READY=1")

    def alive(self) -> None:
        """Say so; called by a waiting clock."""
        tell_systemd("WATCHDOG=1")

    def settled(self, settled: Settled) -> Sequence[str]:
        """Say so, and how the newest slot ended, which `systemctl status` shows."""
        state = settled.state if settled.number is None else f"scan {settled.number} {settled.state}"
        tell_systemd(f"WATCHDOG=1\nSTATUS={state}{': ' + settled.cause if settled.cause else ''}".replace("\r", " "))
        return ()

    def close(self) -> None:
        """Say that the run ends."""
        tell_systemd("STOPPING=1")

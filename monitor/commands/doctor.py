"""The command `doctor`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from configs import InputError

from ..check import load_checked
from ..health import Finding, check_campaign, check_delivery, check_machine

__all__ = ["doctor"]

MARKS = {"ok": "ok     ", "warning": "WARNING", "wrong": "WRONG  "}


def doctor(campaign: Path | None = None, *, notify: Annotated[bool, Parameter(negative="")] = False) -> int:
    """Say what is wrong with this machine or a campaign, and how to mend it.

    Looks at versions, system libraries, our package names, disk and clock; with a campaign also at its keys, rig,
    calibration and store. The rig is opened and closed; a real
    projector shows white and black for a while, to measure how late its light follows. Exit code 1: something is wrong.

    Parameters
    ----------
    campaign
        Campaign file.
    notify
        Send a test message to everybody whom the campaign notifies.

    Examples
    --------
    microrelief doctor
    microrelief doctor soil.yaml --notify
    """
    if notify and campaign is None:
        raise InputError("--notify needs a campaign: it says who is told")
    wrong = 0
    for finding in _findings(campaign, notify):
        print(f"{MARKS[finding.level]}  {finding.what}: {finding.told}", flush=True)
        if finding.level != "ok":
            print(f"         -> {finding.mend}", flush=True)
        wrong += finding.level == "wrong"
    print("all is well" if not wrong else f"{wrong} {'thing is' if wrong == 1 else 'things are'} wrong")
    return 1 if wrong else 0


def _findings(campaign: Path | None, notify: bool) -> Iterator[Finding]:
    yield from check_machine()
    if campaign is not None:
        file = load_checked(campaign)
        yield Finding("ok", "campaign", f"{campaign} is understood")
        yield from check_campaign(file.campaign)
        if notify:
            yield from check_delivery(file.campaign)

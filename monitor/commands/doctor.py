"""The command `doctor`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..check import load_checked
from ..health import Finding, check_campaign, check_machine

__all__ = ["doctor"]

MARKS = {"ok": "ok     ", "warning": "WARNING", "wrong": "WRONG  "}


def doctor(campaign: Path | None = None) -> int:
    """Say what is wrong with this machine or a campaign, and how to mend it.

    Looks at versions, system libraries, our package names, disk and clock; with a campaign also at its keys, rig,
    calibration and store. The rig is opened and closed; a real
    projector shows white and black for a while, to measure how late its light follows. Exit code 1: something is wrong.

    Parameters
    ----------
    campaign
        Campaign file.

    Examples
    --------
    microrelief doctor
    microrelief doctor soil.yaml
    """
    wrong = 0
    for finding in _findings(campaign):
        print(f"{MARKS[finding.level]}  {finding.what}: {finding.told}", flush=True)
        if finding.level != "ok":
            print(f"         -> {finding.mend}", flush=True)
        wrong += finding.level == "wrong"
    print("all is well" if not wrong else f"{wrong} {'thing is' if wrong == 1 else 'things are'} wrong")
    return 1 if wrong else 0


def _findings(campaign: Path | None) -> Iterator[Finding]:
    yield from check_machine()
    if campaign is not None:
        file = load_checked(campaign)
        yield Finding("ok", "campaign", f"{campaign} is understood")
        yield from check_campaign(file.campaign)

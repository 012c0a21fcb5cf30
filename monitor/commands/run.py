"""The commands `run` and `scan`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from configs import Campaign, CampaignFile, InputError

from ..campaign import run_campaign
from ..check import load_scheduled
from ..clock import RealClock
from ..companions import Companion
from ..forecast import forecast_lines
from ..log import LogFormat, set_up_log
from ..settled import Settled
from ..stopping import graceful_stop
from ..teller import Teller
from ..watchdog import Watchdog

__all__ = ["follow", "run", "scan"]


def run(
    campaign: Path,
    *,
    dry_run: bool = False,
    max_scans: int | None = None,
    status_port: int | None = None,
    log_format: LogFormat = "text",
    log_file: Path | None = None,
) -> int:
    """Monitor on a schedule; go on where an earlier run ended.

    Prints ``committed scan N TIME`` once a scan is durable. A visit that fails is recorded, and the campaign goes on.
    Slots that nobody answered are recorded as missed with their cause, never caught up. Where the campaign has an
    `area:`, each visit covers all its tiles. Ctrl-C finishes the scan under way. Exit code 4: scans were missed,
    rejected or failed while it ran.

    Parameters
    ----------
    campaign
        Campaign file.
    dry_run
        Check everything that needs no rig, show the coming visits and the disk they take, and scan nothing.
    max_scans
        Stop after so many visits.
    status_port
        Show on a page how it stands, on this port of this machine; see `microrelief serve`.
    log_format
        Of the log on standard error: text, or json.
    log_file
        Write the log to this file too, as JSON lines; begun anew at 5 MB, the last five are kept.

    Examples
    --------
    microrelief run soil.yaml --dry-run
    microrelief run soil.yaml --status-port 8123
    """
    if max_scans is not None and max_scans < 1:
        raise InputError(f"--max-scans must be at least 1, not {max_scans}")
    file = load_scheduled(campaign)
    if dry_run:
        for line in forecast_lines(file.campaign, RealClock().now()):
            print(line)
        return 0
    with ExitStack() as stack:
        if status_port is not None:
            from ..page import PageServer, SiteSource

            source = SiteSource(file.campaign.store.path, file.campaign)
            server = stack.enter_context(PageServer([source], port=status_port))
            print(f"status at {server.link}", flush=True)
        set_up_log(form=log_format, file=log_file)
        return follow(file, file.campaign, max_scans=max_scans)


def scan(campaign: Path) -> int:
    """Take one scan now, whatever the schedule says.

    Exit code 4: the scan was rejected; 75: the device is not there now; 1: the capture failed.

    Parameters
    ----------
    campaign
        Campaign file.

    Examples
    --------
    microrelief scan soil.yaml
    """
    file = load_scheduled(campaign)
    ended: list[Settled] = []
    set_up_log()
    with Teller(file.campaign) as teller:

        def settled(each: Settled) -> None:
            ended.append(each)
            teller.settled(each)

        run_campaign(
            file.campaign, clock=RealClock(), on_settled=settled, on_stage=teller.stage, text=file.text, now=True
        )
    last = ended[-1]
    if last.state == "taken":
        return 0
    return 4 if last.state == "rejected" else 75 if last.unavailable else 1


def follow(
    file: CampaignFile, campaign: Campaign, *, max_scans: int | None = None, companions: Sequence[Companion] = ()
) -> int:
    """Run a campaign in real time, saying what happens; give the exit code."""
    watchdog = Watchdog()
    with graceful_stop() as stop, Teller(campaign) as teller:
        outcome = run_campaign(
            campaign,
            clock=RealClock(nap=watchdog.alive),
            companions=[watchdog, *companions],
            on_settled=teller.settled,
            on_wait=teller.wait,
            on_stage=teller.stage,
            on_worked=teller.worked,
            max_scans=max_scans,
            stop=stop,
            text=file.text,
        )
        teller.summary(outcome)
    return 4 if outcome.degraded else 0

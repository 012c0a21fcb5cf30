"""The command `video`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from configs import InputError, MicroreliefError, parse_duration

from ..check import load_scheduled
from ..companions import Companion
from ..log import set_up_log
from ..onlooker import Onlooker
from .run import follow

__all__ = ["video"]


def video(
    campaign: Path,
    *,
    for_: Annotated[str | None, Parameter(name="--for")] = None,
    live: Annotated[bool, Parameter(negative="")] = False,
    web: Annotated[bool, Parameter(negative="")] = False,
    port: int = 9090,
) -> int:
    """Record continuous 3D video: capture, reconstruct, compare and store at the campaign's rate.

    The next scan is captured while those before are worked out and stored. Prints ``committed scan N TIME`` once a scan
    is durable, how late it began and how long it took; on a terminal one line says how it keeps up instead. A slot that
    cannot be kept is dropped whole, and recorded with how far behind the work was. Ctrl-C finishes the scans under
    way. Exit code 4: scans were dropped, rejected or failed.

    Parameters
    ----------
    campaign
        Campaign file with ``schedule: {video: {rate_hz: ...}}``.
    for_
        How long to record, such as 20s or 5min, instead of what the campaign says.
    live
        Open the review beside it, which follows the recording scan by scan.
    web
        The same in a browser on this machine (127.0.0.1 alone); prints the link once there is a scan.
    port
        Port of the web page; data come through the next one.

    Examples
    --------
    microrelief video video.yaml --for 20s
    microrelief video video.yaml --live
    """
    file = load_scheduled(campaign)
    settings = file.campaign
    if settings.schedule.video is None:
        raise InputError(f"{campaign}: its schedule is no video: write `schedule: {{video: {{rate_hz: 1}}}}`")
    if for_ is not None:
        try:
            length = parse_duration(for_)
        except ValueError as error:
            raise InputError(f"--for: {error}") from None
        recording = settings.schedule.video.model_copy(update={"for_": length})
        schedule = settings.schedule.model_copy(update={"video": recording})
        settings = settings.model_copy(update={"schedule": schedule})
    set_up_log()
    return follow(file, settings, companions=_onlookers(settings.store.path, port, live=live, web=web))


def _onlookers(store: str | Path, port: int, *, live: bool, web: bool) -> list[Companion]:
    """Who looks on, if anybody; what stands in their way is said before the recording begins."""
    if not (live or web):
        return []
    from dashboards import NO_SCREEN, check_ports, has_screen

    if not web:
        if not has_screen():
            raise MicroreliefError(NO_SCREEN)
        return [Onlooker(store)]
    check_ports(port)
    return [Onlooker(store, ["--web", "--port", str(port)])]

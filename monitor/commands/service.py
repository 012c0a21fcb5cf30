"""The command `service`."""

from __future__ import annotations

import getpass
import sys
from pathlib import Path

from configs import InputError

from ..check import load_scheduled

__all__ = ["service", "unit_text"]

UNIT = """\
# Runs a campaign as a service of systemd: restarted when it falls over or is stuck, with as few rights as it needs.
#   sudo cp this /etc/systemd/system/microrelief-{stem}.service
#   sudo systemctl enable --now microrelief-{stem}
[Unit]
Description=microrelief: {site}
Documentation=man:systemd.service(5)
After=time-sync.target network.target
StartLimitIntervalSec=0

[Service]
Type=notify
NotifyAccess=main
ExecStart={program} run {campaign}{port}
User={user}
WorkingDirectory={folder}
# addresses of notify, and MICRORELIEF_TOKEN; readable by root alone
EnvironmentFile=-/etc/microrelief/{stem}.env
Restart=always
RestartSec=30
# 2: the campaign is wrong, and starting it again does not mend it
RestartPreventExitStatus=2
# 0 and 4: it has ended by its schedule
SuccessExitStatus=4
# a visit may take so long, and no longer
WatchdogSec=15min
TimeoutStartSec=10min
# a stop finishes the scan under way
KillSignal=SIGTERM
TimeoutStopSec=5min
LimitNOFILE=65536

NoNewPrivileges=yes
ProtectSystem=strict
ReadWritePaths={writes}
CacheDirectory=microrelief
Environment=NUMBA_CACHE_DIR=/var/cache/microrelief
PrivateTmp=yes
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectClock=yes
ProtectHostname=yes
RestrictSUIDSGID=yes
RestrictRealtime=yes
RestrictNamespaces=yes
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_NETLINK
LockPersonality=yes
SystemCallArchitectures=native
CapabilityBoundingSet=
UMask=0027

[Install]
WantedBy=multi-user.target
"""


def unit_text(campaign: Path, user: str, status_port: int | None = None) -> str:
    """Give the unit of a campaign.

    Raises
    ------
    InputError
        If the campaign is wrong, or a name holds what a unit file cannot.
    """
    settings = load_scheduled(campaign).campaign
    file = campaign.resolve()
    words = (str(file), str(settings.store.beside.resolve()), user)
    if any(set(word) & set(" %\"'\n\\") for word in words):
        raise InputError("a unit file takes no path with blanks, quotes or %: move the campaign to a plainer one")
    return UNIT.format(
        stem=file.stem,
        site=settings.site.name.replace("%", "%%").replace("\n", " "),
        program=Path(sys.executable).with_name("microrelief"),
        campaign=file,
        port=f" --status-port {status_port}" if status_port is not None else "",
        user=user,
        folder=file.parent,
        writes=settings.store.beside.resolve(),
    )


def service(campaign: Path, *, user: str | None = None, status_port: int | None = None) -> int:
    """Print a unit file of systemd that runs a campaign as a service, with few rights and a watchdog.

    Parameters
    ----------
    campaign
        Campaign file.
    user
        Whose service it is; you, if none is given. It must be able to read the campaign and write the store's folder.
    status_port
        Port of the status page, if there is to be one.

    Examples
    --------
    microrelief service site.yaml --status-port 8123 > microrelief-site.service
    """
    print(unit_text(campaign, user if user is not None else getpass.getuser(), status_port), end="")
    return 0

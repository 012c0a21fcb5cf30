"""Recognises folders on another machine, where neither `flock` nor `fsync` keeps its word."""

from __future__ import annotations

import re
from pathlib import Path

from .folder import Folder
from .location import location_of

__all__ = ["network_file_system"]

MOUNTS = Path("/proc/self/mounts")

KINDS = {
    "nfs": "NFS",
    "nfs4": "NFS",
    "cifs": "SMB",
    "smb3": "SMB",
    "smbfs": "SMB",
    "ncpfs": "NetWare",
    "afs": "AFS",
    "9p": "9P",
    "ceph": "CephFS",
    "glusterfs": "GlusterFS",
    "lustre": "Lustre",
    "beegfs": "BeeGFS",
    "fuse.sshfs": "sshfs",
    "fuse.glusterfs": "GlusterFS",
    "fuse.ceph-fuse": "CephFS",
    "fuse.rclone": "rclone",
    "fuse.s3fs": "s3fs",
    "fuse.gcsfuse": "gcsfuse",
    "fuse.davfs2": "WebDAV",
    "davfs": "WebDAV",
}


def network_file_system(store: str | Path, mounts: Path = MOUNTS) -> str | None:
    """Say on which network file system a store's folder lies; None for a disk of this machine, or for S3.

    Parameters
    ----------
    store : str or Path
        It need not exist yet: then the folder that it will be made in counts.
    mounts : Path
        The kernel's table of mounts; where there is none, nothing is recognised.

    Returns
    -------
    str or None
        Its name for people, such as NFS.
    """
    location = location_of(store)
    if not isinstance(location, Folder):
        return None
    try:
        lines = mounts.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    place = location.path.resolve()
    best, kind = -1, ""
    for line in lines:
        fields = line.split()
        if len(fields) < 3:
            continue
        point = Path(re.sub(r"\\([0-7]{3})", lambda octal: chr(int(octal[1], 8)), fields[1]))
        # the last of two mounts at one place covers the first
        if place.is_relative_to(point) and len(point.parts) >= best:
            best, kind = len(point.parts), fields[2]
    return KINDS.get(kind)

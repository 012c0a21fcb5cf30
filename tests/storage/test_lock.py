"""One writer, and who it is, asked by others without disturbing it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from configs import StoreError
from storage import network_file_system, writer_of
from storage.location import LOCK
from storage.lock import WriterLock

HOLD = """
import sys
from pathlib import Path
from storage.location import LOCK
from storage.lock import WriterLock
lock = WriterLock(Path(sys.argv[1]) / LOCK)
print("held", flush=True)
sys.stdin.read()
"""


def test_says_who_writes(tmp_path: Path) -> None:
    assert writer_of(tmp_path) is None, "no store"
    lock = WriterLock(tmp_path / LOCK)
    told = writer_of(str(tmp_path))
    assert told is not None
    assert told.startswith(f"pid {os.getpid()} on ")
    lock.release()
    assert writer_of(tmp_path) is None


def test_a_second_writer_is_refused_by_name(tmp_path: Path) -> None:
    lock = WriterLock(tmp_path / LOCK)
    with pytest.raises(StoreError, match=f"another writer holds this store .pid {os.getpid()} on "):
        WriterLock(tmp_path / LOCK)
    lock.release()
    WriterLock(tmp_path / LOCK).release()


def test_what_a_killed_writer_left_means_nothing(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        assert writer_of(tmp_path) is not None
        process.kill()
    assert writer_of(tmp_path) is None
    WriterLock(tmp_path / LOCK).release()


def test_whoever_looks_keeps_no_writer_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A look holds the lock for a moment; a writer that comes in that moment tries again."""
    import fcntl

    WriterLock(tmp_path / LOCK).release()
    looking = os.open(tmp_path / LOCK, os.O_RDONLY)
    fcntl.flock(looking, fcntl.LOCK_SH)
    monkeypatch.setattr("storage.lock.time.sleep", lambda seconds: os.close(looking))
    WriterLock(tmp_path / LOCK).release()


MOUNTS = r"""
/dev/sda1 / ext4 rw,relatime 0 0
server:/export /data nfs4 rw,vers=4.2 0 0
/dev/sdb1 /data/local ext4 rw 0 0
//nas/share /mnt/My\040Share cifs rw 0 0
rig@host:/home /home/rig/remote fuse.sshfs rw 0 0
tmpfs /data/covered nfs rw 0 0
tmpfs /data/covered tmpfs rw 0 0
"""


@pytest.mark.parametrize(
    ("place", "kind"),
    [
        ("/var/site.icechunk", None),
        ("/data/site.icechunk", "NFS"),
        ("/data/local/site.icechunk", None),
        ("/data/localised/site.icechunk", "NFS"),
        ("/mnt/My Share/deep/site.icechunk", "SMB"),
        ("/home/rig/remote/site.icechunk", "sshfs"),
        ("/data/covered/site.icechunk", None),
        ("s3://bucket/data", None),
    ],
)
def test_a_network_folder_is_recognised(tmp_path: Path, place: str, kind: str | None) -> None:
    mounts = tmp_path / "mounts"
    mounts.write_text(MOUNTS)
    assert network_file_system(place, mounts) == kind
    assert network_file_system(place, tmp_path / "none") is None

"""What it takes for written bytes to survive a power cut, and for a file to appear whole or not at all."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile

from configs import InputError, MicroreliefError

__all__ = ["sync_file", "sync_file_system", "whole_file"]


def sync_file_system(folder: Path) -> None:
    """Bring everything written so far on `folder`'s file system to the disk.

    One transaction writes some fifty small files of unknown names; on Linux one ``syncfs`` for all of them costs less
    than fifty ``fsync``, and covers their folders. Elsewhere ``sync`` of the whole machine.

    Raises
    ------
    OSError
        If the disk failed to take a byte (ENOSPC, EIO).
    """
    if not sys.platform.startswith("linux"):
        os.sync()
        return
    libc = ctypes.CDLL(None, use_errno=True)
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        if libc.syncfs(descriptor) != 0:
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code), str(folder))
    finally:
        os.close(descriptor)


def sync_file(file: Path) -> None:
    """``fsync`` one file, then the folder that names it."""
    for path in (file, file.parent):
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextmanager
def whole_file(file: Path) -> Iterator[Path]:
    """Give a temporary path beside `file`; what was written there takes `file`'s place at the end, at once.

    Raises
    ------
    InputError
        If `file`'s folder does not exist, `file` is a folder, or it cannot be written (no right to, disk full).
    """
    if not file.parent.is_dir():
        raise InputError(f"{file}: folder {file.parent} does not exist: make it first")
    if file.is_dir():
        raise InputError(f"{file}: is a folder, name a file")
    temporary: Path | None = None
    try:
        with NamedTemporaryFile(dir=file.parent, prefix=f".{file.stem}-", suffix=file.suffix, delete=False) as handle:
            temporary = Path(handle.name)
        yield temporary
        temporary.chmod(0o644)
        temporary.replace(file)
    except OSError as error:
        if isinstance(error, MicroreliefError):
            raise
        raise InputError(f"{file}: cannot be written: {error.strerror or error}") from None
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)

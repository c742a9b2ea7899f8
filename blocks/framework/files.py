"""Files written in one piece: readers see the old one or the new one, never a half. And locks."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO
from uuid import uuid4


@contextlib.contextmanager
def replaced(path: str | Path) -> Iterator[Path]:
    """Yield a path beside the one wanted, to write to; at the end it takes the other's place.

    If the body raises, what was written is deleted, and an old file stays as it is. What took its place
    is on the disk: a loss of power does not leave it empty.

    Parameters
    ----------
    path : str or pathlib.Path
        The file wanted; its folder must be there.

    Raises
    ------
    OSError
        If there is no such folder, or the file cannot be put into its place.
    """
    path = destination(path)
    if not path.parent.is_dir():  # some libraries say "permission denied" of that
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path.parent))
    partial = path.with_name(f".{path.name}.{uuid4().hex[:12]}.partial")  # two may write at once
    try:
        yield partial
        _to_disk(partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def destination(path: str | Path) -> Path:
    """Return the regular file that a `path` means, which need not be there yet; links are followed.

    Raises
    ------
    OSError
        If there is something else: a folder, a device or a pipe.
    """
    path = Path(os.path.realpath(path))
    if path.is_dir():
        raise IsADirectoryError("it is a folder")
    if path.exists() and not path.is_file():
        raise OSError("it is a device, a pipe or a socket, not a file")
    return path


def _to_disk(file: Path) -> None:
    """Wait until what was written to a file is on the disk."""
    descriptor = os.open(file, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def locked(path: Path) -> IO[str]:
    """Open a lock file; it is locked until it is closed, or the process ends, however that happens.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    Raises
    ------
    BlockingIOError
        If another process has it locked.
    """
    lock = path.open("w")
    if sys.platform != "win32":  # there nothing is locked
        import fcntl

        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            raise
    return lock

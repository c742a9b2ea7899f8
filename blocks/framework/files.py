"""Files written in one piece: readers see the old one or the new one, never a half.

And what that takes: folders of one process each, which the next process deletes if that was killed.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import itertools
import os
import shutil
import stat
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO
from uuid import uuid4

from trussflow.blocks.framework.errors import Explained, TrussflowError
from trussflow.blocks.framework.validation import as_path

LOCK = ".lock"
"""How the names of locks end."""


@contextlib.contextmanager
def reading(
    path: str | Path, error: type[TrussflowError], cannot: str, damaged: str = "{}"
) -> Iterator[Path]:
    """Yield the regular file to read; any failure of the body raises one error of the reader.

    Parameters
    ----------
    path : str or pathlib.Path
        The file; links are followed.
    error : type
        Error of the reader. Errors of trussflow pass unchanged.
    cannot : str
        Beginning of its message, such as ``"cannot read the mission"``; the path follows.
    damaged : str
        Text for content that cannot be read; ``{}`` is the reason.

    Raises
    ------
    TrussflowError
        The `error`, if there is no such regular file, its content is damaged or nested too deeply, or the
        memory does not suffice.
    """

    def explained(fault: Exception) -> TrussflowError:
        if isinstance(fault, OSError) and (fault.errno or 0) >= 0:  # negative numbers are netCDF's
            why = fault.strerror or str(fault)
        elif isinstance(fault, MemoryError):
            why = "it needs more memory than there is"
        else:
            why = damaged.format("it is nested too deeply" if isinstance(fault, RecursionError) else fault)
        return error(f"{cannot} '{path}': {why}")

    file = as_path(error, cannot, path)
    with Explained(explained):
        yield destination(file)


@contextlib.contextmanager
def replaced(path: str | Path) -> Iterator[Path]:
    """Yield a path beside the one wanted, to write to; at the end it takes the other's place.

    If the body raises, what was written is deleted, and an old file stays as it is; if the process is
    killed, that is left to the next call for a file in the same folder. What took its place is on the
    disk: a loss of power does not leave it empty.

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
    folder, lock = own_folder(path.parent, ".trussflow-")
    try:
        partial = folder / path.name
        yield partial
        _to_disk(partial)
        partial.replace(path)
    finally:
        deleted(folder, lock)


def own_folder(place: Path, prefix: str) -> tuple[Path, IO[str]]:
    """Make a folder, and lock a file beside it; what killed processes left there is deleted.

    The larger the place, the more seldom it is looked through for that, but at the first call always.

    Parameters
    ----------
    place : pathlib.Path
        Where.
    prefix : str
        How its name begins.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    seldom = 1 + place.stat().st_size // 20_000  # bytes: on most file systems a thousand files
    looks = os.name != "nt" and next(_calls(place)) % seldom == 0  # there nothing is locked
    for left in place.glob(f"{prefix}*{LOCK}") if looks else ():
        with contextlib.suppress(OSError):  # another process has it, or was faster
            if is_private(left, stat.S_IFREG):
                deleted(left.with_suffix(""), locked(left))
    folder = place / f"{prefix}{uuid4().hex[:12]}"
    file = folder.with_suffix(LOCK)
    file.touch(0o600)
    try:
        lock = locked(file)
    except BlockingIOError:  # another process takes it for one that was left
        return own_folder(place, prefix)
    except OSError:  # the file system has no locks: then nobody else can lock it either
        lock = file.open("w")
    if not file.exists():  # it did
        lock.close()
        return own_folder(place, prefix)
    folder.mkdir(0o700)
    return folder, lock


@functools.lru_cache(maxsize=1000)
def _calls(_place: Path) -> Iterator[int]:
    """Return what counts the folders made in a place by this process."""
    return itertools.count()


def deleted(folder: Path, lock: IO[str]) -> None:
    """Delete a `folder` of `own_folder`, and its `lock` last: so what is cut short is done by the next."""
    shutil.rmtree(folder, ignore_errors=True)
    if os.name == "nt":  # what is open cannot be deleted there
        lock.close()
    if not folder.exists():
        folder.with_suffix(LOCK).unlink(missing_ok=True)
    lock.close()


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


def refuse_foreign(folder: Path) -> None:
    """Raise PermissionError unless a `folder` is the user's own, and nobody else may write to it."""
    if not is_private(folder, stat.S_IFDIR):
        raise PermissionError("it is another user's, or others may write to it (chmod go-w mends that)")


def is_private(path: Path, kind: int) -> bool:
    """Tell whether a path is ours, of a kind, and nobody else may write to it; links never are.

    Parameters
    ----------
    path : pathlib.Path
        What to look at.
    kind : int
        ``stat.S_IFREG`` or ``stat.S_IFDIR`` [-].

    Raises
    ------
    OSError
        If there is nothing.
    """
    status = path.lstat()
    if os.name == "nt":  # where the folders of users are closed to others, and modes say nothing
        return stat.S_IFMT(status.st_mode) == kind
    return (stat.S_IFMT(status.st_mode), status.st_uid, status.st_mode & 0o022) == (kind, os.geteuid(), 0)

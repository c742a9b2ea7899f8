"""Atomic file replacement: readers see the complete old or the complete new file.

Partial files are in folders of one process. If a process is killed, the next one deletes its folders.
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

from trussflow.blocks.errors import Explained, TrussflowError
from trussflow.blocks.support.validation import as_path

LOCK_SUFFIX = ".lock"
"""Suffix of the names of lock files."""


@contextlib.contextmanager
def reading(
    path: str | Path, error: type[TrussflowError], cannot: str, damaged: str = "{}"
) -> Iterator[Path]:
    """Yield the path of a regular file to read; convert exceptions of the body to an error of the reader.

    Parameters
    ----------
    path : str or pathlib.Path
        The file; links are followed.
    error : type
        Error class of the reader. Errors of trussflow are not converted.
    cannot : str
        Beginning of the message, such as ``"cannot read the mission"``; the path follows.
    damaged : str
        Text for content that cannot be read; ``{}`` is the reason.

    Raises
    ------
    TrussflowError
        The `error`, if there is no such regular file, its content is damaged or nested too deeply, or
        memory is insufficient.
    """

    def explained(fault: Exception) -> TrussflowError:
        if isinstance(fault, OSError) and (fault.errno or 0) >= 0:
            # negative numbers are netCDF's
            why = fault.strerror or str(fault)
        elif isinstance(fault, MemoryError):
            why = "it needs more memory than there is"
        else:
            why = damaged.format(
                "it is nested too deeply"
                if isinstance(fault, RecursionError)
                else fault
            )
        return error(f"{cannot} '{path}': {why}")

    file = as_path(error, cannot, path)
    with Explained(explained):
        yield destination(file)


@contextlib.contextmanager
def replaced(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path to write to; at the end, the written file replaces `path` atomically.

    If the body raises, the temporary file is deleted, and an existing file does not change. If the process
    is killed, the next call for a file in the same folder deletes the temporary file. The new file is
    synchronized to the disk before it replaces the old one, so it survives a loss of power.

    Parameters
    ----------
    path : str or pathlib.Path
        The file to write; its folder must exist.

    Raises
    ------
    OSError
        If there is no such folder, or the file cannot be moved to its place.
    """
    path = destination(path)
    if not path.parent.is_dir():
        # checked here, as some libraries report "permission denied" instead
        raise FileNotFoundError(
            errno.ENOENT, os.strerror(errno.ENOENT), str(path.parent)
        )
    # In the folder of the file itself, as a rename is atomic only
    # within one file system.
    folder, lock = own_folder(path.parent, ".trussflow-")
    try:
        partial = folder / path.name
        yield partial
        # Otherwise the name could reach the disk before the content, and a loss of
        # power leave an empty file.
        _to_disk(partial)
        partial.replace(path)
    finally:
        deleted(folder, lock)


def written(
    path: str | Path, text: str, error_class: type[Exception], cannot: str
) -> Path:
    """Write a `text` to the file `path` atomically; return the path.

    Raises
    ------
    Exception
        An `error_class` whose message begins with `cannot`, if the file cannot be written.
    """
    try:
        with replaced(path) as partial:
            partial.write_bytes(text.encode("utf-8"))
    except OSError as error:
        raise error_class(f"{cannot} '{path}': {error}") from error
    return Path(path)


def own_folder(place: Path, prefix: str) -> tuple[Path, IO[str]]:
    """Make a folder with a locked lock file; delete folders that killed processes left in the same place.

    The first call in a process looks for such folders, later calls less often the larger `place` is.

    Parameters
    ----------
    place : pathlib.Path
        Folder in which to make the new one.
    prefix : str
        Beginning of the name.

    Raises
    ------
    OSError
        If the folder cannot be made.
    """
    # bytes; about a thousand files on most file systems
    seldom = 1 + place.stat().st_size // 20_000
    looks = os.name != "nt" and next(_calls(place)) % seldom == 0  # no locks on Windows
    for left in place.glob(f"{prefix}*{LOCK_SUFFIX}") if looks else ():
        with contextlib.suppress(OSError):
            # another process has the lock, or has deleted the folder
            if is_private(left, stat.S_IFREG):
                deleted(left.with_suffix(""), locked(left))
    folder = place / f"{prefix}{uuid4().hex[:12]}"
    file = folder.with_suffix(LOCK_SUFFIX)
    file.touch(0o600)
    try:
        lock = locked(file)
    except BlockingIOError:
        # another process has taken the new file for one left behind, and deletes it
        return own_folder(place, prefix)
    except OSError:
        # the file system has no locks, so other processes cannot lock the file either
        lock = file.open("w")
    folder.mkdir(0o700)
    return folder, lock


@functools.lru_cache(maxsize=1000)
def _calls(_place: Path) -> Iterator[int]:
    """Return the counter of the folders that this process made in a place."""
    return itertools.count()


def deleted(folder: Path, lock: IO[str]) -> None:
    """Delete a `folder` of `own_folder`, and its `lock` last, so that another process can finish this."""
    shutil.rmtree(folder, ignore_errors=True)
    if os.name == "nt":  # Windows cannot delete open files
        lock.close()
    if not folder.exists():
        folder.with_suffix(LOCK_SUFFIX).unlink(missing_ok=True)
    lock.close()


def destination(path: str | Path) -> Path:
    """Return the `path` of a regular file, which need not exist, with links resolved.

    Raises
    ------
    OSError
        If the path is that of a folder, a device or a pipe.
    """
    path = Path(os.path.realpath(path))
    if path.is_dir():
        raise IsADirectoryError("it is a folder")
    if path.exists() and not path.is_file():
        raise OSError("it is a device, a pipe or a socket, not a file")
    return path


def _to_disk(file: Path) -> None:
    """Synchronize a file with the disk."""
    # Windows synchronizes only files that are open for writing.
    descriptor = os.open(file, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def locked(path: Path) -> IO[str]:
    """Open and lock a file; the lock ends when the file is closed or the process ends in any way.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    Raises
    ------
    BlockingIOError
        If another process has it locked or has deleted it.
    """
    lock = path.open("w")
    if sys.platform != "win32":  # no locks on Windows
        import fcntl

        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Another file may have the name by now, and this lock would not protect it.
            if not os.fstat(lock.fileno()).st_nlink:
                raise BlockingIOError(f"'{path}' was deleted while it was being locked")
        except OSError:
            lock.close()
            raise
    return lock


def refuse_foreign(folder: Path) -> None:
    """Raise PermissionError unless a `folder` belongs to the user, and no one else has write permission."""
    if not is_private(folder, stat.S_IFDIR):
        raise PermissionError(
            "it is another user's, or others may write to it (chmod go-w removes that)"
        )


def is_private(path: Path, kind: int) -> bool:
    """Return whether a path, other than a link, is of a kind and only its owner, the user, may write to it.

    Parameters
    ----------
    path : pathlib.Path
        The path to check.
    kind : int
        ``stat.S_IFREG`` or ``stat.S_IFDIR`` [-].

    Raises
    ------
    OSError
        If the path does not exist.
    """
    status = path.lstat()
    if os.name == "nt":
        # user folders are private on Windows, and mode bits have no meaning
        return stat.S_IFMT(status.st_mode) == kind
    return (stat.S_IFMT(status.st_mode), status.st_uid, status.st_mode & 0o022) == (
        kind,
        os.geteuid(),
        0,
    )

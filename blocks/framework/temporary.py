"""Temporary folders that do not stay behind, however their process ends."""

from __future__ import annotations

import atexit
import functools
import os
import shutil
import stat
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO

from trussflow.blocks.framework.files import locked


def process_folder() -> Path:
    """Return the temporary folder of this process; it goes when the process ends.

    Folders of processes that were killed are deleted when the next one needs a folder.

    Raises
    ------
    OSError
        If there is no room, or no folder for temporary files.
    """
    mine = os.getpid(), tempfile.gettempdir()
    if not _made(*mine).is_dir():  # somebody has tidied up
        _made.cache_clear()
    return _made(*mine)


def with_place(error: Exception) -> str:
    """Return what an `error` says, after where temporary files are, which may be why it came."""
    with suppress(OSError):  # if there is none, that is what the error says
        tempfile.gettempdir()
    return f"(temporary files are in '{tempfile.tempdir}'): {error}"


def not_loaded(error: Exception) -> str:
    """Return what an `error` says that came when a library was loaded, and what may be why."""
    hint = "; is memory limited, or the folder mounted noexec? TMPDIR and TRUSSFLOW_CACHE name another"
    return f"{error}{hint * ('map segment' in str(error))}"


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


@functools.cache
def _made(process: int, place: str) -> Path:
    """Return a new folder, locked as long as the process is there."""
    if os.name == "nt":  # there nothing is locked, so nothing is known to be left behind
        folder = Path(tempfile.mkdtemp(prefix="trussflow-", dir=place))
        atexit.register(_delete, process, folder)
        return folder
    for left in Path(place).glob("trussflow-*/lock"):
        with suppress(OSError):  # another process has it, or was faster
            if is_private(left.parent, stat.S_IFDIR):
                with locked(left):
                    shutil.rmtree(left.parent, ignore_errors=True)
    # By another name until it is locked: nobody must take it for one that was left behind.
    hidden = Path(tempfile.mkdtemp(prefix=".trussflow-", dir=place))
    lock = locked(hidden / "lock")
    folder = hidden.rename(hidden.with_name(hidden.name[1:]))
    atexit.register(_delete, process, folder, lock)
    return folder


def _delete(process: int, folder: Path, lock: IO[str] | None = None) -> None:
    """Delete the folder, unless this is a fork of the process that it belongs to."""
    if process == os.getpid():
        shutil.rmtree(folder, ignore_errors=True)
    if lock is not None:
        lock.close()

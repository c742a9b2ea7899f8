"""Temporary folders that are deleted even if their process is killed."""

from __future__ import annotations

import atexit
import functools
import os
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO

from trussflow.blocks.support.files import deleted, own_folder


def process_folder() -> Path:
    """Return the temporary folder of this process, which is deleted when the process ends.

    Folders of killed processes are deleted when the next process needs a folder.

    Raises
    ------
    OSError
        If the disk is full, or there is no folder for temporary files.
    """
    # A forked process gets a folder of its own: that of its parent is
    # deleted with the parent.
    mine = os.getpid(), tempfile.gettempdir()
    if not _made(*mine).is_dir():  # another program has deleted it
        _made.cache_clear()
    return _made(*mine)


def with_place(error: Exception) -> str:
    """Return the message of an `error` after the folder of temporary files, a possible cause."""
    with suppress(OSError):  # without such a folder, the message of the error says so
        tempfile.gettempdir()
    return f"(temporary files are in '{tempfile.tempdir}'): {error}"


def not_loaded(error: Exception) -> str:
    """Return the message of an `error` from loading a library, with a hint at its cause."""
    hint = "; is memory limited, or the folder mounted noexec? TMPDIR and TRUSSFLOW_CACHE name another"
    return f"{error}{hint * ('map segment' in str(error))}"


@functools.cache
def _made(process: int, place: str) -> Path:
    """Return a new folder, which is locked until the process ends."""
    folder, lock = own_folder(Path(place), "trussflow-")
    atexit.register(_delete, process, folder, lock)
    return folder


def _delete(process: int, folder: Path, lock: IO[str]) -> None:
    """Delete the folder, unless this process is a fork of the owner."""
    if process == os.getpid():
        deleted(folder, lock)
    lock.close()

"""Temporary folders that do not stay behind, however their process ends."""

from __future__ import annotations

import atexit
import functools
import os
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO

from trussflow.blocks.framework.files import deleted, own_folder


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


@functools.cache
def _made(process: int, place: str) -> Path:
    """Return a new folder, locked as long as the process is there."""
    folder, lock = own_folder(Path(place), "trussflow-")
    atexit.register(_delete, process, folder, lock)
    return folder


def _delete(process: int, folder: Path, lock: IO[str]) -> None:
    """Delete the folder, unless this is a fork of the process that it belongs to."""
    if process == os.getpid():
        deleted(folder, lock)
    lock.close()

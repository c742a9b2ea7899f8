"""Temporary folders that do not stay behind, however their process ends."""

from __future__ import annotations

import atexit
import functools
import os
import tempfile
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
    return _made(os.getpid(), tempfile.gettempdir())


def with_place(error: Exception) -> str:
    """Return what an `error` says, after where temporary files are, which may be why it came."""
    return f"(temporary files are in '{tempfile.tempdir}'): {error}"


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

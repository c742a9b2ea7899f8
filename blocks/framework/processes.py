"""Ending processes of others: compilers, and FMUs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

PATIENCE = 2.0
"""Time [s] after which processes that do not end are left alone."""


def end(process: subprocess.Popen[Any], mark: str = "") -> None:
    """End a process that leads a group, the group, and all it started, and wait for it.

    Parameters
    ----------
    process : subprocess.Popen
        The process; it was started with ``process_group=0`` or as a session of its own.
    mark : str
        What is in the environment of all it started and nowhere else: so those are found that left
        the group, if the system has ``/proc``.
    """
    if sys.platform == "win32":
        process.kill()
    else:
        with suppress(ProcessLookupError, PermissionError):  # the latter: macOS, of zombies
            os.killpg(process.pid, signal.SIGKILL)
        end_marked(mark)
    process.wait()


def end_marked(mark: str) -> None:
    """End all processes but this one that have a mark in their environment.

    Parameters
    ----------
    mark : str
        The text; none ends none.
    """
    deadline = time.monotonic() + PATIENCE
    # Again and again: what is there while we look may have started more.
    while mark and (found := list(_marked(mark.encode()))) and time.monotonic() < deadline:
        for number in found:
            with suppress(OSError):
                os.kill(number, signal.SIGKILL)


def _marked(mark: bytes) -> Iterator[int]:
    """Return the processes with a mark; of zombies there is no environment."""
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if mark in (folder / "environ").read_bytes() and folder.name != str(os.getpid()):
                yield int(folder.name)

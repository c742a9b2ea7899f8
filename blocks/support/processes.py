"""Termination of child processes: compilers and FMUs."""

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

END_TIMEOUT = 2.0
"""Longest time to end processes with a mark [s]; remaining ones are left running."""


def end(process: subprocess.Popen[Any], mark: str = "") -> None:
    """End a process, its process group, and all processes that it started, and wait for it.

    Parameters
    ----------
    process : subprocess.Popen
        The process; it was started with ``process_group=0`` or in its own session.
    mark : str
        Unique text in the environment of all processes that it started. On systems with ``/proc``,
        processes outside the group are found by this text.
    """
    if sys.platform == "win32":
        process.kill()
    else:
        with suppress(ProcessLookupError, PermissionError):
            # macOS reports PermissionError for zombies
            os.killpg(process.pid, signal.SIGKILL)
        end_marked(mark)
    # Reaps the process, which would otherwise stay as a zombie.
    process.wait()


def end_marked(mark: str) -> None:
    """End all processes with a mark in their environment, except this one.

    Parameters
    ----------
    mark : str
        The text; an empty text ends no process.
    """
    # A process that starts others faster than they end must not block this one.
    deadline = time.monotonic() + END_TIMEOUT
    # Repeated, as a process may start others during the search.
    while (
        mark and (found := list(_marked(mark.encode()))) and time.monotonic() < deadline
    ):
        for number in found:
            with suppress(OSError):
                os.kill(number, signal.SIGKILL)


def _marked(mark: bytes) -> Iterator[int]:
    """Yield the numbers of the processes with a mark; zombies have no environment."""
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if mark in (folder / "environ").read_bytes() and folder.name != str(
                os.getpid()
            ):
                yield int(folder.name)

"""Entry point of the child process: serves the calls of one FMU."""

from __future__ import annotations

import faulthandler
import os
import resource
import signal
import sys
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import fmpy.fmi2
import fmpy.fmi3
import fmpy.logging  # noqa: F401 - imported here, so that its time does not count as the FMU's

from trussflow.blocks.results.state_file import encode
from trussflow.blocks.support.processes import end_marked
from trussflow.fmu.errors import FmuError
from trussflow.fmu.runtime.messages import Messages

PARENT_CHECK_INTERVAL = 0.5
"""Interval [s] between two checks of the parent process."""


def main() -> None:
    """Serve one FMU until the other end of the connection closes."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    faulthandler.enable(all_threads=False)
    # After a crash the parent process has only the text written so far.
    Messages.echo = sys.stderr
    server = os.getpid()
    instance = None
    connection = Connection(int(sys.argv[1]))
    connection.send_bytes(encode((True, None), {}))  # reports that the imports are done
    while True:
        try:
            name, given, named = connection.recv()
        except EOFError:
            return
        try:
            value: Any = None
            if name == "open":
                make, file, memory = given
                if memory is not None:
                    _limit(memory)
                instance = make(file, **named)
            else:
                value = getattr(instance, name)
                if callable(value):
                    value = value(*given, **named)
            reply: Any = True, value
        except Exception as error:  # noqa: BLE001 - the parent process needs every error
            kind = type(error).__name__
            text = str(error) if isinstance(error, FmuError) else f"{kind}: {error}"
            reply = False, (kind, text, getattr(error, "status", 0))
        if os.getpid() != server:  # a copy forked by the FMU must not answer
            os._exit(0)
        connection.send_bytes(encode(reply, {}))


def _limit(memory: int) -> None:
    """Limit the memory of this process to its present size plus `memory` [B]."""
    # RLIMIT_AS counts all mapped memory, also that of Python and its libraries.
    taken = 0
    if (pages := Path("/proc/self/statm")).exists():
        taken = int(pages.read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + memory, taken + memory))


def _end_with(parent: int) -> None:
    """End this process when its parent has ended, even during a call of the FMU."""
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK_INTERVAL)
    # Processes that the FMU started may have left the process group.
    end_marked(os.environ["TMPDIR"])
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    main()

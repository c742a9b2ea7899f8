"""What runs in the child process: one FMU, told by messages what to do."""

from __future__ import annotations

import faulthandler
import os
import pickle
import resource
import signal
import socket
import sys
import threading
import time
from pathlib import Path
from typing import Any

import fmpy.fmi2
import fmpy.fmi3
import fmpy.logging  # noqa: F401 - now: later, the time that it takes would be the FMU's

from trussflow.blocks.framework.processes import end_marked
from trussflow.fmu.errors import FmuError
from trussflow.fmu.runtime.frames import TOKEN, encode, receive, send
from trussflow.fmu.runtime.messages import Messages

WATCH = 0.5
"""Time [s] between two looks whether the parent is still there."""


def main() -> None:
    """Serve one FMU until the other end of the socket closes."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    faulthandler.enable(all_threads=False)
    Messages.echo = sys.stderr
    server, instance = os.getpid(), None
    end = socket.socket(fileno=int(sys.argv[1]))
    send(end, bytes(TOKEN), encode((True, None)))  # all is imported
    while True:
        try:
            token, request = receive(end)
        except EOFError:
            break
        what, arguments = pickle.loads(request)
        try:
            if what == "open":
                kind, file, memory, options = arguments
                if memory is not None:
                    _limit(memory)
                instance = kind(file, **options)
                value: Any = None
            elif what == "get":
                value = getattr(instance, arguments)
            else:
                name, given, named = arguments
                value = getattr(instance, name)(*given, **named)
            reply: Any = True, value
        except FmuError as error:
            reply = False, (type(error).__name__, str(error), getattr(error, "status", 0))
        except Exception as error:  # noqa: BLE001 - whatever it is, the other side must hear of it
            reply = False, ("FmuError", f"{type(error).__name__}: {error}", 0)
        if os.getpid() != server:  # a copy that the FMU has forked; the other one answers
            os._exit(0)
        send(end, token, encode(reply))
    if instance is not None:
        instance.close()


def _limit(memory: int) -> None:
    """Let this process take no more than so much memory [B], over what it has."""
    taken = 0
    if (pages := Path("/proc/self/statm")).exists():
        taken = int(pages.read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + memory, taken + memory))


def _end_with(parent: int) -> None:
    """End this process when its parent has ended, even while the FMU does not return."""
    while os.getppid() == parent:
        time.sleep(WATCH)
    end_marked(os.environ["TMPDIR"])
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    main()

"""What runs in the child process: one FMU, told by messages what to do."""

from __future__ import annotations

import faulthandler
import os
import sys
import threading
import time
from multiprocessing.connection import Connection
from typing import Any

from trussflow.fmu.errors import FmuError
from trussflow.fmu.runtime.loaded import LoadedFmu
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.fmu.runtime.loaded_model_exchange import LoadedModelExchange
from trussflow.fmu.runtime.messages import Messages

WATCH = 0.5
"""Time [s] between two looks whether the parent is still there."""

KINDS: dict[str, type[LoadedFmu]] = {
    kind.__name__: kind for kind in (LoadedCoSimulation, LoadedModelExchange)
}
"""What can be served, by name."""


def main() -> None:
    """Serve one FMU until the other end of the pipe closes."""
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    faulthandler.enable(all_threads=False)
    Messages.echo = sys.stderr
    pipe: Connection[Any, Any] = Connection(int(sys.argv[1]))
    instance: LoadedFmu | None = None
    while True:
        try:
            what, arguments = pipe.recv()
        except EOFError:
            break
        try:
            if what == "open":
                kind, file, options = arguments
                instance = KINDS[kind](file, **options)
                value: Any = None
            elif what == "get":
                value = tuple(getattr(instance, name) for name in arguments)
            else:
                name, given, named = arguments
                value = getattr(instance, name)(*given, **named)
            reply: Any = True, value
        except FmuError as error:
            reply = False, error
        except Exception as error:  # noqa: BLE001 - whatever it is, the other side must hear of it
            reply = False, FmuError(f"{type(error).__name__}: {error}")
        pipe.send(reply)
    if instance is not None:
        instance.close()


def _end_with(parent: int) -> None:
    """End this process when its parent has ended, even while the FMU does not return."""
    while os.getppid() == parent:
        time.sleep(WATCH)
    os._exit(1)


if __name__ == "__main__":
    main()

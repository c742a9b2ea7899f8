"""A process that runs samples for another one, until that ends or a sample hangs."""

from __future__ import annotations

import os
import pickle
import queue
import sys
import threading
from typing import Any

from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.sweeps import samples


def main() -> None:
    """Do what comes in, until nothing comes any more."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what blocks print goes where errors go
    tasks: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(tasks,), daemon=True).start()
    samples.watch()
    while True:
        function, arguments = tasks.get()
        try:
            answer = True, function(*arguments)
        except Exception as error:  # noqa: BLE001 - whoever asked is told
            ours = isinstance(error, samples.NotTakenOverError)
            answer = False, error if ours else SimulationError(f"{type(error).__name__}: {error}")
        pickle.dump(answer, answers)
        answers.flush()


def _listen(tasks: queue.SimpleQueue[Any]) -> None:
    """Take tasks; without whoever gives them there is nothing to do, also in the middle of a sample."""
    while True:
        try:
            tasks.put(pickle.load(sys.stdin.buffer))
        except EOFError:
            os._exit(0)

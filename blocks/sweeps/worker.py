"""Worker process of a sweep: it runs samples until its parent ends or a sample hangs."""

from __future__ import annotations

import os
import pickle
import queue
import threading
from typing import Any, BinaryIO

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.sweeps import samples


def main() -> None:
    """Run the tasks from standard input until it is closed."""
    # Copies of the descriptors: user code may close or use 0 and 1.
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    # What user code prints goes to standard error, not among the answers.
    os.dup2(2, 1)
    tasks: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(tasks, requests), daemon=True).start()
    samples.watch()
    while True:
        function, arguments = tasks.get()
        try:
            answer = True, function(*arguments)
        except Exception as error:  # noqa: BLE001 - the parent process gets it
            answer = False, SimulationError(f"{type(error).__name__}: {error}")
        pickle.dump(answer, answers)
        answers.flush()


def _listen(tasks: queue.SimpleQueue[Any], requests: BinaryIO) -> None:
    """Queue the tasks that arrive; end the process, also within a sample, if no more can arrive."""
    while True:
        try:
            tasks.put(pickle.load(requests))
        except (EOFError, OSError, ValueError):
            # The parent has ended. sys.exit() would end this thread
            # only, not the sample.
            os._exit(0)

"""Who runs samples: this thread, or processes of our own that can be lost without losing others."""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any

from trussflow.blocks.framework.errors import TrussflowError
from trussflow.blocks.framework.processes import end

START = "from trussflow.blocks.sweeps.worker import main; main()"


class WorkerLostError(TrussflowError):
    """A process ended in the middle of its samples.

    Attributes
    ----------
    code : int
        Its exit code [-].
    """

    def __init__(self, code: int) -> None:
        super().__init__(f"the process that ran it ended with exit code {code}")
        self.code = code


class Serial(Executor):
    """Runs at once what is submitted, whatever the number of workers."""

    def __init__(self, _workers: int) -> None:
        self._max_workers = 1  # as those of the standard library say it

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return what is done already: `fn` of `args` and `kwargs` [any]."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - the future has it
            future.set_exception(error)
        return future


class Processes(ThreadPoolExecutor):
    """Processes of our own, each behind a thread; one that ends loses only what it was doing.

    The executor of the standard library is lost as a whole then. These are started anew, not forked, and
    need no ``if __name__ == "__main__"``: they import nothing of the script.

    Parameters
    ----------
    workers : int
        How many [-].
    """

    def __init__(self, workers: int) -> None:
        super().__init__(workers, "sweep")
        self._own = threading.local()
        self._all: set[subprocess.Popen[bytes]] = set()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Let a process compute `fn` of `args`; there are no `kwargs` [any]."""
        return super().submit(self._remote, fn, *args, **kwargs)

    def _remote(self, fn: Callable[..., Any], *args: Any) -> Any:
        process = getattr(self._own, "process", None) or self._start()
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            pickle.dump((fn, args), process.stdin)
            process.stdin.flush()
            done, found = pickle.load(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError):
            self._own.process = None
            _ended(process)
            self._all.discard(process)
            raise WorkerLostError(process.returncode) from None
        if not done:
            raise found
        return found

    def _start(self) -> subprocess.Popen[bytes]:
        # They fill the cores already, and find what this process finds.
        one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        path = os.pathsep.join(os.path.abspath(entry) for entry in sys.path)
        self._own.process = process = subprocess.Popen(
            [sys.executable, "-P", "-c", START],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | one | {"PYTHONPATH": path},
            process_group=None if os.name == "nt" else 0,  # Ctrl-C is for this process
        )
        self._all.add(process)
        return process

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes, also in the middle of samples; `wait` and `cancel_futures` as in the base."""
        for process in list(self._all):
            process.kill()  # their threads come back
        super().shutdown(wait, cancel_futures=cancel_futures)
        for process in list(self._all):
            _ended(process)


def _ended(process: subprocess.Popen[bytes]) -> None:
    """End a process, and all that it started, and close what leads to it."""
    end(process)
    for stream in (process.stdin, process.stdout):
        with contextlib.suppress(OSError):  # what waits cannot be written any more
            stream.close() if stream is not None else None

"""Executors of samples: this thread, or worker processes that fail independently."""

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

from trussflow.blocks.errors import TrussflowError
from trussflow.blocks.support.processes import end

START_CODE = "from trussflow.blocks.sweeps.worker import main; main()"


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
    """Executor that runs a task when it is submitted, for any number of workers."""

    def __init__(self, _workers: int) -> None:
        self._max_workers = 1  # the attribute of the executors of the standard library

    def submit(
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> Future[Any]:
        """Return the completed future of `fn` with `args` and `kwargs` [any]."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - the future raises it
            future.set_exception(error)
        return future


class Processes(ThreadPoolExecutor):
    """Executor with worker processes, each served by a thread; if a worker ends, only its task is lost.

    The process pool of the standard library would be broken as a whole. Workers are started, not forked,
    and do not import the user's script, which needs no ``if __name__ == "__main__"``.

    Parameters
    ----------
    workers : int
        Number of workers [-].
    """

    def __init__(self, workers: int) -> None:
        super().__init__(workers, "sweep")
        # One process for each thread of the pool.
        self._own = threading.local()
        self._all: set[subprocess.Popen[bytes]] = set()

    def submit(
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> Future[Any]:
        """Submit `fn` with `args` to a worker process; `kwargs` must be empty [any]."""
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
            # The next task of this thread starts a new process.
            self._own.process = None
            _ended(process)
            self._all.discard(process)
            raise WorkerLostError(process.returncode) from None
        if not done:
            raise found
        return found

    def _start(self) -> subprocess.Popen[bytes]:
        # One thread per library, as the workers use all cores already; the same import path as here.
        one = dict.fromkeys(
            ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
        )
        path = os.pathsep.join(os.path.abspath(entry) for entry in sys.path)
        self._own.process = process = subprocess.Popen(
            # Without -P, Python would put the current folder before PYTHONPATH.
            [sys.executable, "-P", "-c", START_CODE],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | one | {"PYTHONPATH": path},
            process_group=None if os.name == "nt" else 0,  # Ctrl-C is for this process
        )
        self._all.add(process)
        return process

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes, also during samples; `wait` and `cancel_futures` as in the base class."""
        for process in list(self._all):
            process.kill()  # so that their threads return
        # Otherwise a thread would start a new process for a sample that waits.
        super().shutdown(wait, cancel_futures=True)
        for process in list(self._all):
            _ended(process)


def _ended(process: subprocess.Popen[bytes]) -> None:
    """End a process and all that it started, and close its pipes."""
    end(process)
    for stream in (process.stdin, process.stdout):
        with contextlib.suppress(OSError):  # buffered data cannot be written any more
            stream.close() if stream is not None else None

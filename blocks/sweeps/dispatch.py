"""Scheduler: distribution of samples to workers, and collection of the results."""

from __future__ import annotations

import math
import time
from collections import deque
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.support.progress import ProgressBar
from trussflow.blocks.sweeps.chunk_store import PIECE_SECONDS, Pieces
from trussflow.blocks.sweeps.executors import WorkerLostError
from trussflow.blocks.sweeps.samples import HUNG_EXIT_CODE, one_sample, run_samples

TASK_SECONDS = 0.2
"""Wall time of one task, if samples are short [s]."""

TASK_SAMPLES = 500
"""Largest number of samples in one task [-]."""


class Dispatch:
    """Scheduler of the samples of one sweep.

    Parameters
    ----------
    pool : concurrent.futures.Executor
        The workers.
    recipe : bytes
        Pickled `Recipe` of the samples.
    columns : dict
        Varied values by name.
    pieces : Pieces
        Store of finished samples.
    together : int
        Number of samples that a worker runs as one batch [-].
    """

    def __init__(
        self,
        pool: Executor,
        recipe: bytes,
        columns: dict[str, NDArray[Any]],
        pieces: Pieces,
        together: int = 1,
    ) -> None:
        self._pool, self._recipe, self._columns, self._pieces = (
            pool,
            recipe,
            columns,
            pieces,
        )
        self._together = together
        self.total = len(next(iter(columns.values())))
        self._fresh = deque(np.flatnonzero(~pieces.finished).tolist())
        # Samples of a lost task: which of them ended the worker is found
        # by running each alone.
        self._again: deque[int] = deque()
        self._running: dict[Future[Any], tuple[list[int], bool]] = {}
        # Total wall time and number of samples so far, for the size of tasks.
        self._seconds = 0.0
        self._timed = 0

    def run(
        self, name: str, room: int, progress: bool, seconds: float = math.inf
    ) -> None:
        """Run all samples that are not finished.

        Parameters
        ----------
        name : str
            Name of the diagram, for the progress bar.
        room : int
            Largest number of simultaneous tasks [-].
        progress : bool
            Whether to show a progress bar after a second.
        seconds : float
            Wall time after which no more tasks are submitted [s].

        Raises
        ------
        SimulationError
            If the executor is broken.
        """
        finished, failed = self._pieces.finished, self._pieces.failed
        end = time.monotonic() + seconds
        with ProgressBar(
            name,
            total=self.total,
            initial=int(finished.sum()),
            unit="sample",
            shown=progress,
        ) as bar:
            try:
                while self._fresh or self._again or self._running:
                    if time.monotonic() > end:
                        break
                    while (self._fresh or self._again) and len(self._running) < room:
                        self._submit(room)
                    # With a timeout, so that chunks are written in time
                    # even if no task ends.
                    done, _ = wait(self._running, PIECE_SECONDS, FIRST_COMPLETED)
                    for future in done:
                        self._take(future)
                    self._pieces.write(force=False)
                    bar.set_postfix_str(f"{failed.sum()} failed", refresh=False)
                    bar.update(int(finished.sum()) - bar.n)
            finally:
                for future in self._running:
                    future.cancel()

    def _submit(self, room: int) -> None:
        """Submit the next samples: several per task if they are short, those of a lost worker one by one."""
        again = bool(self._again)
        if again:
            numbers = [self._again.popleft()]
        else:
            size = (
                int(TASK_SECONDS * self._timed / self._seconds) if self._seconds else 1
            )
            # At most an equal share of the rest, so that no worker waits for the others
            # at the end. Whole batches, so that all lanes are used.
            groups = min(size, TASK_SAMPLES, len(self._fresh) // room) // self._together
            size = max(1, groups) * self._together
            numbers = [
                self._fresh.popleft() for _ in range(min(size, len(self._fresh)))
            ]
        which = np.array(numbers)
        columns = {name: values[which] for name, values in self._columns.items()}
        try:
            future = self._pool.submit(run_samples, self._recipe, which, columns)
        except RuntimeError as error:  # the executor is broken or shut down
            raise self._broken(error) from error
        self._running[future] = numbers, again

    def _take(self, future: Future[Any]) -> None:
        """Store the results of a task."""
        numbers, again = self._running.pop(future)
        try:
            samples, seconds = future.result()
        except Exception as error:
            if (
                not isinstance(error, WorkerLostError)
                and type(error).__name__ != "KilledWorker"
            ):
                # KilledWorker is the same error of Dask, which may not be installed.
                raise self._broken(error) from error
            hung = getattr(error, "code", None) == HUNG_EXIT_CODE
            # A sample counts as lost if its worker ended twice: the first time may be
            # chance, such as another process that used up the memory. A hung sample
            # would only hang again.
            if len(numbers) > 1 or not (again or hung):
                self._again.extend(numbers)
                return
            status, message = "lost", f"its worker ended twice: {error}"
            if hung:
                status, message = (
                    "timeout",
                    "it did not stop at its time limit, so its process was ended",
                )
            varied = {
                name: values[numbers[0]] for name, values in self._columns.items()
            }
            self._pieces.add([one_sample(numbers[0], varied, status, message)])
            return
        self._pieces.add(samples)
        self._seconds += seconds
        self._timed += len(numbers)

    def _broken(self, error: BaseException) -> SimulationError:
        kept = f"{self._pieces.finished.sum()} of {self.total} samples are finished"
        goes_on = (
            "and kept: the same call continues with the others"
            if self._pieces.path
            else "and lost without path=..."
        )
        return SimulationError(
            f"the workers cannot continue: {type(error).__name__}: {error}; {kept} {goes_on}"
        )

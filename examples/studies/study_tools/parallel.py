"""Independent jobs side by side, one process per core."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from study_tools.cache import Finished, Job, perform
from trussflow.blocks.framework.errors import TrussflowError
from trussflow.blocks.framework.telling import DISPLAY
from trussflow.models.errors import ModelError


@dataclass(frozen=True, slots=True)
class Failed:
    """A run that could not be finished.

    Attributes
    ----------
    name : str
        Of the job.
    reason : str
        What went wrong.
    """

    name: str
    reason: str


def perform_all(
    jobs: Sequence[Job], folder: Path, *, workers: int | None = None, progress: bool = True
) -> list[Finished | Failed]:
    """Run all jobs in processes of their own; one that fails does not stop the others.

    Parameters
    ----------
    jobs : sequence of Job
        The first are started first.
    folder : pathlib.Path
        Where finished runs are kept.
    workers : int, optional
        Processes at a time [-]; by default one per core.
    progress : bool
        Whether to show a progress bar.

    Returns
    -------
    list of Finished or Failed
        In the order of the jobs.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C, after all processes have been stopped. Runs that were finished are kept.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pool = ProcessPoolExecutor(
        max_workers=workers or None, mp_context=multiprocessing.get_context("spawn"), initializer=_initialize
    )
    running: dict[Future[Finished | Failed], Job] = {}
    try:
        with _one_thread_each():
            running = {pool.submit(_performed, job, folder): job for job in jobs}
        with tqdm(
            total=len(jobs), unit="run", disable=not progress, leave=False, file=DISPLAY, dynamic_ncols=True
        ) as bar:
            for future in as_completed(running):
                bar.set_description(running[future].name)
                bar.update()
    except KeyboardInterrupt:
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
    return [_outcome(future, job) for future, job in running.items()]


def finish_all(jobs: Sequence[Job], folder: Path, *, workers: int | None = None) -> list[Finished]:
    """Return all jobs finished, as `perform_all` does them.

    Parameters
    ----------
    jobs, folder, workers
        As for `perform_all`.

    Raises
    ------
    ModelError
        If one failed; the others are finished and kept all the same.
    """
    outcomes = perform_all(jobs, folder, workers=workers)
    failed = [f"{one.name}: {one.reason}" for one in outcomes if isinstance(one, Failed)]
    if failed:
        raise ModelError(
            f"{len(failed)} of {len(jobs)} runs failed; the others are kept. No report was "
            "written.\n  " + "\n  ".join(failed)
        )
    return [one for one in outcomes if isinstance(one, Finished)]


def _initialize() -> None:
    """Let Ctrl-C, which reaches all processes of a terminal, end this one without a traceback."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes started now use one thread for linear algebra: they fill the cores already."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    before = {name: os.environ[name] for name in names if name in os.environ}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name in names:
            del os.environ[name]
        os.environ.update(before)


def _performed(job: Job, folder: Path) -> Finished | Failed:
    try:
        return perform(job, folder)
    except (TrussflowError, OSError) as error:
        return Failed(job.name, str(error))


def _outcome(future: Future[Finished | Failed], job: Job) -> Finished | Failed:
    error = future.exception()
    if error is None:
        return future.result()
    return Failed(job.name, f"{type(error).__name__}: {error}")

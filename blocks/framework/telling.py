"""Telling a user at a terminal what is being done, where that takes more than a second."""

from __future__ import annotations

import multiprocessing
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

EVERY = 1.0
"""Time [s] between two looks at the clock; what is done by then says nothing."""


@contextmanager
def told(what: str) -> Iterator[None]:
    """Say on the terminal `what` is being done and for how long by now, then take it away again.

    Nothing is said where nobody looks on: in files, pipes and processes that others started.

    Examples
    --------
    >>> with told("thinking"):
    ...     6 * 7
    42
    """
    if not sys.stderr.isatty() or multiprocessing.parent_process() is not None:
        yield
        return
    begun, done, said = time.perf_counter(), threading.Event(), threading.Event()

    def tell() -> None:
        while not done.wait(EVERY):
            said.set()
            print(f"\r{what}: {time.perf_counter() - begun:.0f} s", end="", file=sys.stderr, flush=True)

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()
        if said.is_set():
            print("\r\033[K", end="", file=sys.stderr, flush=True)

"""Telling a user at a terminal what is being done, where that takes more than a second."""

from __future__ import annotations

import contextlib
import multiprocessing
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator
from typing import Any, TypeVar


class Display:
    """Standard error as the file that progress is written to: where it cannot be written, nothing happens.

    It may be closed, as in a service, or None, or a pipe that nobody reads any more.
    """

    def write(self, text: str) -> None:
        """Write a `text`."""
        with contextlib.suppress(Exception):
            sys.stderr.write(text)

    def flush(self) -> None:
        """Write what is in the buffer."""
        with contextlib.suppress(Exception):
            sys.stderr.flush()

    def isatty(self) -> bool:
        """Return whether it is a terminal."""
        with contextlib.suppress(Exception):
            return sys.stderr.isatty()
        return False

    def __getattr__(self, name: str) -> Any:
        return getattr(sys.stderr, name)


DISPLAY: Any = Display()

Item = TypeVar("Item")
Made = TypeVar("Made")

EVERY = 1.0
"""Time [s] between two looks at the clock; what is done by then says nothing."""

_telling: list[threading.Event] = []
"""What is being done, the innermost last: it alone is told, for there is one line."""


@contextlib.contextmanager
def told(what: str, more: Callable[[float], str] = lambda _: "") -> Iterator[None]:
    """Say on the terminal `what` is being done and for how long by now, then take it away again.

    What `more` returns of that time [s] is said behind it. Nothing is said where nobody looks on: in files,
    pipes and processes that others started.

    Examples
    --------
    >>> with told("thinking"):
    ...     6 * 7
    42
    """
    if not DISPLAY.isatty() or multiprocessing.parent_process() is not None:
        yield
        return
    begun, done, said = time.perf_counter(), threading.Event(), threading.Event()

    def tell() -> None:
        while not done.wait(EVERY):
            if _telling[-1] is not done:
                continue
            said.set()
            took = time.perf_counter() - begun
            print(f"\r\033[K{what}: {took:.0f} s{more(took)}", end="", file=DISPLAY, flush=True)

    teller = threading.Thread(target=tell, daemon=True)
    _telling.append(done)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()
        _telling.remove(done)
        if said.is_set():
            print("\r\033[K", end="", file=DISPLAY, flush=True)


def counted(what: str, items: Collection[Item]) -> Iterator[Item]:
    """Yield `items`, whose work is about alike, and say as `told` does `what` they are and the time left.

    Examples
    --------
    >>> for number in counted("squaring", [1, 2, 3]):
    ...     print(number**2)
    1
    4
    9
    """
    begun, done, ready = time.perf_counter(), 0, 0.0

    def more(took: float) -> str:
        left = max(0.0, ready / done * len(items) - took) if done else 0.0
        return f", {done} of {len(items)}" + (f", {left:.0f} s left" if done else "")

    with told(what, more):
        for item in items:
            yield item
            done, ready = done + 1, time.perf_counter() - begun


def all_counted(what: str, work: Callable[[Item], Made], items: Collection[Item]) -> list[Made]:
    """Return what `work` makes of all `items`, and say as `counted` does `what` that is.

    A comprehension over `counted` would go on telling after an error, as long as its traceback is held.
    """
    made = []
    for item in counted(what, items):
        made.append(work(item))  # noqa: PERF401
    return made

"""Progress display at a terminal, for operations that take more than a second."""

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

REFRESH_INTERVAL = 1.0
"""Refresh interval of the progress line [s]; shorter operations show none."""

_telling: list[threading.Event] = []
"""End signals of the operations in progress, innermost last; only that one is displayed."""


@contextlib.contextmanager
def told(what: str, more: Callable[[float], str] = lambda _: "") -> Iterator[None]:
    """Display `what` and the elapsed time on the terminal during the body, then clear the line.

    The result of `more` for that time [s] follows. Nothing is displayed if standard error is not a terminal,
    or in child processes.

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
        while not done.wait(REFRESH_INTERVAL):
            if _telling[-1] is not done:
                continue
            said.set()
            took = time.perf_counter() - begun
            print(
                f"\r\033[K{what}: {took:.0f} s{more(took)}",
                end="",
                file=DISPLAY,
                flush=True,
            )

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
    """Yield `items` of similar effort; display `what`, the number done and the remaining time as `told` does.

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


def all_counted(
    what: str, work: Callable[[Item], Made], items: Collection[Item]
) -> list[Made]:
    """Return the results of `work` for all `items`; display `what` and the progress as `counted` does."""
    made = []
    # A comprehension would continue the display after an error while its traceback is referenced.
    for item in counted(what, items):
        made.append(work(item))  # noqa: PERF401
    return made

"""Progress display on standard error, for operations that take more than a second."""

from __future__ import annotations

import contextlib
import multiprocessing
import sys
import threading
import time
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any, TypeVar

from trussflow.blocks.errors import TimeLimitError

if "ipykernel" in sys.modules:
    with warnings.catch_warnings(action="ignore"):
        # Without ipywidgets it warns, and displays the bars as text.
        from tqdm.auto import tqdm
else:
    # tqdm.auto imports asyncio and ssl.
    from tqdm import tqdm  # type: ignore[assignment]


class Display:
    """Standard error as the file of the progress bars; failures to write are ignored.

    It may be closed, as in a service, or None, or a pipe without a reader.
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
        # Looked up at each use, as tests and notebooks replace sys.stderr.
        return getattr(sys.stderr, name)


DISPLAY: Any = Display()

Item = TypeVar("Item")
Result = TypeVar("Result")

DISPLAY_DELAY = 1.0
"""Time after which an operation is displayed [s]; shorter ones are not."""


class ProgressBar(tqdm):  # type: ignore[type-arg]
    """Progress bar that appears after a second, and disappears at the end.

    Parameters
    ----------
    name : str
        Name of the operation.
    items : iterable, optional
        Items to iterate over.
    shown : bool
        Whether to show it at all.
    **settings
        Settings of tqdm.
    """

    def __init__(
        self,
        name: str,
        items: Iterable[Any] | None = None,
        *,
        shown: bool,
        **settings: Any,
    ) -> None:
        super().__init__(
            items,
            name,
            disable=not shown,
            delay=DISPLAY_DELAY,
            leave=False,
            file=DISPLAY,
            dynamic_ncols=True,
            **settings,
        )


class RunBar(ProgressBar):
    """Progress bar of a run in simulated seconds, with the real-time factor and the time limit.

    Parameters
    ----------
    name : str
        Name of the diagram.
    duration : float
        Simulated time of the whole run [s].
    shown : bool
        Whether to show it at all.
    time_limit : float, optional
        Largest wall time of the run [s].
    """

    def __init__(
        self, name: str, duration: float, shown: bool, time_limit: float | None = None
    ) -> None:
        self._limit = time_limit
        self._begun = time.monotonic()
        super().__init__(
            name,
            total=duration,
            shown=shown,
            bar_format="{desc} {percentage:3.0f} %|{bar}| {n:.6g}/{total:.6g} s, "
            "{factor} x real time, {remaining} left",
        )

    def update(self, n: float | None = 1) -> bool | None:
        """Add simulated time `n` [s].

        Raises
        ------
        TimeLimitError
            If the run exceeds its time limit.
        """
        # Before tqdm, whose update does nothing if the bar is not shown.
        if self._limit is not None and time.monotonic() - self._begun > self._limit:
            raise TimeLimitError(
                f"the run takes longer than {self._limit:g} s; the logged data are kept"
            )
        return super().update(n)

    def close(self) -> None:
        """Close the bar; notebooks mark a bar as failed if it is less than full, also by round-off."""
        if self.total and self.n > 0.999999999 * self.total:
            self.n = self.total
        super().close()

    @property
    def format_dict(self) -> dict[str, Any]:
        """Return the values that the bar can print, including the real-time factor."""
        found = dict(super().format_dict)
        elapsed = found["elapsed"]
        found["n"] = min(found["n"], found["total"])  # round-off of the sum of steps
        return found | {"factor": f"{found['n'] / elapsed:.3g}" if elapsed else "?"}


def counted(name: str, items: Collection[Item]) -> Any:
    """Return a progress bar with a `name` over `items`; it is shown on terminals, not in child processes.

    Examples
    --------
    >>> for number in counted("squaring", [1, 2, 3]):
    ...     print(number**2)
    1
    4
    9
    """
    return ProgressBar(name, items, shown=_is_displayed())


def map_counted(
    name: str, function: Callable[[Item], Result], items: Collection[Item]
) -> list[Result]:
    """Return the results of a `function` of all `items`, with a progress bar of that `name`."""
    with counted(name, items) as bar:
        return [function(item) for item in bar]


@contextlib.contextmanager
def status_line(text: str) -> Iterator[None]:
    """Display a `text` on terminals while the body runs, if it takes more than a second.

    Examples
    --------
    >>> with status_line("thinking"):
    ...     6 * 7
    42
    """
    displayed = threading.Event()

    def display() -> None:
        displayed.set()
        print(f"\r\033[K{text} ...", end="", file=DISPLAY, flush=True)

    if not _is_displayed():
        yield
        return
    timer = threading.Timer(DISPLAY_DELAY, display)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        # The text may be on its way: it must not appear after the line was cleared.
        timer.join()
        if displayed.is_set():
            print("\r\033[K", end="", file=DISPLAY, flush=True)


def _is_displayed() -> bool:
    """Return whether standard error is a terminal, and this is no child process."""
    return bool(DISPLAY.isatty()) and multiprocessing.parent_process() is None

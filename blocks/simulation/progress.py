"""The progress bar, with the real-time factor, and what looks at the clock meanwhile."""

from __future__ import annotations

import time
from typing import Any

from tqdm import tqdm

from trussflow.blocks.errors import TimeLimitError
from trussflow.blocks.support.progress import DISPLAY

CHUNK_SECONDS = 0.1
"""Wall time [s] between two looks at the keyboard and the progress bar."""


def paced(chunk: int, seconds: float, longest: int) -> int:
    """Return how many ticks come next if a `chunk` of them took so many `seconds`: `longest` at most [-]."""
    factor = min(4.0, CHUNK_SECONDS / max(seconds, 1e-9))
    return min(max(16, int(chunk * factor)), longest)


class ProgressBar(tqdm):  # type: ignore[type-arg]
    """A bar in simulated seconds; it shows itself only in runs of more than a second.

    Parameters
    ----------
    name : str
        Name of the running job.
    duration : float
        Simulated time of the whole run [s].
    shown : bool
        Whether to show it at all.
    time_limit : float, optional
        Wall time that the run may take [s].
    """

    def __init__(
        self, name: str, duration: float, shown: bool, time_limit: float | None = None
    ) -> None:
        self._limit = time_limit
        self._begun = time.monotonic()
        super().__init__(
            total=duration,
            desc=name,
            delay=1.0,
            disable=not shown,
            leave=False,
            file=DISPLAY,
            dynamic_ncols=True,
            bar_format="{desc} {percentage:3.0f} %|{bar}| {n:.6g}/{total:.6g} s, "
            "{factor} x real time, {remaining} left",
        )

    def update(self, n: float | None = 1) -> bool | None:
        """Note that the run came `n` further [s].

        Raises
        ------
        TimeLimitError
            If that took longer than it may.
        """
        if self._limit is not None and time.monotonic() - self._begun > self._limit:
            raise TimeLimitError(
                f"the run takes longer than {self._limit:g} s; what was logged is kept"
            )
        return super().update(n)

    @property
    def format_dict(self) -> dict[str, Any]:
        """Return what the bar can print, the real-time factor included."""
        found = dict(super().format_dict)
        elapsed = found["elapsed"]
        found["n"] = min(found["n"], found["total"])  # round-off of the sum of steps
        return found | {"factor": f"{found['n'] / elapsed:.3g}" if elapsed else "?"}

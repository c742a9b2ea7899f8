"""Real-time pacing: simulated time waits for the clock on the wall."""

from __future__ import annotations

import time

from trussflow.blocks.support.call_site import warn

PACED_SECONDS = 1e-3
"""Wall time of the steps that are taken without a wait between them, and delay that is no overrun [s].

Operating systems do not keep shorter times.
"""

WARNED_DELAY = 0.1
"""Largest delay of a run above which it warns [s]."""


class Pacer:
    """Delays a run, so that simulated time passes at a constant ratio to wall time.

    After a delay, the run catches up.

    Parameters
    ----------
    pace : float
        Simulated seconds in a second of wall time [-].
    now : float
        Time of the run, which begins now [s].

    Attributes
    ----------
    overruns : int
        Number of waits that came more than a millisecond too late [-].
    largest_delay : float
        Largest delay of these [s, wall time].
    """

    def __init__(self, pace: float, now: float) -> None:
        self.pace = float(pace)
        self.overruns = 0
        self.largest_delay = 0.0
        self.begin(now)

    def begin(self, now: float) -> None:
        """Begin to count at the time `now` of the run [s]."""
        self._zero = time.perf_counter() - now / self.pace

    def wait(self, now: float) -> None:
        """Wait until the wall time of the time `now` of the run [s]."""
        left = self._zero + now / self.pace - time.perf_counter()
        if left >= 0.0:
            time.sleep(left)
        elif -left > PACED_SECONDS:
            self.overruns += 1
            self.largest_delay = max(self.largest_delay, -left)

    @property
    def counts(self) -> dict[str, float]:
        """Number of overruns [-] and largest delay [s], for results."""
        return {"overruns": self.overruns, "largest_delay": self.largest_delay}

    def warn(self, name: str) -> None:
        """Warn of long delays in the run of the diagram with this `name`."""
        if self.largest_delay > WARNED_DELAY:
            warn(
                f"'{name}' was too slow for pace={self.pace:g} {self.overruns} times, by up to "
                f"{self.largest_delay:.3g} s; take a larger step, or a smaller pace"
            )

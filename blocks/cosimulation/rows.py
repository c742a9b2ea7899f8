"""Logged rows, collected before they are handed over to a log."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.cosimulation.coupling import Coupled
from trussflow.blocks.simulation.results import Log

ROWS = 1000
"""Logged rows that are handed over at a time."""


class Rows:
    """Collects the logged signals of one instant after the other.

    Parameters
    ----------
    log : Log
        Takes them.
    places : array of int
        Where they are among all signals.
    coupled : Coupled
        Has the signals and the time.

    Attributes
    ----------
    time : float
        Time of the last row [s].
    """

    def __init__(self, log: Log, places: NDArray[np.int64], coupled: Coupled) -> None:
        self._log, self._places, self._coupled = log, places, coupled
        self._times = np.empty(ROWS)
        self._rows = np.empty((ROWS, len(places)))
        self._number = 0
        self.time = 0.0

    def take(self) -> None:
        """Log the signals as they are."""
        self.time = self._coupled.time
        self._times[self._number] = self.time
        self._coupled.signals.take(self._places, out=self._rows[self._number], mode="clip")
        self._number += 1
        if self._number == ROWS:
            self.flush()

    def flush(self) -> None:
        """Hand over what was collected."""
        self._log.append(self._times[: self._number].copy(), self._rows[: self._number].copy())
        self._number = 0

"""Values that depend on each other are gone through until they settle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.types import Vector

ROUNDS = 500
"""Rounds to try in any case: a circle in which each round changes less settles too, to the last bit."""


def settle(sweep: Callable[[], Vector], rounds: int, fault: str) -> None:
    """Go through values that depend on each other until they no longer change.

    Parameters
    ----------
    sweep : callable
        Works out each value once from what the others are now; returns them all.
    rounds : int
        Rounds in which values that do not depend on themselves have settled: one may depend on
        the next, so as many as there are [-].
    fault : str
        What to say if they do not settle.

    Raises
    ------
    SimulationError
        If they still change after that, and after `ROUNDS`.
    """
    before = sweep()
    for _ in range(max(rounds, ROUNDS)):
        now = sweep()
        if np.array_equal(before, now, equal_nan=True):
            return
        before = now
    raise SimulationError(fault)

"""Fixed-point iteration of values that depend on each other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.support.types import Vector

MIN_ROUND_LIMIT = 500
"""Smallest limit of the number of iterations, which lets a contraction converge to the last bit."""


def settle(sweep: Callable[[], Vector], rounds: int, fault: str) -> None:
    """Iterate until values that depend on each other no longer change.

    Parameters
    ----------
    sweep : callable
        Computes each value once from the present other values; returns all of them.
    rounds : int
        Number of iterations after which a chain of values without a cycle has converged [-], which is
        the number of values.
    fault : str
        Error message if the values do not converge.

    Raises
    ------
    SimulationError
        If the values still change after `rounds`, and after `MIN_ROUND_LIMIT`.
    """
    before = sweep()
    for _ in range(max(rounds, MIN_ROUND_LIMIT)):
        now = sweep()
        # NaN is a value that is not known yet, so it counts as unchanged.
        if np.array_equal(before, now, equal_nan=True):
            return
        before = now
    raise SimulationError(fault)

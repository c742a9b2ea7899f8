"""Clock counters: the remaining ticks of each clock, for a program that several clocks share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from trussflow.blocks.framework.clock import Clock, common_tick
from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.framework.types import Array, Vector

MAX_SEPARATE_CLOCKS = 5
"""Largest number of clocks for which each set that ticks together has its own program [-]."""


class Waits(Layout):
    """Layout of the clock counters in d; empty if each set of clocks has its own program.

    A clock ticks when its counter is zero. Counters are whole numbers that restart at each tick, so they
    stay exact in arbitrarily long runs.

    Parameters
    ----------
    clocks : sequence of Clock
        The clocks that share a program.
    start : int
        Index of the first counter in d [-].
    """

    def __init__(self, clocks: Sequence[Clock], start: int) -> None:
        super().__init__([("clocks", "waits", (len(clocks),))] if clocks else [], start)
        self._clocks = clocks
        tick = common_tick(t for c in clocks for t in (c.period, c.offset)) if clocks else 1
        self._periods = [float(clock.period / tick) for clock in clocks]
        offsets = np.array([float(clock.offset / tick) for clock in clocks])
        self.first = offsets - offsets.min() if clocks else offsets

    def by_clock(self, d: Array, make: Callable[[Array, tuple[int, ...]], Array]) -> dict[Clock, Array]:
        """Return the counter of each clock; `make` converts a slice of `d` [as declared] to an array."""
        left = make(d[self.span], (self.size,))
        return {clock: left[i] for i, clock in enumerate(self._clocks)}

    def waiting(self, d: Vector) -> set[Clock]:
        """Return the clocks that do not tick, by the counters in `d` [as declared]."""
        return {clock for clock, wait in self.by_clock(d, np.reshape).items() if wait > 0.0}

    def after(self, waits: Mapping[Clock, Array]) -> list[Array]:
        """Return the counters at the next instant from the `waits` at this one [ticks]."""
        if not self.size:
            return []
        pairs = zip(waits.values(), self._periods, strict=True)
        left = np.stack([np.where(wait == 0.0, period, wait) for wait, period in pairs])
        return [left - np.min(left)]

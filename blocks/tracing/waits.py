"""How many ticks are left for each clock: what tells a program that many clocks share which of them tick."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from trussflow.blocks.framework.clock import Clock, common_tick
from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.framework.types import Array, Vector

FEW_CLOCKS = 5
"""Clocks up to which each set of them that ticks together gets a program of its own; more share one [-]."""


class Waits(Layout):
    """The part of d where waits stand; empty where each set of clocks has a program of its own.

    A clock ticks where none is left. Counted from one instant to the next, whole numbers stay exact however
    long a run is.

    Parameters
    ----------
    clocks : sequence of Clock
        Those that share a program.
    start : int
        Where they begin in d [-].
    """

    def __init__(self, clocks: Sequence[Clock], start: int) -> None:
        super().__init__([("clocks", "waits", (len(clocks),))] if clocks else [], start)
        self._clocks = clocks
        tick = common_tick(t for c in clocks for t in (c.period, c.offset)) if clocks else 1
        self._periods = [float(clock.period / tick) for clock in clocks]
        offsets = np.array([float(clock.offset / tick) for clock in clocks])
        self.first = offsets - offsets.min() if clocks else offsets

    def by_clock(self, d: Array, make: Callable[[Array, tuple[int, ...]], Array]) -> dict[Clock, Array]:
        """Return the wait of each clock; `make` makes arrays of slices of `d` [as declared]."""
        left = make(d[self.span], (self.size,))
        return {clock: left[i] for i, clock in enumerate(self._clocks)}

    def waiting(self, d: Vector) -> set[Clock]:
        """Return the clocks that do not tick, by numbers in `d` [as declared]."""
        return {clock for clock, wait in self.by_clock(d, np.reshape).items() if wait > 0.0}

    def after(self, waits: Mapping[Clock, Array]) -> list[Array]:
        """Return the waits at the next instant, of those at one [ticks]."""
        if not self.size:
            return []
        pairs = zip(waits.values(), self._periods, strict=True)
        left = np.stack([np.where(wait == 0.0, period, wait) for wait, period in pairs])
        return [left - np.min(left)]

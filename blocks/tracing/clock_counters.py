"""Clock counters: the remaining ticks of each clock, for a program that several clocks share.

Each set of clocks that tick together usually has its own program. Many clocks share the program of the set of
all clocks instead: in it, a block computes if the counter of its clock is zero, and holds otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

import numpy as np

from trussflow.blocks.framework.clock import Clock, common_tick
from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.framework.system import System
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.sorted_order import Feedthrough, cycles, dependence_graph

MAX_SEPARATE_CLOCKS = 5
"""Largest number of clocks for which each set that ticks together has its own program [-]."""


def share_program(system: System, feedthrough: Feedthrough) -> bool:
    """Return whether the clocks of a `system` share one program, instead of one for each set of clocks.

    They do if there are more than `MAX_SEPARATE_CLOCKS`, unless a cycle of outputs by `feedthrough` contains
    clocks that never tick together. A shared program assumes that all may tick, so it would have no sorted
    order.
    """
    if len(system.clocks) <= MAX_SEPARATE_CLOCKS:
        return False
    held = {
        path: not b.traced and system.clock(b) is None
        for path, b in system.blocks.items()
    }
    for cycle in cycles(dependence_graph(system, feedthrough, held)):
        clocks = {
            clock for port in cycle if (clock := system.clock(port.block)) is not None
        }
        if any(
            (a.offset - b.offset) % common_tick((a.period, b.period))
            for a, b in combinations(clocks, 2)
        ):
            return False
    return True


class ClockCounters(Layout):
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
        super().__init__(
            [("clocks", "counters", (len(clocks),))] if clocks else [], start
        )
        self._clocks = clocks
        tick = (
            common_tick(t for c in clocks for t in (c.period, c.offset))
            if clocks
            else 1
        )
        self._periods = [float(clock.period / tick) for clock in clocks]
        offsets = np.array([float(clock.offset / tick) for clock in clocks])
        self.first = offsets - offsets.min() if clocks else offsets

    def by_clock(
        self, d: Array, make: Callable[[Array, tuple[int, ...]], Array]
    ) -> dict[Clock, Array]:
        """Return the counter of each clock; `make` converts a slice of `d` [as declared] to an array."""
        left = make(d[self.span], (self.size,))
        return {clock: left[i] for i, clock in enumerate(self._clocks)}

    def waiting(self, d: Vector) -> set[Clock]:
        """Return the clocks that do not tick, by the counters in `d` [as declared]."""
        return {
            clock
            for clock, counter in self.by_clock(d, np.reshape).items()
            if counter > 0.0
        }

    def after(self, counters: Mapping[Clock, Array]) -> list[Array]:
        """Return the counters at the next instant from the `counters` at this one [ticks]."""
        if not self.size:
            return []
        pairs = zip(counters.values(), self._periods, strict=True)
        left = np.stack(
            [np.where(counter == 0.0, period, counter) for counter, period in pairs]
        )
        return [left - np.min(left)]

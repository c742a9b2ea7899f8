"""Schedule of the blocks in integer ticks."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import gcd, lcm

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.clock import Clock, ticks

MAX_CLOCK_SETS = 1000
"""Sets of clocks that tick together; each needs code of its own."""

MAX_SCANNED_TICKS = 1_000_000
"""Ticks looked through for sets of clocks that tick together; 8 MB of integers."""


class Schedule:
    """The instants of all clocks on one grid of ticks.

    Exports keep the same calendar in C, where there is no Python: `tf_due` and `tf_next_due` in
    ``fmu/exporting/native``.

    Parameters
    ----------
    clocks : sequence of Clock
        Distinct clocks, at most 62.
    tick : Fraction
        Length of a tick [s].

    Attributes
    ----------
    sets : list of frozenset of Clock
        The sets of clocks that tick together, each with a program; the first is empty.

    Raises
    ------
    SimulationError
        If a sample time or offset is not a whole number of ticks, or there are too many sets.
    """

    def __init__(self, clocks: Sequence[Clock], tick: Fraction) -> None:
        self._clocks = [
            (
                ticks(c.period, tick, "the sample time"),
                ticks(c.offset, tick, "the sample offset"),
            )
            for c in clocks
        ]
        # Code 0, no clock, comes first: set number 0 means that nothing is sampled.
        codes = sorted({0} | (self._scanned() or self._possible()))
        if len(codes) > MAX_CLOCK_SETS:
            raise SimulationError(
                f"{len(self._clocks)} sample times coincide in more than {MAX_CLOCK_SETS} ways; "
                "take sample times that are multiples of each other"
            )
        self._sorted_codes = np.array(codes, dtype=np.int64)
        self.sets = [
            frozenset(c for i, c in enumerate(clocks) if code >> i & 1)
            for code in codes
        ]

    def _scanned(self) -> set[int]:
        """Return the sets that occur, as bits, by looking through the repeating pattern."""
        # Once all clocks have begun, their pattern repeats
        # with the least common multiple.
        pattern = lcm(*(p for p, _ in self._clocks)) + max(
            (o for _, o in self._clocks), default=0
        )
        if pattern > MAX_SCANNED_TICKS:
            return set()
        return {int(code) for code in np.unique(self._codes(0, pattern))}

    def _possible(self) -> set[int]:
        """Return the sets that may occur: those whose clocks coincide pair by pair."""
        found = {0}
        for i, (period, offset) in enumerate(self._clocks):
            # Two clocks coincide if their offsets are equal modulo the gcd of
            # their periods. Clocks that coincide pair by pair also coincide all at
            # once (Chinese remainder theorem).
            apart = sum(
                1 << j
                for j, (other, start) in enumerate(self._clocks[:i])
                if (offset - start) % gcd(period, other)
            )
            found |= {code | 1 << i for code in found if not code & apart}
            if len(found) > MAX_CLOCK_SETS:
                break  # too many already
        return found

    def _codes(self, first: int, number: int) -> NDArray[np.int64]:
        """Return, for a run of ticks, which clocks tick, as bits."""
        k = np.arange(first, first + number, dtype=np.int64)
        codes = np.zeros(number, dtype=np.int64)
        for i, (period, offset) in enumerate(self._clocks):
            codes |= ((k >= offset) & ((k - offset) % period == 0)).astype(
                np.int64
            ) << i
        return codes

    def due(self, first: int, number: int) -> NDArray[np.uint16]:
        """Return, for `number` ticks from the `first` one, the number of the set that ticks."""
        if not self._clocks:
            return np.zeros(number, dtype=np.uint16)
        codes = self._codes(first, number)
        # Exact matches: every code that occurs is among the sorted ones.
        return np.searchsorted(self._sorted_codes, codes).astype(np.uint16)

"""Lifting: a diagram with sampled blocks as one discrete linear model at the common period.

Between instants, the continuous states follow a linear differential equation, and sampled
signals are held. At an instant, the sampled blocks update their states. The composition over
the common period of all clocks is one linear map.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import lcm

import numpy as np

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.clock import ticks
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.support.types import Vector

MOST_INSTANTS = 100_000
"""Instants within a common period; each costs a product of matrices."""

Jump = tuple[Vector, Vector]
"""Update at an instant: z after = first @ z before + second @ w, z = (x, memory, held)."""


@dataclass(frozen=True, slots=True)
class Pattern:
    """The instants within one common period.

    Attributes
    ----------
    period : Fraction
        The common period [s].
    instants : list of (Fraction, int)
        Time after the start of the period [s], and number of the set of clocks that tick.
    """

    period: Fraction
    instants: list[tuple[Fraction, int]]

    def gaps(self) -> list[Fraction]:
        """Return the time from each instant to the next, the last to the end of the period [s]."""
        times = [t for t, _ in self.instants] + [self.period]
        return [b - a for a, b in pairwise(times)]


def pattern(assembly: Prepared) -> Pattern | None:
    """Return when the clocks tick within a common period; None without any.

    Raises
    ------
    LinearAnalysisError
        If there are too many instants in a period.
    """
    clocks = assembly.plan.system.clocks
    tick = assembly.tick
    if not clocks:
        return None
    # Periods as whole ticks, so that the common period is exact.
    length = lcm(*(ticks(c.period, tick, "the sample time") for c in clocks))
    if length > MOST_INSTANTS:
        raise LinearAnalysisError(
            f"the sample times {', '.join(f'{float(c.period):.12g} s' for c in clocks)} repeat "
            f"only after {float(length * tick):g} s, {length} ticks; take sample times that are "
            "multiples of each other"
        )
    # Offsets are below periods: all clocks have started within one common period.
    due = assembly.schedule.due(0, length)
    found = [(int(k) * tick, int(due[k])) for k in np.flatnonzero(due)]
    # The outputs are those after the instant at the start of the period. If no clock
    # ticks there, set 0 stands for an instant that changes nothing.
    if due[0] == 0:
        found.insert(0, (Fraction(0), 0))
    return Pattern(length * tick, found)


def held_flow(A: Vector, B: Vector, time: float) -> tuple[Vector, Vector]:
    """Return the exact map of a linear system over a time with held input.

    Parameters
    ----------
    A, B : Vector
        System and input matrix [1/s, any].
    time : float
        Duration [s].
    """
    from scipy.linalg import expm

    size = len(A)
    # exp([[A, B], [0, 0]] t) = [[exp(A t), integral of exp(A s) B], [0, 1]]: this needs
    # no inverse of A, which is singular for integrators.
    block = np.zeros((size + B.shape[1],) * 2)
    block[:size, :size], block[:size, size:] = A, B
    flow = expm(block * time)[:size]
    return flow[:, :size], flow[:, size:]


def lifted(
    instants: Pattern,
    rates: tuple[Vector, Vector],
    jump: Callable[[int], Jump],
    outputs: tuple[Vector, Vector],
) -> tuple[Vector, Vector, Vector, Vector]:
    r"""Return A, B, C, D of the map over one period.

    With z = (x, s), the sampled data s, and an input w held over the period,

    .. math::
        z^+ = J_k z + K_k w, \qquad
        z(t_{k+1}) = e^{F (t_{k+1} - t_k)} z^+ + \int e^{F s} ds\, E\, w

    applied instant by instant. Outputs are those right after the first instant.

    Parameters
    ----------
    instants : Pattern
        Schedule of the clocks.
    rates : tuple of Vector
        F (n_z, n_z), with zero rows for s, and E (n_z, n_w) [as declared].
    jump : callable
        Returns J_k and K_k for a set of clocks; for set 0, nothing happens.
    outputs : tuple of Vector
        Derivatives of the outputs by z and w [as declared].
    """
    F, E = rates
    # One matrix exponential per length of gap. Fractions are equal exactly.
    flows: dict[Fraction, tuple[Vector, Vector]] = {}
    A = np.eye(len(F))
    B = np.zeros(E.shape)
    first: Jump | None = None
    for (_, number), gap in zip(instants.instants, instants.gaps(), strict=True):
        if number:
            J, K = jump(number)
            A, B = J @ A, J @ B + K
        # The map from the start of the period to just after the first instant.
        if first is None:
            first = A, B
        if gap not in flows:
            flows[gap] = held_flow(F, E, float(gap))
        turned, driven = flows[gap]
        A, B = turned @ A, turned @ B + driven
    assert first is not None
    C, D = outputs
    return A, B, C @ first[0], C @ first[1] + D

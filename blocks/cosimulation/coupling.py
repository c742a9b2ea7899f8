"""Coupling schemes: one communication step of all members.

All members are at t, and step to t + H. The scheme determines the inputs of a member during the step:

* Jacobi: every member reads the outputs of the others at t. All are advanced independently.
* Gauss-Seidel: members are advanced one after another. Each reads the outputs of earlier members at
  t + H, and those of later members at t.
* Iteration: every member reads the outputs of the others at t + H. All steps are repeated from
  snapshots until the signals converge to the implicit solution.

Inputs are held during the step, so the error is proportional to H.

Signals of sampled blocks are held in every scheme: they keep their values at t until the block ticks
again.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from fractions import Fraction
from typing import Any

import numpy as np

from trussflow.blocks.cosimulation.fixed_point import NotConvergedError, fixed_point
from trussflow.blocks.cosimulation.network import Network
from trussflow.blocks.errors import (
    AlgebraicLoopError,
    DivergenceError,
    Explained,
    SimulationError,
)
from trussflow.blocks.framework.fixed_point import settle
from trussflow.blocks.framework.run_state import SelfStepping
from trussflow.blocks.simulation.block_instances import check_outputs
from trussflow.blocks.support.types import Vector

COUPLINGS = ("jacobi", "gauss-seidel", "iterate")

ITERATION_TOLERANCE = 1e-10
"""Relative change of signals at which an iteration ends [-]."""

MAX_ITERATIONS = 50
"""Largest number of iterations in one step [-]."""

MAX_START_ITERATIONS = 100
"""Largest number of iterations of the initial states and signals."""


def loop_text(network: Network) -> str:
    """Return the beginning of a message with the algebraic loop through members."""
    return (
        "algebraic loop through co-simulation members: within one instant each signal depends on "
        f"itself\n  {network.loop}\n"
    )


class Coupled:
    """All members of a co-simulation in one run, and their common time.

    Parameters
    ----------
    network : Network
        The members and the layout of their signals.
    coupling : str
        One of `COUPLINGS`.
    grid : Fraction
        Communication steps are multiples of this time [s].

    Attributes
    ----------
    k : int
        Present time, in multiples of the grid.
    iterations : int
        Number of evaluations of all members in iterations so far [-].
    """

    def __init__(self, network: Network, coupling: str, grid: Fraction) -> None:
        self.network = network
        self.coupling = coupling
        self.grid = grid
        self.signals = network.start.copy()
        self.k = 0
        self.iterations = 0
        self._visits: list[int] = []
        self._current = 0  # index of the active member, for error messages
        self._stepping: list[SelfStepping] = []

    def _check(self) -> None:
        """Check that all members can be restored if the scheme or a loop needs it."""
        stuck = ", ".join(self.unable("restores"))
        if self.network.loop and stuck:
            raise AlgebraicLoopError(
                f"{loop_text(self.network)}cannot iterate over it, because these members cannot return to "
                f"an earlier state: {stuck}"
            )
        if self.coupling == "iterate" and stuck:
            raise SimulationError(
                'cannot couple with "iterate": these members cannot return to an earlier state: '
                f'{stuck}; use coupling="gauss-seidel" or "jacobi"'
            )

    def unable(self, ability: str) -> list[str]:
        """Return the names of the members without an `ability`: ``"restores"`` or ``"varies"``."""
        return [
            f"'{member.name}'"
            for member, one in zip(self.network.members, self._stepping, strict=True)
            if not getattr(one, ability)
        ]

    @property
    def time(self) -> float:
        """Present time [s]."""
        return self.time_of(self.k)

    def time_of(self, k: int) -> float:
        """Return the time [s] of a point of the grid."""
        # Multiplied first, as in `Run`: tick 3 of 1/10 s is 0.3, while 3 * 0.1 is not.
        return k * self.grid.numerator / self.grid.denominator

    # -- start and end ------------------------------------------------------------------------

    def start(self) -> None:
        """Open the members, and compute consistent initial states and signals at time 0.

        Raises
        ------
        AlgebraicLoopError
            If there is a loop, and members in it cannot be restored.
        SimulationError
            If the signals do not converge, or the scheme iterates and members cannot be restored.
        """
        with Explained(self._raised):
            self._start()

    def _raised(self, error: Exception) -> SimulationError:
        """Return an error that names the active member, which raised `error`."""
        return SimulationError(
            f"member '{self.network.members[self._current].name}' raised {type(error).__name__} at "
            f"t = {self.time:g} s: {error}"
        )

    def _start(self) -> None:
        network = self.network
        for self._current, member in enumerate(network.members):
            self._stepping.append(member.open())
        numbers = range(len(self._stepping))
        for i in numbers:
            self._begin(i)
        # Only now: some abilities of a member are known only after its start.
        self._check()
        self._visits = network.visits([one.refreshes for one in self._stepping])
        if network.loop:

            def implied(inputs: Vector) -> Vector:
                for i, own in enumerate(network.ins):
                    self._begin(i, inputs[own])
                return np.asarray(self.signals[network.gather])

            self._iterate(implied, self.signals[network.gather], MAX_START_ITERATIONS)
            return
        # At the start, all outputs follow the inputs, also those of members
        # that do not refresh.
        visits = network.visits([True for _ in numbers])

        def sweep() -> Vector:
            # First in the order of the direct feedthrough; then all, as initial states
            # may depend on inputs without feedthrough.
            for i in [*visits, *numbers]:
                self._begin(i)
            return self.signals.copy()

        fault = "the signals at the start do not settle: initial states of members depend on each other"
        settle(sweep, len(visits) + len(numbers), f"{fault} in a circle")
        self._check_finite()

    def _begin(self, i: int, inputs: Vector | None = None) -> None:
        network = self.network
        one = self._stepping[i]
        self._current = i
        if inputs is None:
            inputs = self.signals[network.gather[network.ins[i]]]
        # Outputs that depend on unknown inputs may have any value.
        one.start(0.0, np.where(np.isfinite(inputs), inputs, np.nan))
        outputs = one.outputs()
        check_outputs(
            outputs, self.signals[network.outs[i]].size, network.members[i].name
        )
        self.signals[network.outs[i]] = outputs

    @property
    def messages(self) -> dict[str, list[str]]:
        """Messages of the members in this run, by name."""
        pairs = zip(self.network.members, self._stepping, strict=False)
        return {
            member.name: list(one.messages) for member, one in pairs if one.messages
        }

    def close(self) -> None:
        """Close all members; an error of one of them is raised after all are closed."""
        with ExitStack() as stack:
            for one in self._stepping:
                # A callback that raises does not keep the others from being called.
                stack.callback(one.close)

    # -- steps --------------------------------------------------------------------------------

    def step(self, number: int) -> None:
        """Take one communication step.

        Parameters
        ----------
        number : int
            Length of the step, in multiples of the grid [-].

        Raises
        ------
        StepDiscardedError
            If a member rejects the step.
        DivergenceError
            If a signal is not finite.
        SimulationError
            If an iteration does not converge.
        """
        now = self.time
        until = self.time_of(self.k + number)
        inputs = self.signals[self.network.gather]
        with Explained(self._raised):
            if self.coupling == "iterate":
                self._iterated(inputs, now, until)
            else:
                self._one_by_one(inputs, now, until)
        # `k` changes only after all members have reached t + H: errors name the time t.
        self.k += number
        self._check_finite()

    def _one_by_one(self, inputs: Vector, now: float, until: float) -> None:
        network = self.network
        sequential = self.coupling == "gauss-seidel"
        # One more element than members, for inputs without source.
        known = np.zeros(len(self._stepping) + 1, dtype=bool)
        for i, own in enumerate(network.ins):
            values = inputs[own]
            if sequential:
                # Elements from members that are at t + H already. Inputs without source
                # have the index -1, which is the last element of `known`, always false.
                use = known[network.source[own]] & ~network.held[own]
                known[i] = True
                if use.any():
                    # Sampled blocks that tick at t must read the signals of t,
                    # not those of t + H.
                    self._stepping[i].latch(values)
                    values = np.where(use, self.signals[network.gather[own]], values)
            self._advance(i, values, now, until)
        self._read_again()

    def _read_again(self) -> None:
        """Update outputs with direct feedthrough, so that all signals are consistent."""
        network = self.network
        for i in self._visits:
            self._current = i
            self._stepping[i].set(self.signals[network.gather[network.ins[i]]])
            self.signals[network.outs[i]] = self._stepping[i].outputs()

    def _advance(self, i: int, values: Vector, now: float, until: float) -> None:
        """Advance one member with held inputs, and read its outputs."""
        self._current = i
        one = self._stepping[i]
        one.set(values)
        one.advance(now, until)
        self.signals[self.network.outs[i]] = one.outputs()

    def _iterated(self, inputs: Vector, now: float, until: float) -> None:
        network = self.network
        held = self.network.held
        # A mark is for this object only, and may be faster than a snapshot.
        saved = [one.mark() for one in self._stepping]
        used = False

        def implied(ends: Vector) -> Vector:
            nonlocal used
            # The first evaluation starts from the present states: nothing to restore.
            if used:
                for one, snapshot in zip(self._stepping, saved, strict=True):
                    one.restore(snapshot)
            used = True
            for i, own in enumerate(network.ins):
                # As in Gauss-Seidel: sampled blocks that tick at t read
                # the signals of t.
                self._stepping[i].latch(inputs[own])
                self._advance(i, ends[own], now, until)
            return np.where(held, inputs, self.signals[network.gather])

        self._iterate(implied, inputs, MAX_ITERATIONS)
        # The iteration kept the held inputs at their values of t, so outputs that
        # depend on them directly are read again with those of t + H.
        if held.any():
            self._read_again()

    def _iterate(
        self, implied: Callable[[Vector], Vector], guess: Vector, limit: int
    ) -> None:
        """Repeat a step, or the start, until all inputs are equal to the outputs that drive them."""
        try:
            _, number = fixed_point(implied, guess, ITERATION_TOLERANCE, limit)
        except NotConvergedError as error:
            # A signal that is not finite explains a failed iteration better.
            self._check_finite()
            worst = int(np.argmax(error.residual))
            raise SimulationError(
                f"the iteration of the members did not converge at t = {self.time:g} s within {limit} "
                f"iterations: {self.network.describe(int(self.network.gather[worst]))} still changes by "
                f"{error.residual[worst]:.1g} of its size; use a smaller step"
            ) from None
        self.iterations += number

    def _check_finite(self) -> None:
        if not np.isfinite(self.signals).all():
            place = int(np.flatnonzero(~np.isfinite(self.signals))[0])
            raise DivergenceError(
                f"{self.network.describe(place)} stopped being finite at t = {self.time:g} s; the "
                "log up to there is kept"
            )

    # -- snapshots ----------------------------------------------------------------------------

    def save(self) -> tuple[Any, ...]:
        """Return a snapshot of all members and signals."""
        states = [one.mark() for one in self._stepping]
        return self.k, self.signals.copy(), states

    def restore(self, saved: tuple[Any, ...]) -> None:
        """Restore a snapshot, with bitwise equal states."""
        self.k, signals, states = saved
        self.signals[:] = signals
        for one, snapshot in zip(self._stepping, states, strict=True):
            one.restore(snapshot)

"""Coupling: one communication step of all units, by each of the schemes.

Let the units stand at t, and step to t + H. What a unit reads between is, from units not yet
advanced, what is known at t, and the scheme decides about the others:

* Jacobi: every unit reads what the others showed at t. All are advanced independently.
* Gauss-Seidel: units are advanced one after the other; each reads from those before it what they
  show at t + H already, and from those after it what they showed at t.
* Iteration: every unit reads what the others show at t + H. All steps are repeated from
  snapshots until nothing changes any more: the implicit solution.

With ``extrapolation=0`` inputs are held during the step. With ``extrapolation=1`` they are
straight lines: extrapolated through the last two communication points where the end is not known,
interpolated between t and t + H where it is. Then the error falls with H squared, not with H.

Signals of sampled blocks are held in every scheme: they are what they were at t until the block
ticks again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from trussflow.blocks.cosimulation.fixed_point import NotConvergedError, fixed_point
from trussflow.blocks.cosimulation.network import Network
from trussflow.blocks.framework.errors import AlgebraicLoopError, DivergenceError, SimulationError
from trussflow.blocks.framework.types import Vector

COUPLINGS = ("jacobi", "gauss-seidel", "iterate")

START_ROUNDS = 100
"""Most rounds in which initial states and the signals at the start must settle."""


@dataclass(frozen=True, slots=True)
class Scheme:
    """How units are coupled.

    Attributes
    ----------
    coupling : str
        One of `COUPLINGS`.
    extrapolation : int
        0: inputs are held; 1: they are straight lines [-].
    order : sequence of int
        Numbers of the units in the order in which they are advanced.
    tolerance : float
        Relative residual at which an iteration ends [-].
    limit : int
        Most iterations in one step [-].
    """

    coupling: str
    extrapolation: int
    order: Sequence[int]
    tolerance: float
    limit: int

    @property
    def convergence(self) -> int:
        """The power of H with which the error falls."""
        return 1 + self.extrapolation


class Coupled:
    """All units of a co-simulation, and the time that they have reached together.

    Parameters
    ----------
    network : Network
        The units and the places of their signals.
    scheme : Scheme
        How they are coupled.
    grid : Fraction
        Communication steps are multiples of this time [s].

    Attributes
    ----------
    k : int
        The present time, in multiples of the grid.
    iterations : int
        Evaluations of all units that iterations took so far [-].

    Raises
    ------
    AlgebraicLoopError
        If there is a loop, and the scheme does not iterate, or units in it cannot be restored.
    SimulationError
        If the scheme iterates, and units cannot be restored.
    """

    def __init__(self, network: Network, scheme: Scheme, grid: Fraction) -> None:
        self.network, self.scheme, self.grid = network, scheme, grid
        self.signals = network.signals
        self.k = 0
        self.iterations = 0
        self._rates = np.zeros(network.gather.size)
        self._visits: list[int] = []
        self._slaves = [unit.slave for unit in network.units]
        self._follows = [any(unit.needs) for unit in network.units]
        self._check()

    def _check(self) -> None:
        network, iterates = self.network, self.scheme.coupling == "iterate"
        stuck = self.unrestorable()
        loop = (
            "algebraic loop through co-simulation units: within one instant each signal depends on "
            f"itself\n  {network.loop}\n"
        )
        if network.loop and not iterates:
            raise AlgebraicLoopError(
                f'{loop}solve it in every step with coupling="iterate", make one unit of the '
                "blocks in it, or break it with a state or a UnitDelay"
            )
        if network.loop and stuck:
            raise AlgebraicLoopError(
                f"{loop}cannot iterate over it, because these units cannot go back to an earlier "
                f"state: {', '.join(stuck)}"
            )
        if iterates and stuck:
            raise SimulationError(
                'cannot couple with "iterate": these units cannot go back to an earlier state: '
                f'{", ".join(stuck)}; take coupling="gauss-seidel" or "jacobi"'
            )

    def unrestorable(self) -> list[str]:
        """Return the names of the units that cannot be restored."""
        return [f"'{u.name}'" for u in self.network.units if not u.slave.restores]

    @property
    def time(self) -> float:
        """The present time [s]."""
        return self.time_of(self.k)

    def time_of(self, k: int) -> float:
        """Return the time [s] of a point of the grid."""
        return k * self.grid.numerator / self.grid.denominator

    # -- start and end ------------------------------------------------------------------------

    def start(self) -> None:
        """Begin at time 0: initial states and signals are made to fit each other.

        Raises
        ------
        SimulationError
            If they do not settle.
        """
        self.k, self.iterations = 0, 0
        self._rates[:] = 0.0
        network = self.network
        self.signals[: network.outputs] = 0.0
        for i in range(len(self._slaves)):
            self._begin(i)
        self._visits = network.visits()
        if network.loop:
            self._solve_start()
            return
        visits = network.visits(at_start=True)
        rounds = len(visits) + len(self._slaves) + 1
        for _ in range(min(rounds, START_ROUNDS)):
            before = self.signals.copy()
            for i in [*visits, *range(len(self._slaves))]:
                self._begin(i)
            if np.array_equal(before, self.signals, equal_nan=True):
                break
        else:
            raise SimulationError(
                "the signals at the start do not settle: initial states of units depend on each "
                "other in a circle"
            )
        self._check_finite()

    def _solve_start(self) -> None:
        """Solve the loops at time 0."""

        def implied(inputs: Vector) -> Vector:
            for i in range(len(self._slaves)):
                self._begin(i, inputs[self.network.ins[i]])
            found: Vector = self.signals[self.network.gather]
            return found

        try:
            _, self.iterations = fixed_point(
                implied, self.signals[self.network.gather], self.scheme.tolerance, START_ROUNDS
            )
        except NotConvergedError as error:
            raise self._not_converged(error, START_ROUNDS) from None

    def _begin(self, i: int, inputs: Vector | None = None) -> None:
        network, slave = self.network, self._slaves[i]
        if inputs is None:
            inputs = self.signals[network.gather[network.ins[i]]]
        # What others make of inputs that are not known yet may be anything.
        slave.start(np.where(np.isfinite(inputs), inputs, 0.0))
        self.signals[network.outs[i]] = slave.outputs()

    def stop(self) -> None:
        """End all units; the first error is raised after all were ended."""
        faults = []
        for slave in self._slaves:
            try:
                slave.stop()
            except Exception as error:  # noqa: BLE001 - the others must be stopped all the same
                faults.append(error)
        if faults:
            raise faults[0]

    # -- steps --------------------------------------------------------------------------------

    def step(self, number: int) -> None:
        """Take one communication step.

        Parameters
        ----------
        number : int
            Its length, in multiples of the grid [-].

        Raises
        ------
        StepDiscardedError
            If a unit refuses it.
        DivergenceError
            If a signal stops being finite.
        SimulationError
            If an iteration does not converge.
        """
        now, until = self.time, self.time_of(self.k + number)
        inputs = self.signals[self.network.gather]
        if self.scheme.coupling == "iterate":
            self._iterated(inputs, now, until)
        else:
            self._one_by_one(inputs, now, until)
        self.k += number
        self._check_finite()
        if self.scheme.extrapolation:
            self._rates = (self.signals[self.network.gather] - inputs) / (until - now)
            self._rates[self.network.held] = 0.0

    def _one_by_one(self, inputs: Vector, now: float, until: float) -> None:
        network, lines = self.network, bool(self.scheme.extrapolation)
        sequential = self.scheme.coupling == "gauss-seidel"
        known = np.zeros(len(self._slaves) + 1, dtype=bool)  # the last stands for no source
        for i in self.scheme.order:
            own = network.ins[i]
            values, rates = inputs[own], self._rates[own] if lines else None
            if sequential:
                new = self.signals[network.gather[own]]
                use = known[network.source[own]] & ~network.held[own]
                if rates is None:
                    values = np.where(use, new, values)
                else:
                    rates = np.where(use, (new - values) / (until - now), rates)
                known[i] = True
                if use.any() and rates is None:
                    self._slaves[i].latch(inputs[own])
            self._advance(i, values, rates, now, until)
        for i in self._visits:
            self._slaves[i].set(self.signals[network.gather[network.ins[i]]])
            self.signals[network.outs[i]] = self._slaves[i].outputs()

    def _advance(self, i: int, values: Vector, rates: Vector | None, now: float, until: float) -> None:
        """Advance one unit, and read it.

        One that knows no lines is given their mean, which is as good for its states; if outputs
        depend on inputs directly, it is given their end, before or after the step.
        """
        slave, step, end = self._slaves[i], until - now, None
        if rates is None or slave.ramps:
            slave.set(values, rates)
        elif slave.refreshes or not self._follows[i]:
            slave.set(values + rates * (step / 2))
            end = values + rates * step if self._follows[i] else None
        else:
            slave.set(values + rates * step)
        slave.advance(now, until)
        if end is not None:
            slave.set(end)
        self.signals[self.network.outs[i]] = slave.outputs()

    def _iterated(self, inputs: Vector, now: float, until: float) -> None:
        network, lines, held = self.network, bool(self.scheme.extrapolation), self.network.held
        saved = [slave.save() for slave in self._slaves]
        used = False

        def implied(ends: Vector) -> Vector:
            nonlocal used
            if used:
                for slave, snapshot in zip(self._slaves, saved, strict=True):
                    slave.restore(snapshot)
            used = True
            rates = (ends - inputs) / (until - now) if lines else None
            for i, own in enumerate(network.ins):
                if rates is None:
                    self._slaves[i].latch(inputs[own])
                    self._advance(i, ends[own], None, now, until)
                else:
                    self._advance(i, inputs[own], rates[own], now, until)
            return np.where(held, inputs, self.signals[network.gather])

        guess = inputs + self._rates * (until - now) if lines else inputs
        try:
            _, number = fixed_point(implied, guess, self.scheme.tolerance, self.scheme.limit)
        except NotConvergedError as error:
            raise self._not_converged(error, self.scheme.limit) from None
        self.iterations += number
        for i in self._visits if held.any() else []:
            self._slaves[i].set(self.signals[network.gather[network.ins[i]]])
            self.signals[network.outs[i]] = self._slaves[i].outputs()

    def _not_converged(self, error: NotConvergedError, limit: int) -> SimulationError:
        self._check_finite()
        worst = int(np.argmax(error.residual))
        return SimulationError(
            f"the iteration of the units did not converge at t = {self.time:g} s within {limit} "
            f"rounds: {self.network.describe(int(self.network.gather[worst]))} still changes by "
            f"{error.residual[worst]:.1g} of its size. Try a smaller step, or more iterations"
        )

    def _check_finite(self) -> None:
        if not np.isfinite(self.signals).all():
            place = int(np.flatnonzero(~np.isfinite(self.signals))[0])
            raise DivergenceError(
                f"{self.network.describe(place)} stopped being finite at t = {self.time:g} s; the "
                "log up to there is kept"
            )

    def forget(self) -> None:
        """Take inputs to be constant up to now: what went before does not tell how they go on."""
        self._rates[:] = 0.0

    # -- going back ---------------------------------------------------------------------------

    def save(self) -> tuple[Any, ...]:
        """Return a snapshot of all units and signals."""
        slaves = [slave.save() for slave in self._slaves]
        return self.k, self.signals.copy(), self._rates.copy(), slaves

    def restore(self, saved: tuple[Any, ...]) -> None:
        """Go back to a snapshot, to the last bit."""
        self.k, signals, rates, slaves = saved
        self.signals[:], self._rates = signals, rates.copy()
        for slave, snapshot in zip(self._slaves, slaves, strict=True):
            slave.restore(snapshot)

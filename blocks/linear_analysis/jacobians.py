"""Exact Jacobians of a plan's quantities, from the graph."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.linear_analysis.python_continuous_slopes import LiveSlopes
from trussflow.blocks.simulation.executor import Executor, InterpretedExecutor
from trussflow.blocks.simulation.python_continuous import LiveBlocks, LiveExecutor
from trussflow.blocks.simulation.python_sampled import PythonUnits
from trussflow.blocks.simulation.schedule import Schedule
from trussflow.blocks.tracing.evaluation import Active, Evaluation
from trussflow.blocks.tracing.plan import Plan, Quantity, derivative, outputs, sample
from trussflow.blocks.tracing.program import Program

MODEL = "model"
"""The quantity made of dx/dt and then the values of ports."""


class Jacobians:
    """Values and exact Jacobians of what a plan computes.

    Parameters
    ----------
    plan : Plan
        The plan.
    ports : sequence of Port
        The ports that come after dx/dt in the quantity "model".
    schedule : Schedule or None
        When sampled blocks tick; None without any.

    Attributes
    ----------
    units : PythonUnits
        The sampled Python blocks, in the order in which they compute.
    live : LiveSlopes or None
        The continuous Python blocks; None without any.
    """

    def __init__(self, plan: Plan, ports: Sequence[Port], schedule: Schedule | None) -> None:
        self.plan = plan
        sets: list[Active] = [frozenset()] if schedule is None else schedule.sets
        self.units = PythonUnits(plan, sets)
        quantities = [_model(ports)]
        quantities += [sample(i, active) for i, active in enumerate(sets) if active]
        quantities += self.units.quantities()
        self._live = LiveBlocks(plan)
        self.live = LiveSlopes(self, self._live) if self._live else None
        quantities += self._live.quantities()
        self._programs = {p.name: p for p in plan.trace(quantities)}
        self._tangents: dict[str, Tangents] = {}

    @cached_property
    def executor(self) -> Executor:
        """Evaluates the quantities; outputs of continuous Python blocks change in d."""
        inner = InterpretedExecutor(list(self._programs.values()))
        return LiveExecutor(inner, self._live) if self._live else inner

    def values(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name."""
        values = self.executor.call(name, t, x, d, p)
        if name == MODEL and self._live:
            self._live.rates(self.executor, t, x, d, p, values)
        return values

    def matrix(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the derivatives of a quantity by (x, d), of shape (size, size of x and d).

        Parameters
        ----------
        name : str
            Which quantity.
        t, x, d, p : float, Vector
            The point [units as declared].
        """
        if name not in self._tangents:
            self._tangents[name] = Tangents(self._programs[name])
        tangents = self._tangents[name]
        found = tangents(t, x, d, p, np.eye(x.size + d.size))
        bad = ~np.isfinite(found)
        if bad.any():
            # A sweep multiplies an infinite slope by zero, along every direction that is not its
            # own. Written out, a Jacobian is slow to set up, but leaves such products away.
            found[bad] = tangents.written_out(t, x, d, p)[bad]
        return found


class Tangents:
    """Directional derivatives of a program of (t, x, d, p), by forward differentiation.

    One sweep for each direction is both quicker to set up and smaller than a Jacobian that is
    written out.

    Parameters
    ----------
    program : Program
        The program.
    """

    def __init__(self, program: Program) -> None:
        self._function = program.function.expand()  # several times faster than kernel calls
        self._forward = self._function.forward(1)
        self._written_out: ca.Function | None = None

    def __call__(self, t: float, x: Vector, d: Vector, p: Vector, directions: Vector) -> Vector:
        """Return the derivatives along directions in (x, d), one for each column.

        Parameters
        ----------
        t, x, d, p : float, Vector
            The point [units as declared].
        directions : Vector, shape (size of x and d, number)
            The directions [any].
        """
        number = directions.shape[1]
        if not number:
            return np.zeros((self._function.numel_out(0), 0))
        still_t, still_p = np.zeros((1, number)), np.zeros((p.size, number))
        moved = still_t, directions[: x.size], directions[x.size :], still_p
        value = self._function(t, x, d, p)
        return np.asarray(self._forward.map(number)(t, x, d, p, value, *moved).full())

    def written_out(self, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the derivatives by all of (x, d), each from an expression of its own.

        Parameters
        ----------
        t, x, d, p : float, Vector
            The point [units as declared].
        """
        if self._written_out is None:
            sizes = 1, x.size, d.size, p.size
            leaves = [ca.SX.sym(n, size) for n, size in zip("txdp", sizes, strict=True)]
            jacobian = ca.jacobian(self._function(*leaves), ca.vertcat(leaves[1], leaves[2]))
            self._written_out = ca.Function("jacobian", leaves, [jacobian])
        return np.asarray(self._written_out(t, x, d, p).full())


def _model(ports: Sequence[Port]) -> Quantity:
    """Return the quantity made of dx/dt and then the values of ports."""

    def collect(plan: Plan, evaluation: Evaluation) -> list[Array]:
        rates = derivative().collect(plan, evaluation)
        return rates + outputs(ports).collect(plan, evaluation)

    return Quantity(MODEL, frozenset(), collect)

"""Exact Jacobians of a plan's quantities, from the graph."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from trussflow.blocks.framework.evaluation import Active
from trussflow.blocks.framework.executor import InterpretedExecutor
from trussflow.blocks.framework.plan import Plan, Quantity, derivative, outputs, sample
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.program import Program
from trussflow.blocks.framework.python_units import PythonUnits
from trussflow.blocks.framework.schedule import Schedule
from trussflow.blocks.framework.types import Vector


class Jacobians:
    """Values and exact Jacobians of what a plan computes.

    Parameters
    ----------
    plan : Plan
        The plan.
    taps, closings : sequence of Port
        The ports that make up the quantities "outputs" and "closings".
    schedule : Schedule or None
        When sampled blocks tick; None without any.

    Attributes
    ----------
    units : PythonUnits
        The Python blocks, in the order in which they compute.
    executor : InterpretedExecutor
        Evaluates the quantities.
    """

    def __init__(
        self,
        plan: Plan,
        taps: Sequence[Port],
        closings: Sequence[Port],
        schedule: Schedule | None,
    ) -> None:
        self.plan = plan
        sets: list[Active] = [frozenset()] if schedule is None else schedule.sets
        self.units = PythonUnits(plan, sets)
        quantities = [derivative(), outputs(taps), outputs(closings, "closings")]
        quantities += [sample(i, active) for i, active in enumerate(sets) if active]
        quantities += self.units.quantities()
        self._programs = {p.name: p for p in plan.trace(quantities)}
        self._functions: dict[str, ca.Function] = {}

    @cached_property
    def executor(self) -> InterpretedExecutor:
        """Evaluates the quantities."""
        return InterpretedExecutor(list(self._programs.values()))

    def values(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name."""
        return self.executor.call(name, t, x, d, p)

    def matrix(
        self, quantity: str | Quantity, t: float, x: Vector, d: Vector, p: Vector
    ) -> tuple[Vector, Vector]:
        """Return the derivatives of a quantity by x and by d.

        Parameters
        ----------
        quantity : str or Quantity
            Which.
        t, x, d, p : float, Vector
            The point [units as declared].

        Returns
        -------
        Vector, Vector
            Of shape (size, size of x) and (size, size of d).
        """
        name = quantity if isinstance(quantity, str) else quantity.name
        if name not in self._functions:
            self._functions[name] = jacobian_function(self._programs[name])
        matrix = np.asarray(self._functions[name](t, x, d, p).full())
        return matrix[:, : x.size], matrix[:, x.size :]


def jacobian_function(program: Program) -> ca.Function:
    """Return the Jacobian of a program of (t, x, d, p) by x and d, side by side."""
    written_out = program.function.expand()  # several times faster to evaluate than kernel calls
    arguments = [ca.SX.sym(n, s.numel()) for n, s in zip("txdp", program.inputs, strict=True)]
    by = ca.vertcat(arguments[1], arguments[2])
    return ca.Function("jacobian", arguments, [ca.jacobian(written_out(*arguments), by)])

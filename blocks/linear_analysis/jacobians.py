"""Exact Jacobians of a plan's quantities, from the graph."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial

import numpy as np

from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.linear_analysis.python_equation import Equation
from trussflow.blocks.simulation.block_instances import BlockCall
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.python_blocks import PythonExecutor
from trussflow.blocks.simulation.solver import Solver
from trussflow.blocks.tracing.evaluation import Evaluation
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.quantities import Quantity, derivative, outputs

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

    Attributes
    ----------
    assembly : Prepared
        The plan with its clocks and Python blocks.
    """

    def __init__(self, plan: Plan, ports: Sequence[Port]) -> None:
        self.assembly = Prepared(plan, [_model(ports)], Solver(solver="RK45", backend="interpreted"))
        self._programs = {p.name: p for p in self.assembly.programs}
        self._tangents: dict[str, Tangents] = {}

    def program(self, name: str) -> Program:
        """Return the traced quantity of that name."""
        return self._programs[name]

    def tangents(self, name: str) -> Tangents:
        """Return the directional derivatives of the quantity of that name."""
        if name not in self._tangents:
            self._tangents[name] = Tangents(self.program(name))
        return self._tangents[name]


class LocalJacobians:
    """Values and derivatives of what a plan computes at one time, in a run of its own.

    Use it in a ``with`` statement: Python blocks are open inside.

    Parameters
    ----------
    jacobians : Jacobians
        The plan and its derivatives.
    t : float
        Time [s].
    p : Vector
        Parameters [units as declared].

    Attributes
    ----------
    derivatives : dict of str to str
        Method of differentiation of each Python block, keyed by path.
    """

    def __init__(self, jacobians: Jacobians, t: float, p: Vector) -> None:
        self.assembly = jacobians.assembly
        self.plan = self.assembly.plan
        self._jacobians, self.t, self.p = jacobians, t, p
        self.derivatives: dict[str, str] = {}
        self._errors: dict[str, float] = {}
        self.executor = self.assembly.open(p)

    def __enter__(self) -> LocalJacobians:
        return self

    def __exit__(self, *error: object) -> None:
        self.executor.close()

    def values(self, name: str, x: Vector, d: Vector) -> Vector:
        """Return the quantity of that `name` at `x`, `d` [as declared]; d is refreshed."""
        values = self.executor.call(name, self.t, x, d, self.p)
        if name == MODEL and isinstance(self.executor, PythonExecutor):
            self.executor.add("derivative", self.t, x, d, self.p, values)
        return values

    def matrix(self, name: str, x: Vector, d: Vector) -> Vector:
        """Return the derivatives of a quantity by (x, d), of shape (size, size of x and d).

        Parameters
        ----------
        name : str
            Quantity to differentiate.
        x, d : Vector
            The point [units as declared].
        """
        tangents, t, p = self._jacobians.tangents(name), self.t, self.p
        active = next(q.active for q in self.assembly.quantities if q.name == name)
        d = self.plan.loops.put(t, x, d, p, active)
        found = tangents(t, x, d, p, np.eye(x.size + d.size))
        bad = ~np.isfinite(found)
        if bad.any():
            # A sweep multiplies an infinite slope by zero, along every direction that is not its
            # own. Written out, a Jacobian is slow to set up, but leaves such products away.
            found[bad] = tangents.written_out(t, x, d, p)[bad]
        return found

    def python(
        self, call: BlockCall, kind: str, quantity: str, x: Vector, d: Vector
    ) -> tuple[Vector, Vector]:
        """Return what an equation of a Python block returns, and its derivatives by (x, d).

        Parameters
        ----------
        call : BlockCall
            The block.
        kind : str
            The equation.
        quantity : str
            The block's inputs.
        x, d : Vector
            The point [units as declared].
        """
        equations = self.executor.blocks.equations[call.path]
        u = self.values(quantity, x, d)
        equation = Equation(call, equations, kind, self.t, self.p[call.parameters], d[call.modes], u)
        by_inputs = self.matrix(quantity, x, d)[equation.inputs]
        first = 0 if call.block.continuous else x.size
        states = np.arange(first + call.states.start, first + call.states.stop)
        z = np.concatenate([np.concatenate([x, d])[states], u[equation.inputs]])
        values = equation(z)
        slopes, error = equation.slopes(z)
        if error is None:
            self.derivatives[call.path] = "its own"
        else:
            error = self._errors[call.path] = max(error, self._errors.get(call.path, 0.0))
            self.derivatives[call.path] = f"differences, relative error {error:.1e}"
        by_states = np.zeros((states.size, x.size + d.size))
        by_states[np.arange(states.size), states] = 1.0
        return values, slopes @ np.vstack([by_states, by_inputs])


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
        self._function = program.expanded  # several times faster than kernel calls
        self._forward = self._function.forward(1)
        self._jacobian = cache(partial(program.jacobian, 1, 2))

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
        return np.asarray(self._jacobian()(t, x, d, p).full())


def _model(ports: Sequence[Port]) -> Quantity:
    """Return the quantity made of dx/dt and then the values of ports."""

    def collect(plan: Plan, evaluation: Evaluation) -> list[Array]:
        rates = derivative().collect(plan, evaluation)
        return rates + outputs(ports).collect(plan, evaluation)

    return Quantity(MODEL, frozenset(), collect)

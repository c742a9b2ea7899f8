"""Exact Jacobians of a plan's quantities, of its Python blocks, and of the update at one instant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np

from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import Indices
from trussflow.blocks.linear_analysis.lifting import Jump
from trussflow.blocks.linear_analysis.python_derivatives import Equation
from trussflow.blocks.simulation.block_instances import BlockCall
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.solver import Solver
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.evaluation import Evaluation
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.quantities import Quantity, derivative, outputs

RATES_AND_OUTPUTS = derivative().name
"""Name of the quantity made of dx/dt and then the values of ports."""


def prepared(plan: Plan, ports: Sequence[Port]) -> Prepared:
    """Return a `plan` with the quantity `RATES_AND_OUTPUTS`: dx/dt, then the values of `ports`."""
    solver = Solver(solver="RK45", backend="interpreted")
    return Prepared(plan, [_rates_and_outputs(ports)], solver)


class LocalJacobians:
    """Values and derivatives of what a plan computes at one time, in a run of its own.

    Use it in a ``with`` statement: Python blocks are open inside.

    Parameters
    ----------
    assembly : Prepared
        The plan with its clocks and Python blocks.
    tangents : callable
        Directional derivatives of the quantity of a name.
    t : float
        Time [s].
    p : Vector
        Parameters [units as declared].

    Attributes
    ----------
    derivatives : dict of str to str
        Method of differentiation of each Python block, keyed by path.
    """

    def __init__(
        self,
        assembly: Prepared,
        tangents: Callable[[str], Tangents],
        t: float,
        p: Vector,
    ) -> None:
        self.assembly, self._tangents = assembly, tangents
        self.plan = assembly.plan
        self.t, self.p = t, p
        self.derivatives: dict[str, str] = {}
        self._errors: dict[str, float] = {}
        self.executor = self.assembly.open(p)

    def __enter__(self) -> LocalJacobians:
        return self

    def __exit__(self, *error: object) -> None:
        self.executor.close()

    def values(self, name: str, x: Vector, d: Vector) -> Vector:
        """Return the quantity of that `name` at `x`, `d` [as declared]; d is refreshed."""
        return self.executor.call(name, self.t, x, d, self.p)

    def matrix(self, name: str, x: Vector, d: Vector) -> Vector:
        """Return the derivatives of a quantity by (x, d), of shape (size, size of x and d).

        Parameters
        ----------
        name : str
            Quantity to differentiate.
        x, d : Vector
            The point [units as declared].
        """
        tangents = self._tangents(name)
        t = self.t
        p = self.p
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
        self, call: BlockCall, kind: str, quantity: Quantity, x: Vector, d: Vector
    ) -> tuple[Vector, Vector]:
        """Return what an equation of a Python block returns, and its derivatives by (x, d).

        Parameters
        ----------
        call : BlockCall
            The block.
        kind : str
            The equation.
        quantity : Quantity
            The block's inputs.
        x, d : Vector
            The point [units as declared].
        """
        equations = self.executor.blocks.equations[call.path]
        u = self.values(quantity.name, x, d)
        equation = Equation(
            call, equations, kind, self.t, self.p[call.parameters], d[call.modes], u
        )
        by_inputs = self.matrix(quantity.name, x, d)[equation.inputs]
        first = 0 if call.block.continuous else x.size
        states = np.arange(first + call.states.start, first + call.states.stop)
        z = np.concatenate([np.concatenate([x, d])[states], u[equation.inputs]])
        values = equation(z)
        slopes, error = equation.slopes(z)
        if error is None:
            self.derivatives[call.path] = "its own"
        else:
            error = self._errors[call.path] = max(
                error, self._errors.get(call.path, 0.0)
            )
            self.derivatives[call.path] = f"differences, relative error {error:.1e}"
        by_states = np.zeros((states.size, x.size + d.size))
        by_states[np.arange(states.size), states] = 1.0
        return values, slopes @ np.vstack([by_states, by_inputs])

    @property
    def python_places(self) -> Indices:
        """Indices of the outputs of continuous Python blocks in (x, d)."""
        calls = [call for call, _ in self.assembly.python.continuous]
        parts = [self.plan.x.size + np.r_[call.outputs] for call in calls]
        return np.concatenate([np.zeros(0, dtype=np.int64), *parts])

    def python_outputs(self, x: Vector, d: Vector) -> Vector:
        """Return the derivatives of the outputs of continuous Python blocks by all else in (x, d).

        Their columns for the outputs themselves are zero. The outputs in d become what the blocks return.

        Parameters
        ----------
        x, d : Vector
            The point [units as declared].
        """
        where = self.python_places
        rows = [np.zeros((0, x.size + d.size))]
        for call, quantity in self.assembly.python.continuous:
            rows.append(self.python(call, "output", quantity, x, d)[1])
        direct = np.vstack(rows)
        # The outputs w = D_z z + D_w w; D_w is nilpotent but for loops that are solved.
        by_all = np.asarray(
            np.linalg.solve(np.eye(where.size) - direct[:, where], direct), dtype=float
        )
        by_all[:, where] = 0.0
        return by_all

    def substituted(self, matrix: Vector, by_all: Vector) -> Vector:
        """Return derivatives by (x, d) through the outputs of continuous Python blocks.

        Parameters
        ----------
        matrix : Vector
            Derivatives, those by the outputs of these blocks apart [any].
        by_all : Vector
            Result of `python_outputs` [any].
        """
        where = self.python_places
        found = matrix + matrix[:, where] @ by_all
        found[:, where] = 0.0
        return np.asarray(found)

    def discrete_update(self, number: int, x: Vector, d: Vector) -> Jump:
        """Return the derivatives of (x, memory, held) after an instant, by before and by u.

        The chain rule, in the order of a run: at each stage `after` are the derivatives of (x, d) as
        it is then by (x, d) as it was before the instant, and a block that computes replaces its own rows.

        Parameters
        ----------
        number : int
            Number of the set of clocks.
        x, d : Vector
            States and discrete data, before the instant [units as declared].
        """
        plan = self.plan
        d = d.copy()
        where = self.python_places
        after = np.eye(x.size + d.size)
        sequence = self.assembly.python.ordered[number]
        for call, quantity in sequence:
            # Outputs come one block after the other: each sees what those before it put into d.
            if call.block.outputs():
                after[where] = self.python_outputs(x, d) @ after
                values, slopes = self.python(call, "output", quantity, x, d)
                after[x.size + call.outputs.start : x.size + call.outputs.stop] = (
                    slopes @ after
                )
                d[call.outputs] = values
        after[where] = self.python_outputs(x, d) @ after
        # Updates are simultaneous: all see the outputs just made and the states before.
        staged = [
            (call.states, self.python(call, "update", quantity, x, d)[1] @ after)
            for call, quantity in sequence
            if call.size
        ]
        after[x.size :] = self.matrix(f"sample_{number}", x, d) @ after
        for states, rows in staged:
            after[x.size + states.start : x.size + states.stop] = rows
        inner = inner_places(plan)
        return after[np.ix_(inner, inner)], after[inner, x.size + plan.u_start :]


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

    def __call__(
        self, t: float, x: Vector, d: Vector, p: Vector, directions: Vector
    ) -> Vector:
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


def inner_places(plan: Plan) -> Indices:
    """Return where (x, memory, held) of a `plan` are in (x, d): modes and events stay as they are."""
    size = plan.x.size
    sampled = plan.sampled
    return np.array(
        np.r_[:size, size + sampled.start : size + sampled.stop], dtype=np.int64
    )


def _rates_and_outputs(ports: Sequence[Port]) -> Quantity:
    """Return the quantity made of dx/dt and then the values of ports."""

    def collect(evaluation: Evaluation) -> list[Array]:
        return derivative().collect(evaluation) + outputs(ports).collect(evaluation)

    return Quantity(RATES_AND_OUTPUTS, frozenset(), collect)

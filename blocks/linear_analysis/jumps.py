"""What happens at one instant, linearized: sampled blocks, traced ones and Python ones."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import prod

import numpy as np

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.isolation import checked, running_errors
from trussflow.blocks.framework.plan import Plan
from trussflow.blocks.framework.python_units import needed_inputs
from trussflow.blocks.framework.system import Indices
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.jacobians import Jacobians
from trussflow.blocks.linear_analysis.python_derivatives import differences, offered
from trussflow.blocks.linear_analysis.sampled import Jump


class Instants:
    """The jumps of a plan around one operating point.

    Parameters
    ----------
    jacobians : Jacobians
        Values and derivatives of the plan.
    t : float
        Time of the operating point [s].
    x, p : Vector
        Continuous states and parameters there [units as declared].

    Attributes
    ----------
    derivatives : dict of str to str
        How those of each Python block were found.
    """

    def __init__(self, jacobians: Jacobians, t: float, x: Vector, p: Vector) -> None:
        self._jacobians, self._t, self._x, self._p = jacobians, t, x, p
        self.derivatives: dict[str, str] = {}
        self._errors: dict[str, float] = {}

    def jump(self, number: int, d: Vector) -> Jump:
        """Return the derivatives of (x, memory, held) after an instant, by before and by u.

        Parameters
        ----------
        number : int
            Number of the set of clocks.
        d : Vector
            What is sampled, before the instant [units as declared].
        """
        plan, x = self._jacobians.plan, self._x
        size, d = x.size + d.size, d.copy()
        after = np.eye(size)  # rows: (x, d) so far; columns: (x, d) before the instant
        sequence = self._jacobians.units.sequence(number)
        for block, quantity in sequence:
            if not block.outputs():
                continue
            values, slopes = self._python(block, "output", quantity.name, d, after)
            for port in block.outputs():
                entry = plan.held.entries[block.path, port.name]
                start = x.size + plan.memory.size + entry.start
                after[start : start + entry.stop - entry.start] = slopes.pop(port.name)
                plan.held.put(d[plan.memory.size :], block.path, port.name, values[port.name])
        staged = {}
        for block, quantity in sequence:
            if block.states():
                _, slopes = self._python(block, "update", quantity.name, d, after)
                staged[block.path] = slopes
        result = after.copy()
        result[x.size :] = (
            self._jacobians.matrix(f"sample_{number}", self._t, x, d, self._p) @ after
        )
        for path, slopes in staged.items():
            for name, rows in slopes.items():
                entry = plan.memory.entries[path, name]
                result[x.size + entry.start : x.size + entry.stop] = rows
        inner = x.size + plan.u_start
        return result[:inner, :inner], result[:inner, inner:]

    def _python(
        self, block: Block, kind: str, quantity: str, d: Vector, so_far: Vector
    ) -> tuple[Values, dict[str, Vector]]:
        """Return an equation's values, and their derivatives by (x, d) before the instant."""
        plan, t, x, p = self._jacobians.plan, self._t, self._x, self._p
        equation = _Equation(plan, block, kind, t, p)
        u = self._jacobians.values(quantity, t, x, d, p)[equation.inputs]
        slopes_u = self._jacobians.matrix(quantity, t, x, d, p)[equation.inputs] @ so_far
        z = np.concatenate([d[equation.memory], u])
        values = equation.values(z)
        if offered(block) is None:
            matrix, error = differences(block, lambda z: equation.flat(equation.values(z)), z)
            error = self._errors[block.path] = max(error, self._errors.get(block.path, 0.0))
            self.derivatives[block.path] = f"differences, relative error {error:.1e}"
        else:
            columns = [equation.flat(equation.along(z, e)) for e in np.eye(z.size)]
            matrix = np.array(columns).reshape(z.size, -1).T
            self.derivatives[block.path] = "its own"
        slopes, start = {}, 0
        by_z = matrix @ np.vstack([so_far[x.size + equation.memory], slopes_u])
        for name, shape in equation.returned.items():
            slopes[name] = by_z[start : start + prod(shape)]
            start += prod(shape)
        return values, slopes


class _Equation:
    """One equation of a Python block, as a function of a vector: states, then inputs it needs.

    Attributes
    ----------
    memory, inputs : array of int
        Where the states are in d, and the inputs needed in all inputs of the block.
    returned : dict
        Shapes of what it returns, by name, in the order of the vector.
    """

    def __init__(self, plan: Plan, block: Block, kind: str, t: float, p: Vector) -> None:
        self._block, self._kind, self._t = block, kind, t
        self._owner = f"block '{block.path}'"
        own = plan.p.unpack(p, np.reshape)
        self._parameters = own.get(block.path, Signals(self._owner, {}))
        memory = [e for e in plan.memory if e.path == block.path]
        self._states = {e.name: e.shape for e in memory}
        self.memory = _joined([np.arange(e.start, e.stop) for e in memory])
        shapes = {port.name: port.whole_shape or () for port in block.inputs()}
        needed = set(shapes) if kind == "update" else needed_inputs(plan, block)
        self._needed, self._others, rows, start = {}, {}, [], 0
        for name, shape in shapes.items():
            stop = start + prod(shape)
            if name in needed:
                self._needed[name] = shape
                rows.append(np.arange(start, stop))
            else:  # as in a simulation: what an output does not depend on, it does not see
                self._others[name] = np.full(shape, np.nan)
            start = stop
        self.inputs = _joined(rows)
        outputs = {port.name: port.whole_shape or () for port in block.outputs()}
        self.returned = self._states if kind == "update" else outputs

    def values(self, z: Vector) -> Values:
        """Return what the equation returns."""
        return self._call(getattr(self._block, self._kind), self._kind, z)

    def along(self, z: Vector, direction: Vector) -> Values:
        """Return the block's own directional derivative."""
        own = offered(self._block)
        assert own is not None
        return self._call(partial(own, self._kind), "directional_derivative", z, direction)

    def _call(self, function: Callable[..., Values], what: str, z: Vector, *more: Vector) -> Values:
        directions = [signals for direction in more for signals in self._split(direction)]
        with running_errors(self._block, what, self._t):
            found = function(np.float64(self._t), *self._split(z), self._parameters, *directions)
            return checked(self._block, self._kind, found)

    def _split(self, z: Vector) -> tuple[Signals, Signals]:
        found, start = [], 0
        for shapes in (self._states, self._needed):
            arrays = {}
            for name, shape in shapes.items():
                arrays[name] = np.reshape(z[start : start + prod(shape)], shape)
                start += prod(shape)
            found.append(arrays)
        return Signals(self._owner, found[0]), Signals(self._owner, found[1] | self._others)

    def flat(self, values: Values) -> Vector:
        """Return values in one vector."""
        parts = [np.ravel(np.asarray(values[name], dtype=float)) for name in self.returned]
        return np.concatenate([np.zeros(0), *parts])


def _joined(parts: list[Indices]) -> Indices:
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])

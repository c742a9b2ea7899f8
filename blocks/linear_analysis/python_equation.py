"""The equations of Python blocks as functions of vectors, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import prod

import numpy as np

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.system import Indices
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.python_derivatives import differences, offered
from trussflow.blocks.simulation.python_sampled import needed_inputs
from trussflow.blocks.tracing.block_check import checked, running_errors
from trussflow.blocks.tracing.plan import Plan


class Equation:
    """One equation of a Python block, as a function of a vector: states, then inputs it needs.

    Parameters
    ----------
    plan : Plan
        The plan that the block is in.
    block : Block
        The block.
    kind : str
        "output", "update" or "derivative".
    t : float
        Time [s].
    p : Vector
        All parameters of the plan [units as declared].

    Attributes
    ----------
    block : Block
        The block.
    states, inputs : array of int
        Where the states are in (x, d), and the inputs needed in all inputs of the block.
    returned : dict
        Shapes of what it returns, by name, in the order of the vector.
    """

    def __init__(self, plan: Plan, block: Block, kind: str, t: float, p: Vector) -> None:
        self.block, self._kind, self._t = block, kind, t
        self._owner = f"block '{block.path}'"
        own = plan.p.unpack(p, np.reshape)
        self._parameters = own.get(block.path, Signals(self._owner, {}))
        layout, start = (plan.x, 0) if block.continuous else (plan.memory, plan.x.size)
        own_states = [e for e in layout if e.path == block.path]
        self._states = {e.name: e.shape for e in own_states}
        self.states = _joined([start + np.arange(e.start, e.stop) for e in own_states])
        shapes = {port.name: port.whole_shape or () for port in block.inputs()}
        needed = needed_inputs(plan, block) if kind == "output" else set(shapes)
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
        self.returned = outputs if kind == "output" else self._states

    def values(self, z: Vector) -> Values:
        """Return what the equation returns."""
        return self._call(getattr(self.block, self._kind), self._kind, z)

    def along(self, z: Vector, direction: Vector) -> Values:
        """Return the block's own directional derivative."""
        own = offered(self.block)
        assert own is not None
        return self._call(partial(own, self._kind), "directional_derivative", z, direction)

    def _call(self, function: Callable[..., Values], what: str, z: Vector, *more: Vector) -> Values:
        directions = [signals for direction in more for signals in self._split(direction)]
        with running_errors(self.block, what, self._t):
            found = function(np.float64(self._t), *self._split(z), self._parameters, *directions)
            return checked(self.block, self._kind, found)

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


class Record:
    """Takes the derivatives of Python blocks, and keeps how they were found.

    Attributes
    ----------
    found : dict of str to str
        How, by path of the block.
    """

    def __init__(self) -> None:
        self.found: dict[str, str] = {}
        self._errors: dict[str, float] = {}

    def slopes(self, equation: Equation, z: Vector) -> tuple[Values, Vector]:
        """Return what an equation returns, and its Jacobian by z.

        Parameters
        ----------
        equation : Equation
            The equation.
        z : Vector
            Its states, then its inputs [units as declared].
        """
        values, path = equation.values(z), equation.block.path
        if offered(equation.block) is None:
            matrix, error = differences(equation.block, lambda z: equation.flat(equation.values(z)), z)
            error = self._errors[path] = max(error, self._errors.get(path, 0.0))
            self.found[path] = f"differences, relative error {error:.1e}"
        else:
            columns = [equation.flat(equation.along(z, e)) for e in np.eye(z.size)]
            matrix = np.array(columns).reshape(z.size, -1).T
            self.found[path] = "its own"
        return values, matrix


def _joined(parts: list[Indices]) -> Indices:
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])

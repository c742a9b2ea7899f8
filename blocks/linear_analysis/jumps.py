"""What happens at one instant, linearized: sampled blocks, traced ones and Python ones."""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from typing import Any

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.jacobians import Jacobians
from trussflow.blocks.linear_analysis.python_derivatives import differences
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
    errors : dict of str to float
        Estimated relative error of the differences taken of each Python block [-].
    """

    def __init__(self, jacobians: Jacobians, t: float, x: Vector, p: Vector) -> None:
        self._jacobians, self._t, self._x, self._p = jacobians, t, x, p
        self.errors: dict[str, float] = {}

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
    ) -> tuple[dict[str, Vector], dict[str, Vector]]:
        """Return an equation's values, and their derivatives by (x, d) before the instant."""
        plan, t, x, p = self._jacobians.plan, self._t, self._x, self._p
        slopes_u = self._jacobians.matrix(quantity, t, x, d, p) @ so_far
        u = self._jacobians.values(quantity, t, x, d, p)
        memory = [e for e in plan.memory if e.path == block.path]
        rows = [np.arange(e.start, e.stop) for e in memory]
        own = np.concatenate([np.zeros(0, int), *rows]).astype(int)
        slopes_z = np.vstack([so_far[x.size + own], slopes_u])
        shapes = {e.name: e.shape for e in memory} | {
            port.name: port.whole_shape or () for port in block.inputs()
        }
        states = {e.name for e in memory}
        parameters = plan.p.unpack(p, np.reshape).get(block.path, Signals(block.path, {}))

        def split(z: Vector) -> tuple[Signals, Signals]:
            groups: tuple[dict[str, Any], dict[str, Any]] = ({}, {})
            start = 0
            for name, shape in shapes.items():
                stop = start + prod(shape)
                groups[name not in states][name] = np.reshape(z[start:stop], shape)
                start = stop
            owner = f"block '{block.path}'"
            return Signals(owner, groups[0]), Signals(owner, groups[1])

        def values_of(z: Vector) -> dict[str, Any]:
            own_x, own_u = split(z)
            found: dict[str, Any] = getattr(block, kind)(np.float64(t), own_x, own_u, parameters)
            return found

        z = np.concatenate([d[own], u])
        values = {k: np.asarray(v, dtype=float) for k, v in values_of(z).items()}
        matrix = self._derivative(block, values_of, z)
        slopes, start = {}, 0
        for name, value in values.items():
            slopes[name] = matrix[start : start + value.size] @ slopes_z
            start += value.size
        return values, slopes

    def _derivative(
        self, block: Block, values_of: Callable[[Vector], dict[str, Any]], z: Vector
    ) -> Vector:
        def flat(point: Vector) -> Vector:
            return np.concatenate([np.zeros(0), *(np.ravel(v) for v in values_of(point).values())])

        matrix, error = differences(block, flat, z)
        self.errors[block.path] = max(error, self.errors.get(block.path, 0.0))
        return matrix

"""What happens at one instant, linearized: sampled blocks, traced ones and Python ones."""

from __future__ import annotations

from math import prod

import numpy as np

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.jacobians import Jacobians
from trussflow.blocks.linear_analysis.lifting import Jump
from trussflow.blocks.linear_analysis.python_equation import Equation, Record


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

    record : Record
        Keeps how the derivatives of Python blocks were found.
    """

    def __init__(self, jacobians: Jacobians, t: float, x: Vector, p: Vector, record: Record) -> None:
        self._jacobians, self._t, self._x, self._p = jacobians, t, x, p
        self.record = record

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
            after = self._refreshed(d, after)
            values, slopes = self._python(block, "output", quantity.name, d, after)
            for port in block.outputs():
                entry = plan.held.entries[block.path, port.name]
                start = x.size + plan.memory.size + entry.start
                after[start : start + entry.stop - entry.start] = slopes.pop(port.name)
                plan.held.put(d[plan.memory.size :], block.path, port.name, values[port.name])
        staged = {}
        after = self._refreshed(d, after)
        for block, quantity in sequence:
            if block.states():
                _, slopes = self._python(block, "update", quantity.name, d, after)
                staged[block.path] = slopes
        result = after.copy()
        result[x.size :] = self._jacobians.matrix(f"sample_{number}", self._t, x, d, self._p) @ after
        for path, slopes in staged.items():
            for name, rows in slopes.items():
                entry = plan.memory.entries[path, name]
                result[x.size + entry.start : x.size + entry.stop] = rows
        inner = x.size + plan.u_start
        return result[:inner, :inner], result[:inner, inner:]

    def _refreshed(self, d: Vector, so_far: Vector) -> Vector:
        """Let continuous Python blocks see what is there so far."""
        live = self._jacobians.live
        return (
            so_far
            if live is None
            else live.signals(self._t, self._x, d, self._p, self.record).refresh(so_far)
        )

    def _python(
        self, block: Block, kind: str, quantity: str, d: Vector, so_far: Vector
    ) -> tuple[Values, dict[str, Vector]]:
        """Return an equation's values, and their derivatives by (x, d) before the instant."""
        plan, t, x, p = self._jacobians.plan, self._t, self._x, self._p
        equation = Equation(plan, block, kind, t, p)
        u = self._jacobians.values(quantity, t, x, d, p)[equation.inputs]
        slopes_u = self._jacobians.matrix(quantity, t, x, d, p)[equation.inputs] @ so_far
        z = np.concatenate([np.concatenate([x, d])[equation.states], u])
        values, matrix = self.record.slopes(equation, z)
        slopes, start = {}, 0
        by_z = matrix @ np.vstack([so_far[equation.states], slopes_u])
        for name, shape in equation.returned.items():
            slopes[name] = by_z[start : start + prod(shape)]
            start += prod(shape)
        return values, slopes

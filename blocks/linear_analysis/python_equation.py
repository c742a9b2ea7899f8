"""The equations of Python blocks as functions of vectors, and their derivatives."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.python_derivatives import differences, offered
from trussflow.blocks.simulation.block_instances import BlockCall
from trussflow.blocks.tracing.calling import running_errors


class Equation:
    """One equation of a Python block, as a function of a vector: states, then inputs it needs.

    Parameters
    ----------
    call : BlockCall
        The block.
    equations : Equations
        Equation object of the block.
    kind : str
        "output", "update" or "derivative".
    t : float
        Time [s].
    p, modes, u : Vector
        The block's own parameters, its modes, which stay as they are, and its inputs [units as declared].

    Attributes
    ----------
    inputs : array of int
        Indices of the inputs that the equation needs.
    """

    def __init__(
        self, call: BlockCall, equations: Equations, kind: str, t: float, p: Vector, modes: Vector, u: Vector
    ) -> None:
        self.call, self._equations, self._kind, self._t, self._p = call, equations, kind, t, p
        self._modes = modes
        needed = call.needed if kind == "output" else np.ones_like(call.needed)
        self.inputs = np.flatnonzero(needed)
        # As in a simulation: what the output of a sampled block does not depend on, it does not see.
        self._others = u if call.block.continuous else np.full(u.size, np.nan)

    def __call__(self, z: Vector) -> Vector:
        """Return what the equation returns."""
        return self.call(self._equations, self._kind, self._t, *self._split(z, self._others), self._p)

    def along(self, z: Vector, direction: Vector) -> Vector:
        """Return the block's own derivative at `z` [as declared] along a `direction` of the same units."""
        own = offered(self.call.block, self._equations)
        assert own is not None
        x, u, p = self._signals(z, self._others)
        dx, du, _ = self._signals(direction, 0.0 * self._others)
        with running_errors(self.call.block, "directional_derivative", self._t):
            found = own(self._kind, np.float64(self._t), x, u, p, dx, du)
            return self.call.flat(self._kind, found, z)

    def slopes(self, z: Vector) -> tuple[Vector, float | None]:
        """Return the derivatives by z, and their relative error if they are differences."""
        if offered(self.call.block, self._equations) is None or not z.size:
            return differences(self.call.block, self, z)
        columns = [self.along(z, e) for e in np.eye(z.size)]
        return np.array(columns).reshape(z.size, -1).T, None

    def _split(self, z: Vector, others: Vector) -> tuple[Vector, Vector]:
        """Return states, with the modes, and inputs; those that are not needed are as in `others`."""
        u = others.copy()
        u[self.inputs] = z[self.call.size :]
        return np.concatenate([z[: self.call.size], self._modes]), u

    def _signals(self, z: Vector, others: Vector) -> tuple[Signals, Signals, Signals]:
        return self.call.signals(*self._split(z, others), self._p)

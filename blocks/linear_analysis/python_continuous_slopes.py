"""Continuous Python blocks, linearized: their outputs are functions of everything else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trussflow.blocks.framework.system import Indices
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.jacobians import LocalJacobians
from trussflow.blocks.simulation.prepared import Prepared


@dataclass(frozen=True, slots=True)
class ClosedOutputs:
    """Outputs of continuous Python blocks, which have places in d, by all that is free.

    Attributes
    ----------
    places : array of int
        Indices of the outputs in (x, d).
    by_all : Vector, shape (number of outputs, size of x and d)
        Their derivatives [as declared]; zero by themselves.
    """

    places: Indices
    by_all: Vector

    def substitute(self, matrix: Vector) -> Vector:
        """Return a `matrix` of derivatives by (x, d) [as declared], with the outputs no longer free."""
        closed = matrix + matrix[:, self.places] @ self.by_all
        closed[:, self.places] = 0.0
        return closed

    def refresh(self, so_far: Vector) -> Vector:
        """Return derivatives of (x, d) [as declared], `so_far` without the outputs, with them."""
        after = so_far.copy()
        after[self.places] = self.by_all @ so_far
        return after


def continuous_places(assembly: Prepared) -> Indices:
    """Return where the outputs of continuous Python blocks are in (x, d)."""
    size = assembly.plan.x.size
    parts = [
        np.arange(size + call.outputs.start, size + call.outputs.stop)
        for call, _ in assembly.continuous.ordered
    ]
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def closed_outputs(local: LocalJacobians, x: Vector, d: Vector) -> ClosedOutputs:
    """Return the outputs, linearized; their values in d become what the blocks return.

    Parameters
    ----------
    local : LocalJacobians
        The plan, where it is linearized.
    x, d : Vector
        The point [units as declared].
    """
    where = continuous_places(local.assembly)
    rows = [np.zeros((0, x.size + d.size))]
    for call, quantity in local.assembly.continuous.ordered:
        rows.append(local.python(call, "output", quantity.name, x, d)[1])
    direct = np.vstack(rows)
    # The outputs w = D_z z + D_w w; D_w is nilpotent but for loops that are solved.
    by_all = np.asarray(np.linalg.solve(np.eye(where.size) - direct[:, where], direct), dtype=float)
    by_all[:, where] = 0.0
    return ClosedOutputs(where, by_all)


def add_rates(matrix: Vector, local: LocalJacobians, x: Vector, d: Vector) -> None:
    """Put the derivatives of the blocks' rates by (x, d) into their rows of a matrix.

    Parameters
    ----------
    matrix : Vector
        Derivatives; its first rows are those of dx/dt [any].
    local : LocalJacobians
        The plan, where it is linearized.
    x, d : Vector
        The point [units as declared].
    """
    for call, quantity in local.assembly.continuous.ordered:
        if call.size:
            matrix[call.states] = local.python(call, "derivative", quantity.name, x, d)[1]

"""Continuous Python blocks, linearized: their outputs are functions of everything else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.system import Indices
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.python_equation import Equation, Record
from trussflow.blocks.simulation.python_continuous import LiveBlocks

if TYPE_CHECKING:
    from trussflow.blocks.linear_analysis.jacobians import Jacobians


@dataclass(frozen=True, slots=True)
class Closed:
    """Outputs of continuous Python blocks, which have places in d, by all that is free.

    Attributes
    ----------
    places : array of int
        Where the outputs are in (x, d).
    by_all : Vector, shape (number of outputs, size of x and d)
        Their derivatives; zero by themselves.
    """

    places: Indices
    by_all: Vector

    def substitute(self, matrix: Vector) -> Vector:
        """Return derivatives by (x, d) with the outputs no longer free."""
        closed = matrix + matrix[:, self.places] @ self.by_all
        closed[:, self.places] = 0.0
        return closed

    def refresh(self, so_far: Vector) -> Vector:
        """Return the derivatives of (x, d) by anything, after the blocks were asked again."""
        after = so_far.copy()
        after[self.places] = self.by_all @ so_far
        return after


class LiveSlopes:
    """The continuous Python blocks of a plan.

    Parameters
    ----------
    jacobians : Jacobians
        Values and derivatives of what is traced.
    blocks : LiveBlocks
        The blocks.

    Attributes
    ----------
    places : array of int
        Where the blocks' outputs are in (x, d).
    """

    def __init__(self, jacobians: Jacobians, blocks: LiveBlocks) -> None:
        self._jacobians, self._blocks = jacobians, blocks
        plan = jacobians.plan
        start, parts = plan.x.size + plan.memory.size, [np.zeros(0, dtype=np.int64)]
        for block, _ in blocks.ordered():
            entries = [plan.held.entries[block.path, port.name] for port in block.outputs()]
            parts += [np.arange(start + e.start, start + e.stop) for e in entries]
        self.places = np.concatenate(parts)

    def signals(self, t: float, x: Vector, d: Vector, p: Vector, record: Record) -> Closed:
        """Return the outputs, linearized; their values in d become what the blocks return.

        Parameters
        ----------
        t, x, d, p : float, Vector
            The point [units as declared].
        record : Record
            Keeps how the derivatives were found.
        """
        self._jacobians.values("live_0", t, x, d, p)  # refreshes d
        rows, where = [np.zeros((0, x.size + d.size))], self.places
        for block, quantity in self._blocks.ordered():
            rows.append(self._by_all("output", block, quantity.name, (t, x, d, p), record))
        direct = np.vstack(rows)
        by_all = np.asarray(np.linalg.solve(np.eye(where.size) - direct[:, where], direct), dtype=np.float64)
        by_all[:, where] = 0.0
        return Closed(where, by_all)

    def add_rates(self, matrix: Vector, t: float, x: Vector, d: Vector, p: Vector, record: Record) -> None:
        """Put the derivatives of the blocks' rates by (x, d) into their rows of a matrix.

        Parameters
        ----------
        matrix : Vector
            Derivatives; its first rows are those of dx/dt [any].
        t, x, d, p : float, Vector
            The point [units as declared].
        record : Record
            Keeps how the derivatives were found.
        """
        for block, quantity in self._blocks.ordered():
            states = Equation(self._jacobians.plan, block, "derivative", t, p).states
            matrix[states] = self._by_all("derivative", block, quantity.name, (t, x, d, p), record)

    def _by_all(
        self,
        kind: str,
        block: Block,
        quantity: str,
        point: tuple[float, Vector, Vector, Vector],
        record: Record,
    ) -> Vector:
        """Return the derivatives of an equation by (x, d), in the order of what it returns."""
        t, x, d, p = point
        equation = Equation(self._jacobians.plan, block, kind, t, p)
        u = self._jacobians.values(quantity, t, x, d, p)[equation.inputs]
        slopes_u = self._jacobians.matrix(quantity, t, x, d, p)[equation.inputs]
        z = np.concatenate([x[equation.states], u])
        _, matrix = record.slopes(equation, z)
        own = np.zeros((equation.states.size, x.size + d.size))
        own[np.arange(equation.states.size), equation.states] = 1.0
        found: Vector = matrix @ np.vstack([own, slopes_u])
        return found

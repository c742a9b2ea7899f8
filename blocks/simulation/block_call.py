"""The equations of one Python block, called with its parts of the flat vectors of a plan."""

from __future__ import annotations

from math import prod
from typing import Any

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.framework.validation import number_array
from trussflow.blocks.tracing.calling import checked, running_errors
from trussflow.blocks.tracing.plan import Plan

Arrays = list[tuple[str, slice, tuple[int, ...]]]
"""Names of arrays, their places in a flat vector, and their shapes."""


class BlockCall:
    """Calls the equations of a Python block with flat vectors: its states, inputs, parameters.

    Parameters
    ----------
    plan : Plan
        The plan that the block is in.
    block : Block
        The block.

    Attributes
    ----------
    block : Block
        The block.
    path : str
        Its path.
    states, outputs, parameters : slice
        Where its states are in x (of a continuous block) or d (of a sampled one), its outputs in
        d, and its parameters in p.
    size : int
        Number of its states [-].
    needed : array of bool
        Which of its inputs any of its outputs depends on within an instant.
    direct : bool
        Whether there are any.
    """

    def __init__(self, plan: Plan, block: Block) -> None:
        self.block, self.path = block, block.path
        self.states = (plan.x if block.continuous else plan.memory).span_of(block.path)
        self.outputs, self.parameters = plan.held.span_of(block.path), plan.p.span_of(block.path)
        self._owner = f"block '{block.path}'"
        shapes = {name: block.state_shape(name) for name in block.states()}
        self._states, self.size = _laid_out(shapes)
        self._inputs, number = _laid_out({p.name: p.whole_shape or () for p in block.inputs()})
        self._outputs, _ = _laid_out({p.name: p.whole_shape or () for p in block.outputs()})
        self._parameters, _ = _laid_out({name: v.shape for name, v in block.parameters.items()})
        needed = frozenset().union(*plan.feedthrough[block.path].values())
        self.needed = np.zeros(number, dtype=bool)
        for name, place, _ in self._inputs:
            self.needed[place] = name in needed
        self.direct, self._all_needed = bool(self.needed.any()), bool(self.needed.all())

    def seen(self, u: Vector) -> Vector:
        """Return the inputs `u` [as declared] as `output` sees them: NaN where none depends on them."""
        return u if self._all_needed else np.where(self.needed, u, np.nan)

    def ask(self, equations: Equations, kind: str, t: float, s: Vector, u: Vector, p: Vector) -> Any:
        """Return what an equation returns, unchecked.

        Parameters
        ----------
        equations : Equations
            The block, or what it keeps in this run.
        kind : str
            Name of the equation.
        t : float
            Time [s].
        s, u, p : Vector
            The block's own states, inputs and parameters [units as declared].
        """
        with running_errors(self.block, kind, t):
            return getattr(equations, kind)(np.float64(t), *self.signals(s, u, p))

    def signals(self, s: Vector, u: Vector, p: Vector) -> tuple[Signals, Signals, Signals]:
        """Return the block's own states `s`, inputs `u`, parameters `p` [as declared] by name."""
        vectors = ((self._states, s), (self._inputs, u), (self._parameters, p))
        x, given, own = (
            Signals(self._owner, {name: flat[place].reshape(shape) for name, place, shape in arrays})
            for arrays, flat in vectors
        )
        return x, given, own

    def __call__(self, equations: Equations, kind: str, t: float, s: Vector, u: Vector, p: Vector) -> Vector:
        """Return what an equation returns, checked, in one vector; arguments as for `ask`.

        States that `on_event` does not return stay as they are.
        """
        return self.flat(kind, self.ask(equations, kind, t, s, u, p), s)

    def flat(self, kind: str, values: Any, s: Vector) -> Vector:
        """Return the `values` that an equation of that `kind` returned, checked, in one vector.

        States that are not in it are those in `s` [as declared].
        """
        if isinstance(values, dict):
            where = f"what {kind}() of Python block '{self.path}' returned as"
            values = {name: number_array(f"{where} '{name}'", value) for name, value in values.items()}
        arrays = checked(self.block, kind, values)
        if kind == "on_event":
            arrays = {name: arrays.get(name, s[place]) for name, place, _ in self._states}
        order = self._outputs if kind == "output" else self._states
        parts = [np.ravel(arrays[name]) for name, _, _ in order]
        return np.concatenate(parts) if parts else np.zeros(0)


def _laid_out(shapes: dict[str, tuple[int, ...]]) -> tuple[Arrays, int]:
    """Return where arrays stand one after the other, and how many numbers they are."""
    sizes = [prod(shape) for shape in shapes.values()]
    return list(zip(shapes, spans(sizes), shapes.values(), strict=True)), sum(sizes)

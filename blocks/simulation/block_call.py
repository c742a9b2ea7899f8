"""The equations of one Python block, called with its parts of the flat vectors of a plan."""

from __future__ import annotations

from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Event, Mode, Signals
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
        Indices of its states in x (continuous block) or d (sampled block), of its outputs in
        d, and its parameters in p.
    size : int
        Number of its states [-].
    modes, events, fired : slice
        Indices of its modes and event flags in d, and of its indicators among all.
    needed : array of bool
        Inputs with direct feedthrough to any output.
    direct : bool
        Whether there are any.
    """

    def __init__(self, plan: Plan, block: Block) -> None:
        self.block, self.path = block, block.path
        self.states = (plan.x if block.continuous else plan.memory).span_of(block.path)
        self.outputs, self.parameters = plan.held.span_of(block.path), plan.p.span_of(block.path)
        self._owner = f"block '{block.path}'"
        self.modes, self.fired = plan.modes.span_of(block.path), plan.fired.span_of(block.path)
        first = plan.fired.span.start
        self.events = slice(max(self.fired.start - first, 0), max(self.fired.stop - first, 0))
        self._events, _ = _laid_out({name: block.state_shape(name) for name in block.declared(Event)})
        shapes = {name: block.state_shape(name) for name in [*block.states(), *block.declared(Mode)]}
        self._stored, _ = _laid_out(shapes)
        self._states = self._stored[: len(block.states())]
        self.size = self.states.stop - self.states.start
        self._inputs, number = _laid_out({p.name: p.whole_shape or () for p in block.inputs()})
        self._outputs, _ = _laid_out({p.name: p.whole_shape or () for p in block.outputs()})
        self._parameters, _ = _laid_out({name: v.shape for name, v in block.parameters.items()})
        needed = frozenset().union(*plan.feedthrough[block.path].values())
        self.needed = np.zeros(number, dtype=bool)
        for name, place, _ in self._inputs:
            self.needed[place] = name in needed
        self.direct, self._all_needed = bool(self.needed.any()), bool(self.needed.all())

    def own(self, x: Vector, d: Vector) -> Vector:
        """Return the block's own states, then its modes, of all `x` and `d` [as declared]; a copy."""
        return np.concatenate([(x if self.block.continuous else d)[self.states], d[self.modes]])

    def places(self, size: int) -> NDArray[np.int64]:
        """Return where states and modes of a continuous block are in (x, modes); x has that `size` [-]."""
        modes = np.r_[size + self.modes.start : size + self.modes.stop]
        return np.concatenate([np.r_[self.states], modes]).astype(np.int64)

    def happened(self, flags: NDArray[np.bool_]) -> Signals:
        """Return by name which of the block's events happen, of the `flags` of all of them [-]."""
        return Signals(self._owner, {n: flags[place].reshape(shape) for n, place, shape in self._events})

    def seen(self, u: Vector) -> Vector:
        """Return the inputs `u` [as declared] as `output` sees them: NaN where none depends on them."""
        return u if self._all_needed else np.where(self.needed, u, np.nan)

    def ask(
        self, equations: Equations, kind: str, t: float, s: Vector, u: Vector, p: Vector, *more: Signals
    ) -> Any:
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
            The block's own states and modes, inputs and parameters [units as declared].
        *more : Signals
            Further arguments of the equation.
        """
        with running_errors(self.block, kind, t):
            return getattr(equations, kind)(np.float64(t), *self.signals(s, u, p), *more)

    def signals(self, s: Vector, u: Vector, p: Vector) -> tuple[Signals, Signals, Signals]:
        """Return the block's own states and modes `s`, inputs `u`, parameters `p` [as declared] by name."""
        vectors = ((self._stored, s), (self._inputs, u), (self._parameters, p))
        x, given, own = (
            Signals(self._owner, {name: flat[place].reshape(shape) for name, place, shape in arrays})
            for arrays, flat in vectors
        )
        return x, given, own

    def __call__(self, equations: Equations, kind: str, t: float, s: Vector, u: Vector, p: Vector) -> Vector:
        """Return what an equation returns, checked, in one vector; arguments as for `ask`."""
        return self.flat(kind, self.ask(equations, kind, t, s, u, p), s)

    def flat(self, kind: str, values: Any, s: Vector) -> Vector:
        """Return the `values` that an equation of that `kind` returned, checked, in one vector.

        States and modes that `on_event` did not return are those in `s` [as declared].
        """
        if isinstance(values, dict):
            where = f"what {kind}() of Python block '{self.path}' returned as"
            values = {name: number_array(f"{where} '{name}'", value) for name, value in values.items()}
        arrays = checked(self.block, kind, values)
        if kind == "on_event":
            arrays = {name: arrays.get(name, s[place]) for name, place, _ in self._stored}
        kinds = {"output": self._outputs, "indicators": self._events, "on_event": self._stored}
        order = kinds.get(kind, self._states)
        parts = [np.ravel(arrays[name]) for name, _, _ in order]
        return np.concatenate(parts) if parts else np.zeros(0)


def _laid_out(shapes: dict[str, tuple[int, ...]]) -> tuple[Arrays, int]:
    """Return where arrays stand one after the other, and how many numbers they are."""
    sizes = [prod(shape) for shape in shapes.values()]
    return list(zip(shapes, spans(sizes), shapes.values(), strict=True)), sum(sizes)

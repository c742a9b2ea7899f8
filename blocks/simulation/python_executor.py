"""The executor of a diagram with Python blocks: it asks them, and steps from event to event."""

from __future__ import annotations

from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.executor import Executor, Progress, Span
from trussflow.blocks.simulation.open_blocks import OpenBlocks
from trussflow.blocks.simulation.python_continuous import ContinuousInRun, ContinuousPythonBlocks
from trussflow.blocks.simulation.python_sampled import SampledInRun, SampledPythonBlocks


class PythonExecutor(Executor):
    """Evaluates what is traced and the Python blocks around it.

    Parameters
    ----------
    inner : Executor
        Evaluates what is traced.
    sampled : SampledPythonBlocks
        The sampled Python blocks.
    continuous : ContinuousPythonBlocks
        The continuous ones.
    blocks : OpenBlocks
        Both, opened for this run.
    """

    def __init__(
        self,
        inner: Executor,
        sampled: SampledPythonBlocks,
        continuous: ContinuousPythonBlocks,
        blocks: OpenBlocks,
    ) -> None:
        self.name, self.blocks, self.plan = inner.name, blocks, inner.plan
        self._inner, self._has_continuous = inner, bool(continuous)
        self._evaluates: Executor = self if continuous else inner
        self._sampled = SampledInRun(sampled, blocks.equations, self._evaluates)
        self.continuous = ContinuousInRun(continuous, blocks.equations, inner)
        own = self.continuous
        self._added = {"derivative": own.rates, "indicators": own.indicators, "on_event": own.handle}

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name; outputs of continuous Python blocks change in d."""
        if not self._has_continuous:
            return self._inner.call(name, t, x, d, p)
        self.continuous.refresh(t, x, d, p)
        values = self._inner.call(name, t, x, d, p)
        if add := self._added.get(name):
            add(t, x, d, p, values)
        return values

    def advance(self, span: Span, x: Vector, d: Vector, p: Vector, log: Vector) -> Progress:
        """Take the steps of a span in place; rows of `log` [as declared] are filled in order."""
        if self._has_continuous:
            return super().advance(span, x, d, p, log)
        return self._inner.advance(span, x, d, p, log)

    def instant(
        self, number: int, t: float, x: Vector, d: Vector, p: Vector, *, update: bool = True
    ) -> Vector:
        """Return d after an instant: Python blocks first, then the traced ones."""
        self._sampled.show(number, t, x, d, p)
        staged = self._sampled.update(number, t, x, d, p) if update else []
        # Where Python blocks alone are sampled there is nothing to evaluate.
        traced = self._sampled.blocks.with_traced[number]
        after = self._evaluates.call(f"sample_{number}", t, x, d, p) if traced else d.copy()
        for place, states in staged:
            after[place] = states
        return after

    def accepted(self, t: float, x: Vector, d: Vector, p: Vector) -> bool:
        """Tell Python blocks that a step is accepted; return whether one asks for an event."""
        return self._has_continuous and self.continuous.accepted(t, x, d, p)

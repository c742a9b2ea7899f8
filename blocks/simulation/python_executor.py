"""The executor of a diagram with Python blocks: it asks them, and steps from event to event."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.events import EventWatch
from trussflow.blocks.simulation.executor import Executor, Progress, Span
from trussflow.blocks.simulation.open_blocks import OpenBlocks
from trussflow.blocks.simulation.python_continuous import ContinuousInRun, ContinuousPythonBlocks
from trussflow.blocks.simulation.python_sampled import SampledInRun, SampledPythonBlocks

JUMP = "(jump)"
"""Under which the signs of indicators are saved, beside the paths of blocks."""


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
        self.name, self.blocks = inner.name, blocks
        self._inner, self._has_continuous = inner, bool(continuous)
        self.has_events = continuous.have_events
        self._evaluates: Executor = self if continuous else inner
        self._sampled = SampledInRun(sampled, blocks.equations, self._evaluates)
        self.continuous = ContinuousInRun(continuous, blocks.equations, inner)
        # Time, states and the indicators' signs there before d or p changed.
        self._before: tuple[float, Vector, Vector] | None = None

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name; outputs of continuous Python blocks change in d."""
        if not self._has_continuous:
            return self._inner.call(name, t, x, d, p)
        self.continuous.refresh(t, x, d, p)
        values = self._inner.call(name, t, x, d, p)
        if name == "derivative":
            self.continuous.rates(t, x, d, p, values)
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

    def watch(self, d: Vector, p: Vector) -> EventWatch | None:
        """Return what finds and handles events while d and p stay the same, if there are any."""
        if not self.has_events:
            return None
        blocks = self.continuous

        def fresh(function: Callable[..., Any]) -> Callable[[float, Vector], Any]:
            def asked(t: float, x: Vector) -> Any:
                blocks.refresh(t, x, d, p)
                return function(t, x, d, p)

            return asked

        return EventWatch(
            indicators=fresh(blocks.indicators),
            accepted=fresh(blocks.accepted),
            handle=fresh(blocks.handle),
            next_time=blocks.next_event,
            before=self._signs_before,
        )

    def before_jump(self, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Keep the indicators' signs: what changed them at one time is one jump."""
        if self.has_events and self._signs_before(t, x) is None:
            self.continuous.refresh(t, x, d, p)
            self._before = t, x.copy(), np.sign(self.continuous.indicators(t, x, d, p))

    def save(self) -> dict[str, Any]:
        """Return what Python blocks keep, and the signs of indicators before a jump at this time."""
        return super().save() | ({} if self._before is None else {JUMP: list(self._before)})

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Give back what was `saved`."""
        super().restore(saved)
        self._before = tuple(saved[JUMP]) if JUMP in saved else None

    def _signs_before(self, t: float, x: Vector) -> Vector | None:
        """Return the signs that were kept at this time with these states, if they were."""
        if self._before is None or self._before[0] != t or not np.array_equal(self._before[1], x):
            return None
        return self._before[2]

    def between(
        self, method: str, times: tuple[float, float, float], x: Vector, d: Vector, p: Vector
    ) -> Vector:
        """Return the state after a step from and to `times` [s], taken in parts if there are events in it."""
        if not self._has_continuous:
            return self._inner.between(method, times, x, d, p)
        watch, between = self.watch(d, p), super().between
        if watch is None:
            return between(method, times, x, d, p)
        t, end, _ = times
        x = watch.begin(t, x)
        while t < end:
            stop, start = min(end, watch.next_time()), x

            def state(time: float, t: float = t, start: Vector = start) -> Vector:
                return between(method, (t, time, time - t), start, d, p)

            x = state(stop)
            if not np.isfinite(x).all():
                return x
            event = watch.after_step(t, stop, x, state)
            t, x = (stop, x) if event is None else (event[0], watch.handle_event(*event))
            x = watch.due(t, x)
        return x

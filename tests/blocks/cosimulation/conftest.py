"""Shared by the tests of co-simulation: blocks that step themselves, as FMUs do."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trussflow.blocks import Block, SelfStepping, Session, Signals, StepDiscardedError
from trussflow.blocks.framework.declarations import Attribute
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.snapshot import Snapshot


class SteppingRun(SelfStepping):
    """A block in a session of its own; what FMUs may or may not do can be switched off."""

    def __init__(self, block: "Stepping") -> None:
        self._restores, self.refreshes = block.restores, block.refreshes
        self.longest = block.longest
        self.session = Session(block.inner, step=block.step)
        self.shown = np.zeros(0)
        self.calls: list[str] = []

    @property
    def restores(self) -> bool:
        return self._restores

    def start(self, time: float, inputs: Vector) -> None:
        self.session.start(inputs=self.named(np.nan_to_num(inputs)), time=time)
        self.shown = self.session.row()

    def close(self) -> None:
        self.calls.append("close")
        self.session.stop()

    def named(self, inputs: Vector) -> dict[str, Any]:
        return dict(
            zip((p.name for p in self.session.prepared.plan.system.root.inputs()), [inputs], strict=True)
        )

    def set(self, inputs: Vector, rates: Vector | None = None) -> None:
        assert rates is None, "it knows no lines"
        self.session.set(self.named(inputs))

    def advance(self, now: float, until: float) -> None:
        assert self.session.time == pytest.approx(now, abs=1e-12)
        if until - now > self.longest + 1e-12:
            raise StepDiscardedError(f"a step of {until - now:g} s is too long")
        self.session.advance(until)
        self.shown = self.session.row()

    def outputs(self) -> Vector:
        return self.session.row() if self.refreshes else self.shown.copy()

    def save(self) -> tuple[Snapshot, Vector]:
        assert self.restores, "the master must not ask"
        return self.session.save(), self.shown

    def restore(self, saved: tuple[Snapshot, Vector]) -> None:
        self.session.restore(saved[0])
        self.shown = saved[1]
        self.calls.append("restore")


class Stepping(Block):
    """A block that steps itself; its runs can be looked at."""

    traced = False
    steps_itself = True

    u = Input("given", unit=Attribute("own_unit"))
    y = Output("taken")

    def __init__(
        self,
        inner: Block,
        step: float,
        *,
        restores: bool = True,
        refreshes: bool = True,
        longest: float = np.inf,
    ) -> None:
        self.inner, self.step, self.restores, self.refreshes = inner, step, restores, refreshes
        self.longest = longest
        self.given, self.taken = inner.port("u").shape, inner.port("y").shape
        self.own_unit = inner.port("u").unit
        self.runs: list[SteppingRun] = []
        super().__init__()

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        return {"y": ("u",) if np.any(self.inner.D) else ()}

    def open(self, p: Signals) -> SteppingRun:
        self.runs.append(SteppingRun(self))
        return self.runs[-1]


@pytest.fixture
def stepping() -> Callable[..., Stepping]:
    return Stepping

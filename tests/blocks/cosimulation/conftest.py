"""Shared by the tests of co-simulation: blocks that step themselves, as FMUs do."""

import numpy as np
import pytest

from trussflow.blocks import Block, SelfStepping, Session, StepDiscardedError
from trussflow.blocks.framework.declarations import Attribute
from trussflow.blocks.framework.port import Input, Output


class SteppingRun(SelfStepping):
    """A block in a session of its own; what FMUs may or may not do can be switched off."""

    def __init__(self, block):
        self._restores, self.refreshes = block.restores, block.refreshes
        self.longest = block.longest
        self.session = Session(block.inner, step=block.step)
        self.shown = np.zeros(0)
        self.calls: list[str] = []

    @property
    def restores(self):
        return self._restores

    def start(self, time, inputs):
        self.session.start(inputs=self.named(np.nan_to_num(inputs)), time=time)
        self.shown = self.session.row()

    def close(self):
        self.calls.append("close")
        self.session.stop()

    def named(self, inputs):
        return dict(
            zip((p.name for p in self.session.prepared.plan.system.root.inputs()), [inputs], strict=True)
        )

    def set(self, inputs, rates=None):
        assert rates is None, "it knows no lines"
        self.session.set(self.named(inputs))

    def advance(self, now, until):
        assert self.session.time == pytest.approx(now, abs=1e-12)
        if until - now > self.longest + 1e-12:
            raise StepDiscardedError(f"a step of {until - now:g} s is too long")
        self.session.advance(until)
        self.shown = self.session.row()

    def outputs(self):
        return self.session.row() if self.refreshes else self.shown.copy()

    def save(self):
        assert self.restores, "the master must not ask"
        return self.session.save(), self.shown

    def restore(self, saved):
        self.session.restore(saved[0])
        self.shown = saved[1]
        self.calls.append("restore")


class Stepping(Block):
    """A block that steps itself; its runs can be looked at."""

    traced = False
    steps_itself = True

    u = Input("given", unit=Attribute("own_unit"))
    y = Output("taken")

    def __init__(self, inner, step, *, restores=True, refreshes=True, longest=np.inf):
        self.inner, self.step, self.restores, self.refreshes = inner, step, restores, refreshes
        self.longest = longest
        self.given, self.taken = inner.port("u").shape, inner.port("y").shape
        self.own_unit = inner.port("u").unit
        self.runs: list[SteppingRun] = []
        super().__init__()

    def feedthrough(self):
        return {"y": ("u",) if np.any(self.inner.D) else ()}

    def open(self, p):
        self.runs.append(SteppingRun(self))
        return self.runs[-1]


@pytest.fixture
def stepping():
    return Stepping

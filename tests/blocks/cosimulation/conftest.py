"""Blocks that step themselves, as FMUs do."""

import numpy as np
import pytest
import systems

from trussflow.blocks import Block, Session
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.run_state import SelfStepping, StepDiscardedError

interpreted = pytest.fixture(scope="module", autouse=True)(systems.interpreted)


class SteppingRun(SelfStepping):
    """A block in a session of its own; optional abilities of FMUs can be switched off."""

    restores = True

    def __init__(self, block):
        self.restores, self.refreshes, self.longest = (
            block.restores,
            block.refreshes,
            block.longest,
        )
        self.session = Session(block.inner, step=block.step)
        self.shown = np.zeros(0)
        self.calls = []

    def start(self, time, inputs):
        self.session.start(inputs={"u": np.nan_to_num(inputs)}, time=time)
        self.shown = self.session.row()

    def close(self):
        self.calls.append("close")
        self.session.stop()

    def set(self, inputs):
        self.session.set({"u": inputs})

    def advance(self, now, until):
        assert self.session.time == pytest.approx(now, abs=1e-12)
        if until - now > self.longest + 1e-12:
            raise StepDiscardedError(f"a step of {until - now:g} s is too long")
        self.session.advance(until)
        self.shown = self.session.row()

    def outputs(self):
        return self.session.row() if self.refreshes else self.shown.copy()

    def save(self):
        assert self.restores
        return self.session.save(), self.shown

    def restore(self, saved):
        self.session.restore(saved[0])
        self.shown = saved[1]
        self.calls.append("restore")


class Stepping(Block):
    """A block that steps itself; its runs can be inspected."""

    traced = False
    steps_itself = True

    u = Input("columns")
    y = Output("rows")

    def __init__(self, inner, step, *, restores=True, refreshes=True, longest=np.inf):
        self.inner, self.step, self.restores, self.refreshes = (
            inner,
            step,
            restores,
            refreshes,
        )
        self.longest = longest
        self.columns, self.rows = inner.u.shape, inner.y.shape
        self.runs = []
        super().__init__()

    def feedthrough(self):
        return {"y": ("u",) if np.any(self.inner.D) else ()}

    def open(self, p):
        self.runs.append(SteppingRun(self))
        return self.runs[-1]


@pytest.fixture
def stepping():
    return Stepping

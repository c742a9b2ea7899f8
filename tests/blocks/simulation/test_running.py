"""The hooks of Python blocks: begun, ended, saved and restored with the run they are in."""

import copy
from typing import Any

import numpy as np
import pytest

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.simulation.simulator import Simulator

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each
STEP = 0.01


class Time(Block):
    y = Output()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        return {"y": t}


class Counter(Block):
    """A Python block that hides a number, and tells when it is begun and ended."""

    traced = False
    u = Input()
    y = Output()

    def __init__(self, *, fails: str = "") -> None:
        self.fails = fails
        self.hidden = {"sum": 0.0}
        self.events: list[str] = []
        super().__init__()

    def on_start(self, p: Signals) -> None:
        self.events.append("start")
        self.hidden["sum"] = 0.0
        self._fail("start")

    def on_stop(self) -> None:
        self.events.append("stop")
        self._fail("stop")

    def on_save(self) -> Any:
        return self.hidden["sum"]

    def on_restore(self, saved: Any) -> None:
        self.hidden["sum"] = saved

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        if t > 0.3:
            self._fail("output")
        return {"y": self.hidden["sum"]}

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        self.hidden["sum"] = self.hidden["sum"] + np.tanh(u.u)
        return {}

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        return {"y": ()}

    def _fail(self, where: str) -> None:
        if self.fails == where:
            raise RuntimeError(f"no {where} today")


class Secretive(Counter):
    """It cannot hand over what it hides."""

    @property
    def restorable(self) -> bool:
        return False


def loop(python: Block) -> Diagram:
    diagram = Diagram("loop")
    time, python = diagram.add(time=Time(), python=python.sampled(0.1))
    time.y >> python.port("u")
    return diagram


@pytest.mark.parametrize("backend", ["numpy", "interpreted"])
def test_hooks_make_a_second_run_equal_to_the_first(backend: str) -> None:
    python = Counter()
    simulator = Simulator(loop(python), step=STEP, backend=backend)
    first, second = simulator.run(0.5), simulator.run(0.5)
    assert python.events == ["start", "stop"] * 2
    assert np.abs(first["python.y"]).max() > 0.1
    np.testing.assert_array_equal(first["python.y"], second["python.y"])


@pytest.mark.parametrize("where", ["start", "output", "stop"])
def test_blocks_are_stopped_whatever_ends_the_run(where: str) -> None:
    """Once each, the block that failed and the one beside it."""
    python, beside = Counter(fails=where), Counter()
    diagram = loop(beside)
    diagram.add(failing=python.sampled(0.1))
    diagram.ground(python.port("u"))
    kind = "on_" * (where != "output") + where
    message = rf"{kind}\(\) of block 'failing' \(Counter\) raised RuntimeError .* no {where} today"
    with pytest.raises(SimulationError, match=message):
        Simulator(diagram, step=STEP, backend="numpy").run(0.5)
    assert python.events == beside.events == ["start", "stop"]
    session = Session(diagram, step=STEP, backend="numpy")
    with pytest.raises(SimulationError, match=message), session:
        session.advance(0.5)
    assert python.events == beside.events == ["start", "stop"] * 2


def test_hidden_memory_cannot_serve_two_runs_at_once() -> None:
    diagram = loop(Counter())
    first, second = (Session(diagram, step=STEP, backend="numpy") for _ in "ab")
    with first:
        with pytest.raises(SimulationError, match=r"block 'python' \(Counter\) runs elsewhere"):
            second.start()
        first.advance(0.1)
    with second:
        second.advance(0.1)
    third = Session(diagram, step=STEP, backend="numpy")
    third.start()
    del third  # a session that is forgotten does not block the others
    first.start()


def test_block_that_cannot_hand_over_its_memory_is_named() -> None:
    assert Counter().restorable
    assert Time().restorable
    with Session(loop(Secretive()), step=STEP, backend="numpy") as session:
        session.advance(0.1)
        with pytest.raises(SimulationError, match=r"cannot save: block 'python' \(Secretive\)"):
            session.save()


def test_hiding_without_saving_is_not_restorable() -> None:
    class Opener(Block):
        def on_start(self, p: Signals) -> None:
            pass

    assert not Opener().restorable


def test_update_is_called_without_declared_states_too() -> None:
    with Session(loop(Counter()), step=STEP, backend="numpy", outputs=["python.y"]) as session:
        session.advance(0.1 + 2 * STEP)
        np.testing.assert_allclose(session.outputs["python.y"], np.tanh(0.0) + 0.0, rtol=ROUND_OFF)
        session.advance(0.2 + STEP)
        np.testing.assert_allclose(session.outputs["python.y"], np.tanh(0.1), rtol=ROUND_OFF)


def test_a_copy_of_a_block_that_runs_is_free() -> None:
    diagram = loop(Counter())
    first = Session(diagram, step=STEP, backend="numpy")
    with first, Session(copy.deepcopy(diagram), step=STEP, backend="numpy") as second:
        for session in (first, second):
            session.advance(0.2)

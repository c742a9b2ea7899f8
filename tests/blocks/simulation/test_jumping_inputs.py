"""Inputs of continuous Python blocks that jump: where an indicator loses its sign, an event."""

import numpy as np
import pytest
from systems import ports, series

from trussflow.blocks import (
    Block,
    Event,
    Input,
    Output,
    PythonFunction,
    Session,
    State,
    Step,
    ZeroOrderHold,
    simulate,
)
from trussflow.blocks.framework.run_state import Running


class RelayRun(Running):
    """A motor whose direction is the sign of its input: y' = +-1, switched by events only."""

    def __init__(self):
        self.direction = 1.0

    def save(self):
        return self.direction

    def restore(self, saved):
        self.direction = saved

    def output(self, t, x, u, p):
        return {"y": x.angle}

    def derivative(self, t, x, u, p):
        return {"angle": np.asarray(self.direction)}

    def indicators(self, t, x, u, p):
        return {"turned": u.u}

    def on_event(self, t, x, u, p, fired):
        self.direction = float(np.sign(u.u))
        return {}


class Relay(Block):
    traced = False
    turned = Event()
    u = Input(default=1.0)
    y = Output()
    angle = State()
    continuous = True

    def open(self, p):
        return RelayRun()

    def feedthrough(self):
        return {"y": ()}


@pytest.mark.parametrize("python", [False, True])
def test_sampled_inputs_that_jump_cause_events(solver, python):
    """Sampled every 0.25 s, a sign that changes at 0.6 s is seen at 0.75 s: 0.75 - 0.25."""
    hold = ZeroOrderHold(0.25)
    if python:
        hold = PythonFunction(lambda u: u, 0.25, **ports(u=(), y=()))
    source = Step(0.6, initial_value=1.0, final_value=-1.0)
    diagram = series(source=source, hold=hold, relay=Relay())
    result = simulate(diagram, 1.0, step=0.05, solver=solver)
    assert result["relay.y"].values[-1] == pytest.approx(0.5, abs=1e-12)


def test_inputs_set_from_outside_that_jump_cause_events(solver):
    """Also right after going back; at the very start they are what the run begins with."""
    with Session(Relay(), step=0.25, solver=solver) as session:

        def check_advance(until, y):
            session.advance(until)
            assert session.outputs["y"] == pytest.approx(y, abs=1e-12)

        session.set(u=-1.0)
        session.set(u=1.0)
        check_advance(0.5, 0.5)
        snapshot = session.save()
        for _ in range(2):
            session.set(u=-1.0)
            check_advance(1.5, -0.5)
            session.set(u=2.0)
            check_advance(2.0, 0.0)
            session.restore(snapshot)
        session.set(u=-1.0)
        session.set(u=3.0)  # never seen
        check_advance(1.0, 1.0)
        session.set(u=-1.0)
        snapshot = session.save()  # the jump is still to be seen
        for _ in range(2):
            check_advance(2.0, 0.0)
            session.restore(snapshot)

"""Steps of FMUs for model exchange in C are equal, bit by bit, to the steps in Python."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import ports, series

from trussflow.blocks import (
    Block,
    Diagram,
    Event,
    Input,
    Mode,
    Output,
    PythonFunction,
    Session,
    Sine,
    Step,
    Sum,
    TimeFunction,
    TransferFunction,
    ZeroOrderHold,
    simulate,
)
from trussflow.blocks.simulation.executor import Executor
from trussflow.blocks.simulation.python_blocks import PythonExecutor
from trussflow.fmu import Fmu, FmuError

END, REQUEST, FATAL, UNREADABLE = 7, 14, 15, 16
"""Faults of ``model.c``; REQUEST: every seventh completedIntegratorStep requests an event."""


class Crossings(Block):
    """A traced block that counts how often its input rises through 0.3."""

    u, y = Input(), Output()
    count, rises = Mode(), Event("rising")

    def output(self, t, x, u, p):
        return {"y": x.count}

    def indicators(self, t, x, u, p):
        return {"rises": u.u - 0.3}

    def on_event(self, t, x, u, p, fired):
        return {"count": x.count + 1.0}


def jump(t):
    """Return a signal that jumps within steps, without events."""
    return np.where(t % 0.3 < 0.155, 0.0, 1.0)


def mixed(make_fmu, exported, version):
    """Return FMUs with events of every kind, in loops with traced and sampled blocks."""
    diagram = Diagram("mixed")
    ball, stair = (Fmu(make_fmu(n, version), kind="me") for n in ("ball", "stair"))
    relay = Fmu(make_fmu("relay", version), kind="me", parameters={"fault": REQUEST})
    rounded = PythonFunction(
        lambda u: np.floor(4 * np.asarray(u)) / 8, 0.5, **ports(u=(), y=())
    )
    diagram.add(ball=ball, stair=stair, relay=relay, rounded=rounded)
    diagram.add(error=Sum("++-"), law=TransferFunction([0.2, 2.0], [0.3, 1.0]))
    diagram.add(hold=ZeroOrderHold(0.25), jump=TimeFunction(jump), total=Sum("++"))
    diagram.add(sine=Sine(frequency=11.0), crossings=Crossings())
    lag = series("step_lag", lag=TransferFunction([1.0], [0.05, 1.0]))
    lag.expose(u=lag.lag.u, y=lag.lag.y)
    plant = Fmu(exported(lag, f"{version}.0"), kind="me")
    diagram.add(deviation=Sum("+-"), plant=plant)
    diagram.sine >> diagram.crossings.u
    diagram.law >> diagram.deviation.u1
    plant.y >> diagram.deviation.u2
    diagram.deviation >> plant.u
    ball.h >> diagram.error.u1
    stair.y >> diagram.error.u2
    relay.x >> diagram.error.u3
    diagram.error >> diagram.law >> relay.u
    relay.x >> diagram.hold >> rounded >> diagram.total.u1
    diagram.jump >> diagram.total.u2
    diagram.total >> relay.d
    diagram.expose(x=relay.x, h=ball.h)
    return diagram


def courses(diagram, solver):
    """Return the log of a run, and the outputs of a session that is tuned, saved and restored."""
    log = simulate(diagram, 2.5, step=0.01, solver=solver)
    with Session(diagram, step=0.01, solver=solver) as session:
        seen = []
        for until in (0.58, 0.59, 0.905, 1.8):
            session.advance(until)
            seen.append(session.outputs)
            if until == 0.58:
                snapshot = session.save()
                session.tune({"ball.g": 4.0})
        session.restore(snapshot)
        session.advance(1.8)
        seen.append(session.outputs)
    return [log[name].values for name in log], [[*s.values()] for s in seen]


@pytest.mark.parametrize("solver", ["rk4", "euler"])
def test_steps_are_equal_with_events_of_every_kind(
    make_fmu, exported, version, solver, monkeypatch
):
    diagram = mixed(make_fmu, exported, version)
    in_c = courses(diagram, solver)
    monkeypatch.setattr(PythonExecutor, "_compiled", lambda *_: None)
    in_python = courses(diagram, solver)
    for kind in range(2):
        for one, other in zip(in_c[kind], in_python[kind], strict=True):
            assert_array_equal(one, other)


def test_python_takes_only_the_steps_with_events(
    make_fmu, exported, version, monkeypatch
):
    """About 60 of the 200 steps have an event; Python also takes up to 16 steps at the start."""
    taken = []

    def between(self, *step):
        taken.append(step[1])
        return usual(self, *step)

    usual = Executor.between
    monkeypatch.setattr(Executor, "between", between)
    simulate(mixed(make_fmu, exported, version), 2.0, step=0.01)
    assert 50 < len(taken) < 80


@pytest.mark.parametrize(
    "fault, message",
    [
        (END, r"asks to end the run at t = 0\.51 s"),
        (FATAL, r"FMU 'relay': fmi\dGet\w*Derivatives returned status 'fatal'"),
        (UNREADABLE, r"FMU 'relay': fmi\dGet(Real|Float64) returned status 'error'"),
    ],
)
def test_faults_in_c_are_those_in_python(
    make_fmu, version, fault, message, monkeypatch
):
    """After an error, another call would end this process."""
    relay = Fmu(make_fmu("relay", version), kind="me", parameters={"fault": fault})
    diagram = series(jump=Step(0.3), hold=ZeroOrderHold(0.1))
    diagram.add(relay=relay)
    diagram.hold >> relay.u
    diagram.ground(relay.d)
    failures = []
    for _ in range(2):
        with pytest.raises(FmuError, match=message) as caught:
            simulate(diagram, 1.0, step=0.01)
        failures.append((str(caught.value), [*caught.value.result["time"]]))
        monkeypatch.setattr(PythonExecutor, "_compiled", lambda *_: None)
    assert failures[0] == failures[1]

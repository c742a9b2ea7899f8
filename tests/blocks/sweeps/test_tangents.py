"""Derivatives of runs with events: against closed forms, and differences of runs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import Ball, ball_height, differences, ring, series

from trussflow.blocks import (
    Block,
    Diagram,
    Event,
    Gain,
    Input,
    Integrator,
    LimitedIntegrator,
    Mode,
    Output,
    Parameter,
    Relay,
    Saturation,
    Sine,
    State,
    UnitDelay,
    gradient,
)
from trussflow.blocks.errors import SimulationError
from trussflow.blocks.simulation.executor import Executor
from trussflow.blocks.simulation.solver import FIXED_STEP


class Charge(Block):
    """Grows, and gives some away after a time that it says itself."""

    rate, y = Input(), Output()
    q, due = State(initial=1.0), State(initial=0.23)
    wait = Parameter(0.4)
    given = Event("time")

    def output(self, t, x, u, p):
        return {"y": x.q}

    def derivative(self, t, x, u, p):
        return {"q": u.rate * x.q, "due": 0.0}

    def indicators(self, t, x, u, p):
        return {"given": x.due}

    def on_event(self, t, x, u, p, fired):
        return {"q": x.q - 0.4, "due": t + p.wait * (1.0 + x.q)}


class Kept(Block):
    """Keeps how fast its input rose through zero, and grows with that."""

    u, y = Input(), Output()
    q, before = State(), State(initial=0.3)
    speed = Mode(0.5)
    pull = Parameter(1.4)
    rises = Event("rising")

    def output(self, t, x, u, p):
        return {"y": x.q}

    def derivative(self, t, x, u, p):
        return {"q": x.speed**2 - 0.1 * x.q, "before": p.pull * (u.u - x.before)}

    def indicators(self, t, x, u, p):
        return {"rises": u.u}

    def on_event(self, t, x, u, p, fired):
        return {"speed": p.pull * (u.u - x.before)}


def kept():
    return series("kept", wave=Sine(2.0, 5.0, phase=-1.0), kept=Kept())


def room():
    return series(ball=Ball(restitution=0.8))


@pytest.mark.parametrize("duration", [0.4, 0.8, 2.0, 3.2])
@pytest.mark.parametrize("step", [0.01, 0.4])
def test_a_ball_has_the_derivatives_of_its_arcs(duration, step, monkeypatch):
    """RK4 follows a parabola exactly: what is left is round-off, and the differences of the closed form."""
    # also on a slow computer
    monkeypatch.setattr(Executor, "span_seconds", 0.0)
    at = {"ball.restitution": 0.8, "ball.gravity": 10.0, "ball.z": 1.0}
    value, by = gradient(
        room(), duration, lambda run: run["ball.height"][-1], at, step=step
    )
    assert value == pytest.approx(ball_height(duration)[0], abs=1e-12)
    names = {
        "ball.restitution": "restitution",
        "ball.gravity": "gravity",
        "ball.z": "start",
    }
    for name, word in names.items():
        there = [
            ball_height(duration, **{word: at[name] + k * 1e-5})[0]
            for k in (-2, -1, 1, 2)
        ]
        exact = np.dot([1.0, -8.0, 8.0, -1.0], there) / 12e-5
        assert by[name] == pytest.approx(exact, rel=1e-8, abs=1e-9), name


def thermostat():
    diagram = Diagram("thermostat")
    relay, level, loss = diagram.add(
        relay=Relay(0.5, -0.5, on=-1.0, off=1.2), level=Integrator(0.1), loss=Gain(-0.3)
    )
    level >> relay
    level >> loss
    (relay.y + loss.y) >> level
    return diagram


def saturated():
    diagram = Diagram("saturated")
    wave, limit, level, stop = diagram.add(
        wave=Sine(2.0, 3.0),
        limit=Saturation(-1.1, 0.7),
        level=Integrator(0.2),
        stop=LimitedIntegrator(lower=-0.3, upper=0.4),
    )
    wave >> limit >> level
    level >> stop
    return diagram


def charged():
    return ring(charge=Charge(), growth=Gain(0.7), late=UnitDelay(0.1, 0.5))


def delayed():
    """Return a relay that a sampled value switches: at an instant, which does not move."""
    diagram = Diagram("delayed")
    relay, late, level = diagram.add(
        relay=Relay(0.3, -0.3, on=-1.0, off=1.2),
        late=UnitDelay(0.1),
        level=Integrator(0.1),
    )
    level >> late >> relay
    (relay.y - level.y) >> level
    return diagram


def bounced():
    """Return a ball whose height is sampled, and moves something else."""
    diagram = room()
    late, level = diagram.add(late=UnitDelay(0.06), level=Integrator())
    diagram.ball.height >> late >> level
    return diagram


CASES = [
    (
        thermostat,
        "level.y",
        {"level.integral": 0.1, "relay.on": -1.0, "loss.gain": -0.3},
    ),
    (saturated, "level.y", {"wave.amplitude": 2.0, "level.integral": 0.2}),
    (saturated, "stop.y", {"wave.amplitude": 2.0, "level.integral": 0.2}),
    (
        charged,
        "charge.y",
        {"charge.wait": 0.4, "growth.gain": 0.7, "charge.q": 1.0, "charge.due": 0.23},
    ),
    (delayed, "level.y", {"level.integral": 0.1, "relay.off": 1.2}),
    (
        kept,
        "kept.y",
        {
            "kept.pull": 1.4,
            "wave.amplitude": 2.0,
            "wave.phase": -1.0,
            "kept.before": 0.3,
        },
    ),
    (bounced, "level.y", {"ball.restitution": 0.8, "ball.z": 1.0}),
]


@pytest.mark.parametrize("solver", FIXED_STEP)
@pytest.mark.parametrize(
    "build, signal, at", CASES, ids=lambda value: getattr(value, "__name__", "")
)
def test_events_agree_with_differences(build, signal, at, solver):
    settings = {"step": 0.02, "solver": solver, "log_step": 0.1}
    value, by = gradient(build(), 2.5, lambda run: run[signal], at, **settings)
    expected, slopes = differences(
        build(), 2.5, lambda run: run[signal], at, 1e-6, **settings
    )
    assert_allclose(value, expected, rtol=1e-12, atol=1e-13)
    for name, slope in slopes.items():
        assert np.abs(slope).max() > 1e-3
        assert_allclose(by[name], slope, rtol=2e-5, atol=2e-8, err_msg=name)


def test_where_there_is_no_derivative_it_is_said():
    """Two balls arrive together, and the order of their bounces decides."""
    diagram = Diagram("two")
    diagram.add(one=Ball(), two=Ball())
    with pytest.raises(
        SimulationError,
        match=r"'two'.* at t = 0\.44\d* s .*one.* and .*two.* happen at the same time",
    ):
        gradient(
            diagram, 1.0, lambda run: run["one.height"][-1], {"one.z": 1.0}, step=0.01
        )


class Counted(Ball):
    """A ball whose bounces are two events that are always one."""

    click = Event("falling")

    def indicators(self, t, x, u, p):
        return {"floor": x.z, "click": x.z}


def test_events_that_are_one_move_as_one():
    both = series(ball=Counted(restitution=0.8))
    found = [
        gradient(
            diagram, 0.9, lambda run: run["ball.height"][-1], {"ball.z": 1.0}, step=0.01
        )
        for diagram in (both, room())
    ]
    assert found[0] == found[1]

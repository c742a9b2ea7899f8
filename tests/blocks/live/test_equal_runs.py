"""Runs in the browser are those of `simulate`, bit by bit, but for rounding in the C library."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import Ball, Counter, DrivenPendulum, Oscillator

from trussflow.blocks import (
    PID,
    Block,
    Constant,
    Diagram,
    DiscretePID,
    Function,
    Gain,
    Input,
    Integrator,
    MatrixGain,
    Noise,
    Output,
    Parameter,
    Pulse,
    Ramp,
    Relay,
    Sine,
    State,
    StateMachine,
    StateSpace,
    Step,
    Table,
    TimeTable,
    TransferFunction,
    UnitDelay,
)
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram


def pid():
    diagram = Diagram("pid")
    step, law, plant = diagram.add(
        step=Step(0.5, initial_value=0.0, final_value=1.0),
        pid=PID(12.0, 6.0, 4.0, lower=-50.0, upper=50.0),
        plant=TransferFunction([1.0], [1.0, 0.8, 2.0]),
    )
    step >> law.reference
    plant >> law.measurement
    law >> plant
    return diagram, ["plant.y", "pid.y"], {"pid.kp": 7.25}


def events():
    diagram = Diagram("events")
    diagram.add(ball=Ball(restitution=0.93))
    return diagram, ["ball.height", "ball.speed"], {"ball.restitution": 0.95}


def hysteresis():
    diagram = Diagram("hysteresis")
    relay, heat = diagram.add(
        relay=Relay(0.1, -0.1, on=-1.0, off=1.0), heat=Integrator()
    )
    heat >> relay >> heat
    return diagram, ["heat.y", "relay.y"], {"relay.on": -2.0}


def sampled():
    diagram = Diagram("sampled")
    goal, law, plant, _ = diagram.add(
        goal=Pulse(4.0, 0.5, high=1.0),
        law=DiscretePID(3.0, 1.0, 0.2, sample_time=0.05),
        plant=StateSpace([[-1.0, 0.3], [0.0, -2.0]], [[0.0], [1.0]], [[1.0, 0.0]]),
        count=Counter().sampled(0.07, 0.03),
    )
    goal >> law.reference
    plant.y[0] >> law.measurement
    law.y >> plant.u[0]
    return diagram, ["plant.y", "law.y", "count.y"], {"law.kp": 5.0}


def solved_loop():
    bus = Diagram("bus", loops="solve")
    power, load, battery = bus.add(
        power=Ramp(20.0, unit="W"),
        load=Function(
            lambda power, v: power / v,
            {"power": Input(), "v": Input(unit="V")},
            {"i": Output(unit="A")},
        ),
        battery=Function(
            lambda i: 28.0 - 0.5 * i, {"i": Input(unit="A")}, {"v": Output(unit="V")}
        ),
    )
    power >> load.power
    load >> battery
    battery >> load.v
    bus.guess(battery.v, 28.0)
    return bus, ["battery.v", "load.i"], {"power.slope": 15.0}


def noise():
    diagram = Diagram("noise")
    wind, lag = diagram.add(
        wind=Noise([1.0, 0.5, 2.0], 0.02, seed=3), lag=Integrator(np.zeros(3))
    )
    wind >> lag
    return diagram, ["wind.y", "lag.y"], {"wind.standard_deviation[1]": 4.0}


def tables():
    diagram = Diagram("tables")
    time, curve, integral = diagram.add(
        time=TimeTable([0.0, 2.0, 5.0, 9.0], [0.0, 3.0, -1.0, 0.5]),
        curve=Table([-1.0, 0.0, 1.0, 3.0], [2.0, 0.1, -0.7, 4.0]),
        integral=Integrator(),
    )
    time >> curve >> integral
    return diagram, ["time.y", "curve.y", "integral.y"], {"integral.initial_value": 1.5}


def delays():
    diagram = Diagram("delays")
    goal, lag, before = diagram.add(
        goal=Pulse(3.0, 0.4, high=2.0), lag=Integrator(), before=UnitDelay(0.1)
    )
    (goal.y - before.y) >> lag >> before
    return diagram, ["lag.y", "before.y"], {"goal.high": 3.0}


def machine():
    diagram = Diagram("machine")
    go, near, logic = diagram.add(
        go=Pulse(2.0, 0.3, high=1.0),
        near=Pulse(3.0, 0.5, high=1.0),
        logic=StateMachine(
            {"idle": {"go": "move"}, "move": {"near": "idle"}}, sample_time=0.1
        ),
    )
    go >> logic.go
    near >> logic.near
    return diagram, ["logic.mode", "logic.active"], {"go.high": 0.2}


class Settled(Block):
    """A lag that starts where its input is, and an initial state from a parameter."""

    u, y = Input(), Output()
    x, z = State(), State(initial="start")
    start = Parameter(2.0)

    def initial_state(self, u, p):
        return {"x": u.u * p.start}

    def output(self, t, x, u, p):
        return {"y": x.x + x.z}

    def derivative(self, t, x, u, p):
        return {"x": u.u - x.x, "z": -x.z * x.z}


def initial():
    diagram = Diagram("initial")
    source, scale, lag = diagram.add(
        source=Constant(3.0), scale=Gain(0.7), lag=Settled()
    )
    source >> scale >> lag
    return diagram, ["lag.y"], {"lag.start": 0.3}


def many():
    diagram = Diagram("many")
    a = np.random.default_rng(1).normal(size=(8, 8)) - 4.0 * np.eye(8)
    matrix, x = diagram.add(matrix=MatrixGain(a), x=Integrator(np.ones(8)))
    x >> matrix >> x
    return diagram, ["x.y", "matrix.y"], {"x.initial_value[3]": 2.0}


def sine():
    diagram = Diagram("sine")
    source, pendulum, spring = diagram.add(
        source=Sine(2.0, 0.5), pendulum=DrivenPendulum(), spring=Oscillator()
    )
    source >> pendulum.drive
    source >> spring
    diagram.ground(pendulum.wind)
    return diagram, ["pendulum.measured", "spring.y"], {"spring.damping": 0.3}


EXACT = [
    pid,
    events,
    hysteresis,
    sampled,
    solved_loop,
    tables,
    delays,
    machine,
    initial,
    many,
]
ROUNDED = [noise, sine]
"""Diagrams with logarithms and sines, which differ between C libraries in the last bit."""


def compare(window, unfused, tmp_path, make):
    """Yield the rows of the page and of `simulate`, with default parameters and with another value."""
    diagram, log, changed = make()
    (name, value), settings = next(iter(changed.items())), {"step": 0.01, "log": log}
    file = diagram.live(
        tmp_path / "page.html", signals=log, parameters=[name], duration=9.5, step=0.01
    )
    window.open(file)
    yield window.rows(), unfused(diagram, 9.5, **settings)
    window.set(name, value)
    if "[" in name:
        name, _, index = name.rstrip("]").partition("[")
        values = np.ones(8) if make is many else np.array([1.0, 0.5, 2.0])
        values[int(index)] = value
        value = values
    yield (window.rows(), unfused(diagram, 9.5, **settings, parameters={name: value}))
    assert not window.complaints
    assert not window.trouble()


@pytest.mark.parametrize("make", EXACT)
def test_runs_are_equal_bit_by_bit(make, window, unfused, tmp_path):
    for found, expected in compare(window, unfused, tmp_path, make):
        for one, other in zip(found, expected, strict=True):
            assert_array_equal(one, other)


@pytest.mark.parametrize("make", ROUNDED)
def test_runs_with_functions_of_the_c_library_are_equal_to_round_off(
    make, window, unfused, tmp_path
):
    for found, expected in compare(window, unfused, tmp_path, make):
        assert_array_equal(found[0], expected[0])
        assert_allclose(found[1], expected[1], rtol=0.0, atol=1e-13)


@pytest.mark.campaign
def test_the_loop_of_the_paper_is_equal_bit_by_bit(window, unfused, tmp_path):
    log = ["truss.task_position", "truss.modal_coordinate", "controller.error"]
    loop = transport_diagram(Mission.of_case(1), SpaceTruss.published())
    settings = {"step": 2e-3}
    window.open(
        loop.live(tmp_path / "page.html", signals=log, duration=5.0, **settings)
    )
    window.wait("trussflowLive.run.progress === undefined")
    expected = unfused(loop, 5.0, log=log, **settings)
    for one, other in zip(window.rows(), expected, strict=True):
        assert_array_equal(one, other)

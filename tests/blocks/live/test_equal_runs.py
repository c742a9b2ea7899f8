"""Runs in the browser are those of `simulate`, bit by bit, but for rounding in the C library."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from random_diagrams import build
from systems import Ball, Counter, Level, assert_near, cubic, series

from trussflow.blocks import (
    Constant,
    Diagram,
    DiscretePID,
    Gain,
    Integrator,
    Noise,
    Parameter,
    Pulse,
    Ramp,
    Relay,
    State,
    StateSpace,
    TransportDelay,
    VariableDelay,
)
from trussflow.blocks.errors import TrussflowError
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram


def events():
    diagram = series(ball=Ball(restitution=0.93))
    return diagram, ["ball.height", "ball.speed"], ("ball.restitution", 0.95)


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
    return diagram, ["plant.y", "law.y", "count.y"], ("law.kp", 5.0)


def solved_loop():
    diagram = cubic()
    diagram.guess(diagram.bent.y, 0.7)
    return diagram, ["state.y", "bent.y"], ("state.initial_value", -2.0)


def noise():
    diagram = series(
        wind=Noise([1.0, 0.5, 2.0], 0.02, seed=3), lag=Integrator(np.zeros(3))
    )
    return diagram, ["wind.y", "lag.y"], ("wind.standard_deviation[1]", 4.0)


def delays():
    diagram = Diagram("delays")
    relay, late, heat, slope, later = diagram.add(
        relay=Relay(0.1, -0.1, on=-1.0, off=1.0),
        late=TransportDelay(0.237),
        heat=Integrator(),
        slope=Ramp(0.1, initial_value=0.4),
        later=VariableDelay(0.1, 3.0),
    )
    heat >> relay >> late >> heat
    heat >> later.u
    slope >> later.tau
    return diagram, ["heat.y", "later.y"], ("relay.on", -2.0)


class Settled(Level):
    """A lag that starts where its input is, and an initial state from a parameter."""

    z = State(initial="start")
    start = Parameter(2.0)

    def initial_state(self, u, p):
        return {"x": u.u * p.start}

    def output(self, t, x, u, p):
        return {"y": x.x + x.z}

    def derivative(self, t, x, u, p):
        return {"x": u.u - x.x, "z": -x.z * x.z}


def initial():
    diagram = series("initial", source=Constant(3.0), scale=Gain(0.7), lag=Settled())
    return diagram, ["lag.y"], ("lag.start", 0.3)


@pytest.mark.parametrize("make", [events, sampled, solved_loop, initial, noise, delays])
def test_runs_are_equal_bit_by_bit(make, window, unfused, tmp_path):
    diagram, log, (name, value) = make()
    settings = {"signals": log, "parameters": [name], "duration": 9.5, "step": 0.01}
    window.open(diagram.live(tmp_path / "page.html", **settings))
    # The logarithms of noise differ between C libraries in the last bit.
    limit = 1e-13 if make is noise else 0.0
    for change in ({}, {name: value}):
        for _ in change:
            window.set(name, value)
        if make is noise and change:
            change = {"wind.standard_deviation": [1.0, value, 2.0]}
        expected = unfused(diagram, 9.5, step=0.01, log=log, parameters=change)
        for one, other in zip(window.rows(), expected, strict=True):
            assert_near(one, other, limit)
    assert not window.complaints
    assert not window.trouble()


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore::trussflow.blocks.errors.SimulationWarning")
def test_random_diagrams_are_equal_to_round_off(window, unfused, tmp_path):
    compared = 0
    for seed in range(40):
        diagram = build(seed)
        log = [p.path for b in diagram.blocks.values() for p in b.outputs()]
        try:
            time, rows = unfused(diagram, 2.0, step=0.01, log=log)
            file = diagram.live(
                tmp_path / "page.html", signals=log, duration=2.0, step=0.01
            )
        except TrussflowError:
            continue
        window.open(file)
        found = window.rows()
        assert_array_equal(found[0], time)
        assert_allclose(found[1], rows, rtol=1e-9, atol=1e-9, err_msg=str(seed))
        compared += 1
    assert compared > 15


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

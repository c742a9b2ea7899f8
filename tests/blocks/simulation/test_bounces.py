"""A ball whose speed alone turns round bounces, as in textbooks: height zero is met to round-off only."""

from typing import Any

import numpy as np
import pytest

from trussflow.blocks import (
    Block,
    Diagram,
    Event,
    Output,
    Parameter,
    Session,
    SimulationError,
    State,
    UnitDelay,
    simulate,
)

GRAVITY, RESTITUTION = 9.81, 0.7
FIRST = np.sqrt(2.0 / GRAVITY)
SOLVERS: list[dict[str, Any]] = [
    {"step": 0.005},
    {"step": 0.005, "solver": "euler"},
    {"step": 0.005, "backend": "numpy"},
    {"step": 0.05, "backend": "interpreted"},
    {"solver": "RK45", "rtol": 1e-10, "atol": 1e-12},
]


class Ball(Block):
    height = Output()
    z = State(initial=1.0)
    v = State()
    bounces = State(initial=0.0)
    floor = Parameter(0.0)
    bounce = Event("falling")

    def output(self, t, x, u, p):
        return {"height": x.z}

    def derivative(self, t, x, u, p):
        return {"z": x.v, "v": -GRAVITY, "bounces": 0.0}

    def indicators(self, t, x, u, p):
        return {"bounce": x.z - p.floor}

    def on_event(self, t, x, u, p, fired):
        return {"v": -RESTITUTION * x.v, "bounces": x.bounces + 1.0}


class PythonBall(Ball):
    traced = False


def room(kind=Ball, **own):
    diagram = Diagram("room")
    diagram.add(ball=kind(**own))
    return diagram


def height_after(time):
    """Return the exact height, dropped from 1 m, and how often the ball has bounced."""
    if time < FIRST:
        return 1.0 - GRAVITY * time**2 / 2.0, 0
    speed, begun, bounces = RESTITUTION * GRAVITY * FIRST, FIRST, 1
    while begun + 2.0 * speed / GRAVITY < time:
        begun += 2.0 * speed / GRAVITY
        speed, bounces = RESTITUTION * speed, bounces + 1
    return speed * (time - begun) - GRAVITY * (time - begun) ** 2 / 2.0, bounces


@pytest.mark.parametrize("kind", [Ball, PythonBall])
@pytest.mark.parametrize("settings", SOLVERS, ids=str)
@pytest.mark.parametrize("floor", [0.0, -123.0])
def test_heights_are_exact(kind, settings, floor):
    if kind is PythonBall and "backend" in settings:
        pytest.skip("Python blocks have no backend")
    initial = {"ball.z": floor + 1.0}
    run = simulate(room(kind, floor=floor), 2.4, log_step=0.05, initial=initial, **settings)
    exact = [height_after(t)[0] for t in run["time"].values]
    off = 0.1 if settings.get("solver") == "euler" else 1e-7
    np.testing.assert_allclose(run["ball.height"].values - floor, exact, atol=off, rtol=0.0)


@pytest.mark.parametrize("settings", [s for s in SOLVERS if s.get("solver") != "euler"], ids=str)
def test_bounces_that_end_nowhere_are_an_error(settings):
    """They follow each other ever faster, up to 2.559 s; the ball does not go through the floor."""
    with pytest.raises(SimulationError, match=r"events without end at t = 2\.55[89]"):
        simulate(room(), 4.0, **settings)


def test_a_sample_at_the_very_bounce_is_no_second_one():
    """With a speed of 1 from height 1 and no gravity the floor is met at 1 s, where others sample."""

    class Glider(Ball):
        def derivative(self, t, x, u, p):
            return {"z": x.v, "v": 0.0, "bounces": 0.0}

    for height in np.linspace(0.9, 1.1, 21):
        diagram = room(Glider)
        held = diagram.add(held=UnitDelay(0.01))
        diagram.blocks["ball"].height >> held
        initial = {"ball.z": height, "ball.v": -1.0}
        run = simulate(diagram, 2.0, step=0.01, initial=initial, log=["ball.height"])
        end = RESTITUTION * (2.0 - height)
        assert run["ball.height"].values[-1] == pytest.approx(end, rel=1e-9)


def test_a_session_that_stands_at_a_bounce_goes_on_from_it():
    session = Session(room(), step=0.005)
    session.start()
    for time in np.arange(1, 23) * 0.1:
        session.advance(float(time))
        session.restore(session.save())
        exact, bounces = height_after(float(time))
        assert session.states()[[0, 2]] == pytest.approx([exact, bounces], rel=0.0, abs=1e-7)

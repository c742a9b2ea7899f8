"""A ball whose speed alone turns round bounces, as in textbooks: height zero is met to round-off only."""

import numpy as np
import pytest
import systems
from systems import assert_near, series

from trussflow.blocks import Parameter, Session, Simulator, UnitDelay, simulate
from trussflow.blocks.errors import SimulationError

GRAVITY, RESTITUTION = 9.81, 0.7
FALL_TIME = np.sqrt(2.0 / GRAVITY)
SOLVERS = [
    {"step": 0.005},
    {"step": 0.005, "solver": "euler"},
    {"step": 0.05, "backend": "numpy"},
    {"step": 0.05, "backend": "interpreted"},
    {"solver": "RK45", "rtol": 1e-10, "atol": 1e-12},
]


class Ball(systems.Ball):
    level = Parameter(0.0, unit="m")

    def indicators(self, t, x, u, p):
        return {"floor": x.z - p.level}

    def on_event(self, t, x, u, p, fired):
        return {"v": -p.restitution * x.v, "bounces": x.bounces + 1.0}


class PythonBall(Ball):
    traced = False


def room(kind=Ball, gravity=GRAVITY, **parameters):
    return series(ball=kind(gravity=gravity, restitution=RESTITUTION, **parameters))


def height_after(time):
    """Return the exact height, dropped from 1 m, and how often the ball has bounced."""
    if time < FALL_TIME:
        return 1.0 - GRAVITY * time**2 / 2.0, 0
    speed, begun, bounces = RESTITUTION * GRAVITY * FALL_TIME, FALL_TIME, 1
    while begun + 2.0 * speed / GRAVITY < time:
        begun += 2.0 * speed / GRAVITY
        speed, bounces = RESTITUTION * speed, bounces + 1
    return speed * (time - begun) - GRAVITY * (time - begun) ** 2 / 2.0, bounces


@pytest.mark.parametrize(
    "kind, settings",
    [*((Ball, s) for s in SOLVERS), *((PythonBall, SOLVERS[i]) for i in (0, 1, 4))],
)
@pytest.mark.parametrize("level", [0.0, -123.0])
def test_heights_are_exact(kind, settings, level):
    run = simulate(
        room(kind, level=level, start=level + 1.0), 2.4, log_step=0.05, **settings
    )
    exact = [height_after(t)[0] for t in run["time"].values]
    tolerance = 0.1 if settings.get("solver") == "euler" else 1e-7
    assert_near(run["ball.height"].values - level, exact, tolerance)


@pytest.mark.parametrize("settings", [SOLVERS[i] for i in (0, 3, 4)], ids=str)
def test_bounces_that_end_nowhere_are_an_error(settings):
    """They follow each other ever faster, up to 2.559 s; the ball does not go through the floor."""
    with pytest.raises(
        SimulationError, match=r"at t = 2\.55[89].* ball that bounces ever lower"
    ):
        simulate(room(), 4.0, **settings)


def test_a_sample_at_the_very_bounce_is_no_second_one():
    """With a speed of 1 from height 1 and no gravity the floor is met at 1 s, where others sample."""
    diagram = room(gravity=0.0)
    held = diagram.add(held=UnitDelay(0.01))
    diagram.ball.height >> held
    simulator = Simulator(diagram, step=0.01, log=["ball.height"])
    for height in np.linspace(0.9, 1.1, 21):
        run = simulator.run(2.0, initial={"ball.z": height, "ball.v": -1.0})
        end = RESTITUTION * (2.0 - height)
        assert run["ball.height"].values[-1] == pytest.approx(end, rel=1e-9)


def test_a_session_that_stands_at_a_bounce_goes_on_from_it():
    session = Session(room(), step=0.005, outputs=["ball.height", "ball.bounces"])
    session.start()
    for time in np.arange(1, 23) * 0.1:
        session.advance(time)
        session.restore(session.save())
        exact, bounces = height_after(time)
        assert [*session.outputs.values()] == pytest.approx([exact, bounces], abs=1e-7)

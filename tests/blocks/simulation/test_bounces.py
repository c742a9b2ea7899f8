"""A ball whose speed alone turns round bounces, as in textbooks: height zero is met to round-off only."""

from itertools import product

import numpy as np
import pytest
import systems
from systems import assert_near, ball_height, series

from trussflow.blocks import Parameter, Session, Simulator, UnitDelay, simulate
from trussflow.blocks.errors import SimulationError
from trussflow.blocks.simulation.adaptive import METHODS
from trussflow.blocks.simulation.solver import BACKENDS

GRAVITY, RESTITUTION = 9.81, 0.7
TIGHT = {"rtol": 1e-10, "atol": 1e-12, "log_step": 0.05}
FIXED = [
    {"step": 0.005},
    {"step": 0.005, "solver": "euler"},
    {"step": 0.4},  # more than some flights take
    {"step": 0.05, "backend": "numpy"},
    {"step": 0.05, "backend": "interpreted"},
]
SOLVERS = [
    *FIXED,
    *(TIGHT | {"solver": s, "backend": b} for s in METHODS for b in BACKENDS),
]


class Ball(systems.Ball):
    level = Parameter(0.0, unit="m")

    def indicators(self, t, x, u, p):
        return {"floor": x.z - p.level}

    def on_event(self, t, x, u, p, fired):
        return {"v": -p.restitution * x.v, "bounces": x.bounces + 1.0}


class PythonBall(Ball):
    traced = False


class LandedBall(PythonBall):
    """It leaves the floor at exactly zero."""

    def on_event(self, t, x, u, p, fired):
        return super().on_event(t, x, u, p, fired) | {"z": p.level}


def room(kind=Ball, gravity=GRAVITY, **parameters):
    return series(ball=kind(gravity=gravity, restitution=RESTITUTION, **parameters))


@pytest.mark.parametrize(
    "kind, settings",
    [
        *product([Ball], SOLVERS),
        *product([PythonBall], [*FIXED, *SOLVERS[5::3]]),
        *product([LandedBall], [{"step": 0.4}, SOLVERS[5]]),
    ],
)
@pytest.mark.parametrize("level", [0.0, -123.0])
def test_heights_are_exact(kind, settings, level):
    run = simulate(room(kind, level=level, start=level + 1.0), 2.4, **settings)
    exact = [ball_height(t, RESTITUTION, GRAVITY)[0] for t in run["time"].values]
    tolerance = 0.1 if settings.get("solver") == "euler" else 1e-7
    assert_near(run["ball.height"].values - level, exact, tolerance)


@pytest.mark.parametrize("settings", [SOLVERS[i] for i in (0, 4, 5)], ids=str)
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
        exact, bounces = ball_height(time, RESTITUTION, GRAVITY)
        assert [*session.outputs.values()] == pytest.approx([exact, bounces], abs=1e-7)

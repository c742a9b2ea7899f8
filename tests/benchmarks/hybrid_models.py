"""Five systems with events: diagrams, three of them of examples, and the equations for the peers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from math import atan, copysign, cos, pi, sin
from pathlib import Path
from runpy import run_path

import numpy as np
from scipy.integrate import solve_ivp

from trussflow.blocks import Block, Diagram, Event, Mode, Output, State

ROOT = Path(__file__).parents[2]
GRAVITY = 9.81
RTOL, ATOL = 1e-8, 1e-10
Floats = Sequence[float]


@dataclass(frozen=True)
class Hybrid:
    """A system with events, as a diagram and as functions of time, states x and modes m.

    Attributes
    ----------
    diagram : Diagram
        In trussflow.
    states : tuple of str
        Its continuous states by path, in the order of x.
    duration, step : float
        How long it runs, and steps of RK4 in trussflow [s].
    x, modes : tuple of float
        At the start.
    rates, indicator, event : callable
        dx/dt; what rises through zero at an event; states and modes after it.
    """

    diagram: Diagram
    states: tuple[str, ...]
    duration: float
    step: float
    x: tuple[float, ...]
    modes: tuple[float, ...]
    rates: Callable[[float, Floats, Floats], Floats]
    indicator: Callable[[float, Floats, Floats], float]
    event: Callable[[float, Floats, Floats], tuple[Floats, Floats]]


class Engine(Block):
    """A crank with friction and compression; each spark sets the torque of the half turn that follows."""

    speed = Output(unit="rad/s")
    angle = State(unit="rad")
    rate = State(initial=50.0, unit="rad/s")
    following, torque = Mode(np.pi, unit="rad"), Mode(unit="N*m")
    spark = Event("rising")

    def output(self, t, x, u, p):
        """Return the speed."""
        return {"speed": x.rate}

    def derivative(self, t, x, u, p):
        """Return speed and acceleration."""
        push = x.torque * (1 + np.cos(2 * x.angle))
        return {
            "angle": x.rate,
            "rate": push - 0.2 * x.rate - 20 * np.sin(x.angle) ** 2,
        }

    def indicators(self, t, x, u, p):
        """Return how far the crank is beyond the next half turn."""
        return {"spark": x.angle - x.following}

    def on_event(self, t, x, u, p, fired):
        """Ignite, with a governor for the torque."""
        return {"following": x.following + np.pi, "torque": 40 - x.rate / 20}


class Ball(Block):
    """A ball above a floor."""

    height = Output(unit="m")
    z, v = State(initial=1.0, unit="m"), State(initial=5.0, unit="m/s")
    bounce = Event("falling")

    def output(self, t, x, u, p):
        """Return the height."""
        return {"height": x.z}

    def derivative(self, t, x, u, p):
        """Fall."""
        return {"z": x.v, "v": -GRAVITY}

    def indicators(self, t, x, u, p):
        """Return the height."""
        return {"bounce": x.z}

    def on_event(self, t, x, u, p, fired):
        """Bounce."""
        return {"z": 0.0, "v": -0.95 * x.v}


MASS, SPRING, DAMPER, FRICTION, TOP, TURNS = (
    20.0,
    70.0,
    10.0,
    1.5 * 20.0 * GRAVITY,
    2.0,
    2 * pi / 50.0,
)
CAR, RADIUS, INERTIA, LOAD, TORQUE = 1500.0, 0.3, 1.0, 1500.0 * GRAVITY / 4, 2000.0
LOSS, HEATING = 0.45, 5.0


def alone(block, name):
    """Return a block in a diagram."""
    diagram = Diagram(name)
    diagram.add(name, block)
    return diagram


def example(path, name):
    """Return the diagram of an example, by its name there."""
    with redirect_stdout(StringIO()):
        return run_path(str(ROOT / path))[name]


def engine_rates(t, x, m):
    """Return speed and acceleration of the crank."""
    return x[1], m[1] * (1 + cos(2 * x[0])) - 0.2 * x[1] - 20 * sin(x[0]) ** 2


def pull(t, x):
    """Return what friction has to bear while the box moves as the belt [N]."""
    return (
        SPRING * x + DAMPER * TOP * sin(TURNS * t) + MASS * TOP * TURNS * cos(TURNS * t)
    )


def box_rates(t, x, m):
    """Return the velocities of the box."""
    force = -pull(t, x[0]) - DAMPER * x[1] - m[0] * FRICTION
    return x[1] + TOP * sin(TURNS * t), force / MASS if m[0] else 0.0


def box_event(t, x, m):
    """Begin to slip, or stick; or slip the other way, where it cannot stick."""
    force = pull(t, x[0])
    if m[0] and abs(force) <= FRICTION:
        return (x[0], 0.0), (0.0,)
    return (x[0], 0.0), (-copysign(1.0, force),)


def car_rates(t, x, m):
    """Return the accelerations of car and wheel."""
    friction = LOAD * sin(1.9 * atan(10.0 * (x[0] - RADIUS * x[1]) / x[0]))
    return -friction / CAR, (RADIUS * friction - m[0]) / INERTIA


def car_indicator(t, x, m):
    """Return how far the slip is beyond the level where the brake changes."""
    slip = (x[0] - RADIUS * x[1]) / x[0]
    return slip - 0.17 if m[0] else 0.13 - slip


HYBRIDS = {
    "engine": Hybrid(
        alone(Engine(), "engine"), ("engine.angle", "engine.rate"), 10.0, 1e-3, (0.0, 50.0), (pi, 0.0),
        engine_rates,
        lambda t, x, m: x[0] - m[0],
        lambda t, x, m: (x, (m[0] + pi, 40 - x[1] / 20)),
    ),
    "thermostat": Hybrid(
        example("tests/peers/thermostat.py", "room"), ("T.integral",), 30.0, 1e-2, (15.0,), (HEATING,),
        lambda t, x, m: (LOSS * (15.0 - x[0]) + m[0],),
        lambda t, x, m: x[0] - 25.0 if m[0] else 23.0 - x[0],
        lambda t, x, m: (x, (HEATING - m[0],)),
    ),
    "stick and slip": Hybrid(
        example("examples/peers/stick_slip.py", "bench"), ("box.x", "box.slide"), 100.0, 1e-2, (0.0, 0.0), (0.0,),
        box_rates,
        lambda t, x, m: -m[0] * x[1] if m[0] else abs(pull(t, x[0])) - FRICTION,
        box_event,
    ),
    "anti-lock brakes": Hybrid(
        example("examples/peers/anti_lock_brakes.py", "car"),
        ("v.integral", "w.integral"), 5.0, 2e-4, (30.0, 30.0 / RADIUS), (TORQUE,),
        car_rates,
        car_indicator,
        lambda t, x, m: (x, (TORQUE - m[0],)),
    ),
    "bouncing ball": Hybrid(
        alone(Ball(), "ball"), ("ball.z", "ball.v"), 20.0, 1e-2, (1.0, 5.0), (),
        lambda t, x, m: (x[1], -GRAVITY),
        lambda t, x, m: -x[0],
        lambda t, x, m: ((0.0, -0.95 * x[1]), ()),
    ),
}  # fmt: skip


def by_hand(case, method="RK45", rtol=RTOL, atol=ATOL):
    """Return a run with SciPy, from event to event."""

    def run():
        t, x = 0.0, np.array(case.x)
        m = case.modes

        def rates(t, x):
            return case.rates(t, x, m)

        def happens(t, x):
            return float(case.indicator(t, x, m))

        happens.terminal, happens.direction = True, 1
        while t < case.duration:
            found = solve_ivp(
                rates,
                (t, case.duration),
                x,
                method,
                events=happens,
                rtol=rtol,
                atol=atol,
            )
            t, x = float(found.t[-1]), found.y[:, -1]
            if found.status == 1:
                after, m = case.event(t, x.tolist(), m)
                x = np.array(after)
        return x

    return run

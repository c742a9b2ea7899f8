"""An engine whose spark is an event at each half turn, as a block and with SciPy from event to event."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from trussflow.blocks import Block, Diagram, Event, Mode, Output, State

DURATION = 10.0


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


def engine():
    """Return the engine in a diagram."""
    diagram = Diagram("engine")
    diagram.add(engine=Engine())
    return diagram


def engine_by_hand():
    """Integrate from spark to spark; return the speed at the end [rad/s]."""
    t, x, following, torque = 0.0, np.array([0.0, 50.0]), np.pi, 0.0
    while t < DURATION:

        def rates(_t, x, torque=torque):
            push = torque * (1 + np.cos(2 * x[0]))
            return x[1], push - 0.2 * x[1] - 20 * np.sin(x[0]) ** 2

        def spark(_t, x, following=following):
            return float(x[0] - following)

        spark.terminal = True
        found = solve_ivp(rates, (t, DURATION), x, events=spark, rtol=1e-8, atol=1e-10)
        t, x = float(found.t[-1]), found.y[:, -1]
        following, torque = following + np.pi, 40 - x[1] / 20
    return float(x[1])

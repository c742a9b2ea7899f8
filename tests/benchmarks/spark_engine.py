"""An engine whose spark is an event at each half turn, as a block."""

from __future__ import annotations

import numpy as np

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

"""A pendulum held upright: a block of its own, a loop around it, a run. Change what you like."""

import numpy as np

from trussflow.blocks import (
    PD,
    Block,
    Constant,
    Diagram,
    Input,
    Output,
    Parameter,
    Signals,
    State,
    simulate,
)
from trussflow.blocks.support.types import Array


class Pendulum(Block):
    """A mass on a rod, with a torque at the joint; the angle is zero where it stands upright."""

    torque = Input(unit="N*m", meaning="at the joint")
    angle = Output(unit="rad", meaning="from upright")
    rate = Output(unit="rad/s")
    q = State(unit="rad", initial=0.5)
    w = State(unit="rad/s")
    mass = Parameter(1.0, unit="kg", above=0.0)
    length = Parameter(0.5, unit="m", above=0.0)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> dict[str, Array]:
        """Return what can be measured."""
        return {"angle": x.q, "rate": x.w}

    def derivative(
        self, t: Array, x: Signals, u: Signals, p: Signals
    ) -> dict[str, Array]:
        """Return rate and acceleration."""
        gravity = 9.81  # m/s^2
        return {
            "q": x.w,
            "w": gravity / p.length * np.sin(x.q) + u.torque / (p.mass * p.length**2),
        }


loop = Diagram("upright")
goal, rest, law, pendulum = loop.add(
    goal=Constant(0.0, unit="rad"),
    rest=Constant(0.0, unit="rad/s"),
    law=PD(20.0, 3.0, unit="rad", force_unit="N*m"),  # N*m/rad, N*m*s/rad
    pendulum=Pendulum(),
)
goal >> law.reference_position
rest >> law.reference_velocity
pendulum.angle >> law.position
pendulum.rate >> law.velocity
law.force >> pendulum.torque
loop.expose(angle=pendulum.angle)  # what an FMU of it shows

if __name__ == "__main__":
    print(simulate(loop, 10.0, step=1e-2))

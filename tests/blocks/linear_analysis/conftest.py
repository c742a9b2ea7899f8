"""A system to trim."""

import numpy as np
import pytest

from trussflow.blocks import Block, Diagram, Input, Output, Parameter, State


class Aircraft(Block):
    """Speed, path angle and height of a point mass: thrust and lift are what one can choose."""

    thrust = Input(unit="N")
    lift = Input(unit="N")
    climb = Output(unit="m/s")
    speed = State(unit="m/s", initial=80.0)
    angle = State(unit="rad")
    height = State(unit="m", initial=1000.0)
    mass = Parameter(1000.0, unit="kg", above=0.0)

    def output(self, t, x, u, p):
        return {"climb": x.speed * np.sin(x.angle)}

    def derivative(self, t, x, u, p):
        drag = 0.05 * x.speed**2 + 1e-5 * u.lift**2 / 10
        weight = p.mass * 9.81
        return {
            "speed": (u.thrust - drag - weight * np.sin(x.angle)) / p.mass,
            "angle": (u.lift - weight * np.cos(x.angle)) / (p.mass * x.speed),
            "height": x.speed * np.sin(x.angle),
        }


@pytest.fixture(name="aircraft")
def aircraft_fixture():
    diagram = Diagram("aircraft")
    body = diagram.add(body=Aircraft())
    diagram.expose(thrust=body.thrust, lift=body.lift, climb=body.climb)
    return diagram

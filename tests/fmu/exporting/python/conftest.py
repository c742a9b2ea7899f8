"""A controlled pendulum and its export by pythonfmu."""

from itertools import count

import numpy as np
import pytest
from systems import HiddenSum

from trussflow.blocks import (
    INFERRED,
    Block,
    Diagram,
    Input,
    Output,
    Parameter,
    PythonFunction,
    State,
)
from trussflow.fmu.exporting.export import export as fmu_export

TIME_STEP = 1e-3


class Pendulum(Block):
    """Two pendulums, stiff as the user likes."""

    torque = Input((2,), unit="N*m")
    angle = Output((2,), unit="rad", meaning="from the vertical")
    load = Output((2,), unit="N*m")
    q = State((2,), initial="release", unit="rad")
    v = State((2,), unit="rad/s")
    release = Parameter((0.3, -0.2), (2,), unit="rad", meaning="angle at the start")
    stiffness = Parameter(9.0, above=0.0, unit="N*m")

    def output(self, t, x, u, p):
        return {"angle": x.q, "load": u.torque - p.stiffness * np.sin(x.q)}

    def derivative(self, t, x, u, p):
        return {
            "q": x.v,
            "v": u.torque - p.stiffness * np.sin(x.q) + 0.1 * np.cos(3 * t),
        }


class Controller(Block):
    """A sampled law with memory, and a port that takes the unit of its source."""

    goal = Input((2,), unit="rad")
    angle = Input((2,), unit=INFERRED)
    torque = Output((2,), unit="N*m")
    total = State((2,))
    gain = Parameter(2.0)

    def output(self, t, x, u, p):
        return {"torque": p.gain * (u.goal - u.angle) + x.total}

    def update(self, t, x, u, p):
        return {"total": x.total + 0.1 * (u.goal - u.angle)}


TORQUE_LIMIT = 0.4


def limited(torque):
    """Cut off what is beyond a global of the user's file, as no tracer can follow."""
    for i in range(2):
        if abs(torque[i]) > TORQUE_LIMIT:
            torque = torque.copy()
            torque[i] = np.sign(torque[i]) * TORQUE_LIMIT
    return torque


def loop(*, python):
    """Return a controlled pendulum, with Python blocks in the loop or without."""
    diagram = Diagram("loop")
    law, plant = diagram.add(law=Controller().sampled(0.02), plant=Pendulum())
    plant.angle >> law.angle
    diagram.expose(goal=law.goal, angle=plant.angle, load=plant.load, torque=law.torque)
    if not python:
        law.torque >> plant.torque
        return diagram
    limit, total = diagram.add(
        limit=PythonFunction(
            limited,
            0.02,
            inputs={"torque": Input((2,), unit="N*m")},
            outputs={"y": Output((2,), unit="N*m")},
        ),
        total=HiddenSum(2).sampled(0.05),
    )
    law.torque >> limit.torque
    limit.y >> plant.torque
    plant.angle >> total.u
    diagram.expose(sum=total.y)
    return diagram


@pytest.fixture(scope="session")
def export(tmp_path_factory):
    """Return a function that exports a block to a file of its own."""
    numbers = count()

    def exported(item, **settings):
        path = tmp_path_factory.mktemp("fmu") / f"it_{next(numbers)}.fmu"
        return fmu_export(item, path, kind="python", **({"step": TIME_STEP} | settings))

    return exported


@pytest.fixture(scope="session")
def make_loop():
    """Return a function that builds the controlled pendulum."""
    return loop


@pytest.fixture(scope="session", params=["traced", "python"])
def loop_fmu(request, export):
    """Return the FMU of the controlled pendulum, with Python blocks and without."""
    return export(
        loop(python=request.param == "python"), parameters={"plant.stiffness": 7.0}
    )

"""A controlled pendulum and its export by pythonfmu."""

from itertools import count

import numpy as np
import pytest
from systems import Controller, HiddenSum, Pendulum

from trussflow.blocks import Diagram, Input, Output, PythonFunction
from trussflow.fmu.exporting.export import export as fmu_export

TIME_STEP = 1e-3


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

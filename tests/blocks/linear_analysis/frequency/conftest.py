"""A nonlinear loop whose response is estimated."""

import numpy as np
import pytest
from systems import ports

from trussflow.blocks import Diagram, Function, StateSpace


@pytest.fixture(name="pendulum")
def pendulum_fixture():
    """Return a damped pendulum under a torque, with a rate feedback that saturates softly."""
    diagram = Diagram("pendulum")
    inertia, gravity, law = diagram.add(
        inertia=StateSpace([[0, 1], [0, 0]], [[0], [1]], np.eye(2)),
        gravity=Function(lambda x, u: u - 4 * np.sin(x[0:1]), **ports(x=2, u=1, y=1)),
        law=Function(
            lambda x, d: d - 2.0 * np.tanh(x[1:2]) - 0.3 * x[0:1] ** 2,
            **ports(x=2, d=1, y=1),
        ),
    )
    inertia >> gravity.x
    inertia >> law.x
    law >> gravity.u
    gravity >> inertia
    diagram.expose(torque=law.d, y=inertia.y)
    return diagram

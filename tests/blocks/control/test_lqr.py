"""Linear-quadratic regulators as blocks: closed-loop poles of the design."""

import control
import numpy as np
import pytest
from systems import assert_near

from trussflow.blocks import Diagram, from_control, linearize, lqr

ROUND_OFF = 1e-9
PLANT = control.ss([[0.0, 1.0], [2.0, -0.3]], [[0.0, 0.1], [1.0, 0.0]], np.eye(2), 0.0)
ONE = control.ss([[0.0, 1.0], [2.0, -0.3]], [[0.0], [1.0]], np.eye(2), 0.0)


@pytest.mark.parametrize("system", [PLANT, ONE, control.c2d(PLANT, 0.1)])
def test_regulated_poles_are_those_of_the_design(system):
    weights = np.diag([3.0, 1.0]), np.eye(system.ninputs)
    d = Diagram("regulated")
    plant, law = d.add(plant=from_control(system), law=lqr(system, *weights))
    plant >> law
    if system.ninputs == 1:
        law >> plant.u[0]
    else:
        law >> plant.u
    d.expose(y=plant.y)
    K = (control.lqr if system.isctime() else control.dlqr)(system, *weights)[0]
    poles = np.linalg.eigvals(system.A - system.B @ K)
    found = linearize(d, [plant.u], [plant.y])
    assert_near(
        np.sort_complex(np.linalg.eigvals(found.A)), np.sort_complex(poles), ROUND_OFF
    )
    assert law.y.shape == (() if len(K) == 1 else (2,))

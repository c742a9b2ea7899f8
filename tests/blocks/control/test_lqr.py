"""Linear-quadratic regulators as blocks: closed-loop poles and steady states of the design."""

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose

from trussflow.blocks import (
    Constant,
    Diagram,
    Integrator,
    from_control,
    linearize,
    lqr,
    simulate,
)

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
    assert_allclose(
        np.sort_complex(np.linalg.eigvals(found.A)),
        np.sort_complex(poles),
        rtol=0,
        atol=ROUND_OFF,
    )
    assert law.y.shape == (() if len(K) == 1 else (2,))


@pytest.mark.parametrize("system", [ONE, control.c2d(ONE, 0.05)])
def test_integral_action_reaches_the_reference(system):
    """With a load that a proportional law would leave an error against."""
    d = Diagram("followed")
    law = d.add(
        "law", lqr(system, np.diag([1.0, 1.0, 4.0]), [[1.0]], integral=[[1.0, 0.0]])
    )
    rate, angle = d.add(rate=Integrator(), angle=Integrator())
    (law.y + 2.0 * angle.y - 0.3 * rate.y + 0.7) >> rate >> angle
    angle >> law.state[0]
    rate >> law.state[1]
    d.add("reference", Constant([1.5])) >> law.reference
    result = simulate(d, 20.0, step=0.01)
    # of the slowest pole
    assert_allclose(result["angle.y"][-1], 1.5, rtol=0, atol=1e-6)

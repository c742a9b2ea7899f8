"""The controller's model: inverse dynamics undo the plant's dynamics."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near, relative_error, respond

from trussflow.blocks.framework.declarations import Signals
from trussflow.models import NominalModel, SpaceTruss
from trussflow.models.dynamics.task_space import (
    task_drift,
    task_force_to_body,
    task_velocity,
    to_body,
)
from trussflow.models.geometry.attitude import EULER, QUATERNION

RNG = np.random.default_rng(5)


@pytest.fixture(scope="module")
def truss():
    return SpaceTruss.consistent()


def state(truss):
    """Return random coordinates and speeds."""
    q = truss.dynamics.rest + 0.3 * RNG.standard_normal(truss.n)
    return q, 0.1 * RNG.standard_normal(truss.n)


def actuation_of(commanded):
    return np.linalg.lstsq(
        commanded["actuation_matrix"], commanded["generalized_force"], rcond=None
    )[0]


def test_commanded_acceleration_comes_out(truss):
    """With Q for u, the plant's x_1'' is a + J_g (d - d̂) (Eqs. 45, 53-55)."""
    model = NominalModel(truss.dynamics)
    q, v = state(truss)
    wanted, correction, estimate = RNG.standard_normal((3, truss.rigid))
    commanded = respond(
        model,
        coordinates=q,
        speeds=v,
        feedforward=wanted,
        feedback=correction,
        disturbance_estimate=estimate,
    )
    x = Signals("x", {"q": q, "v": v})
    u = Signals("u", {"actuation": actuation_of(commanded)})
    p = Signals("p", truss.parameters)
    acceleration = truss.derivative(np.float64(0), x, u, p)["v"][: truss.rigid]
    disturbance = truss.output(np.float64(0), x, u, p)["disturbance"]
    speeds = v[: truss.rigid]
    achieved = acceleration - (disturbance - estimate)
    expected = to_body(EULER, q, wanted + correction - task_drift(EULER, q, speeds))
    # cond(G) ~ 1e8
    assert_near(achieved, expected, 1e-7 * np.abs(acceleration).max())


def test_nominal_acceleration_is_that_of_the_forward_model(truss):
    """G^-1 (u - c) from the actuation equals what the inverse dynamics started from."""
    model, rigid = NominalModel(truss.dynamics), truss.rigid
    q, v = state(truss)
    wanted, estimate = RNG.standard_normal((2, truss.rigid))
    commanded = respond(
        model,
        coordinates=q,
        speeds=v,
        feedforward=wanted,
        disturbance_estimate=estimate,
    )
    terms = truss.dynamics.evaluate(q, v)
    force = (
        terms.actuation_matrix[:rigid] @ actuation_of(commanded) - terms.bias[:rigid]
    )
    computed = np.linalg.solve(terms.mass_matrix[:rigid, :rigid], force)
    assert relative_error(computed, commanded["nominal_acceleration"]) < 1e-7


def test_parts_add_up(truss):
    model = NominalModel(truss.dynamics)
    q, v = state(truss)
    found = respond(
        model, coordinates=q, speeds=v, feedback=RNG.standard_normal(truss.rigid)
    )
    total = found["feedforward_force"] + found["feedback_force"]
    assert np.allclose(found["generalized_force"], total, rtol=1e-12, atol=1e-12)
    assert_array_equal(
        found["full_actuation_matrix"][: truss.rigid], found["actuation_matrix"]
    )


@pytest.fixture(params=[EULER, QUATERNION], ids=lambda kind: kind.name)
def kind(request):
    return request.param


def position(kind):
    """Return a place and a turned attitude."""
    return np.concatenate(
        [
            [1.0, 2.0, 3.0],
            kind.integrate(np.array(kind.rest), np.array([0.3, -0.4, 0.8])),
        ]
    )


def test_task_drift_is_the_rate_of_the_task_velocity(kind):
    """J_g' x_2 against central differences of J_g(t) x_2 along the motion."""
    q, speeds, h = position(kind), RNG.standard_normal(8), 1e-5
    rates = np.concatenate([np.zeros(3), kind.rates(q[3:], speeds[3:6])])
    ahead, behind = (task_velocity(kind, q + step * rates, speeds) for step in (h, -h))
    drift = task_drift(kind, q, speeds)
    assert_near(drift, (ahead - behind) / (2 * h), 1e-9)  # h² terms
    assert_array_equal(drift[6:], np.zeros(2))


def test_task_force_does_the_same_work(kind):
    """x_2 · J_g^T f = (J_g x_2) · f, and to_body is the inverse of J_g."""
    q, force, task_rate = position(kind), *RNG.standard_normal((2, 9))
    speeds = to_body(kind, q, task_rate)
    assert_near(task_velocity(kind, q, speeds), task_rate, 1e-14)
    work = speeds @ task_force_to_body(kind, q, force)
    assert work == pytest.approx(task_rate @ force, rel=1e-12)

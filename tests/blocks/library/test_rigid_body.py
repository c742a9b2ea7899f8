"""A rigid body: conserved quantities, exact spins, and forces that turn with it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import assert_near

from trussflow.blocks import RigidBody

FOURTH_ORDER = 1e-8
"""RK4 with steps of 5 ms at 2 rad/s."""


@pytest.fixture
def run(respond):
    def response(body, duration, **inputs):
        return respond(body, duration, {"step": 5e-3}, **inputs)

    return response


def test_momentum_and_energy_without_torque(run):
    """It tumbles about the intermediate axis."""
    J = np.array([[1.0, 0.1, 0.0], [0.1, 2.0, -0.2], [0.0, -0.2, 3.0]])
    result = run(RigidBody(2.0, J, rate=[0.1, 2.0, 0.1]), 20.0)
    R, w = result["block.rotation"].values, result["block.rate"].values
    momentum = np.einsum("tij,jk,tk->ti", R, J, w)
    assert_near(momentum - momentum[0], 0.0, 1e-7)
    energy = np.einsum("ti,ij,tj->t", w, J, w) / 2
    assert_allclose(energy, energy[0], rtol=1e-8)
    assert_near(np.linalg.norm(result["block.attitude"], axis=1), 1.0, FOURTH_ORDER)
    assert_near(R @ R.transpose(0, 2, 1) - np.eye(3), 0.0, 1e-12)
    assert w[:, 1].min() < -1.5  # it has turned over


def test_force_turns_with_the_body(run):
    """A thrust along the body's x while it spins about z at 2 rad/s: a circle of velocity."""
    body = RigidBody(2.0, [1.0, 1.0, 2.0], rate=[0.0, 0.0, 2.0], gravity=[0, 0, -1.0])
    result = run(body, 3.0, force=[4.0, 0.0, 0.0])
    t = result["time"].values
    attitude = np.column_stack([np.cos(t), 0 * t, 0 * t, np.sin(t)])
    assert_near(result["block.attitude"], attitude, FOURTH_ORDER)
    velocity = np.column_stack([np.sin(2 * t), 1 - np.cos(2 * t), -t])
    assert_near(result["block.velocity"], velocity, FOURTH_ORDER)
    position = np.column_stack(
        [(1 - np.cos(2 * t)) / 2, t - np.sin(2 * t) / 2, -(t**2) / 2]
    )
    assert_near(result["block.position"], position, FOURTH_ORDER)


def test_torque_spins_it_up(run):
    result = run(RigidBody(1.0, np.diag([1.0, 2.0, 4.0])), 1.0, torque=[0.0, 3.0, 0.0])
    assert_near(result["block.rate"][-1], [0.0, 1.5, 0.0], FOURTH_ORDER)
    half = 0.75 / 2  # rad
    attitude = [np.cos(half), 0, np.sin(half), 0]
    assert_near(result["block.attitude"][-1], attitude, FOURTH_ORDER)

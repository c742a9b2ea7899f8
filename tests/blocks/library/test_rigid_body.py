"""A rigid body: what it conserves, exact spins, and forces that turn with it."""

import numpy as np
import pytest

from trussflow.blocks import Constant, Diagram, ParameterError, RigidBody, simulate

FOURTH_ORDER = 1e-8
"""RK4 with steps of 5 ms at 2 rad/s."""


def run(body, duration, **inputs):
    d = Diagram("space")
    d.add("body", body)
    for name, value in inputs.items():
        d.add(name, Constant(value)) >> body.port(name)
    return simulate(d, duration, step=5e-3, progress=False)


def test_momentum_and_energy_without_torque():
    """About the intermediate axis, where it tumbles."""
    J = np.array([[1.0, 0.1, 0.0], [0.1, 2.0, -0.2], [0.0, -0.2, 3.0]])
    result = run(RigidBody(2.0, J, rate=[0.1, 2.0, 0.1]), 20.0)
    R, w = result["body.rotation"].values, result["body.rate"].values
    momentum = np.einsum("tij,jk,tk->ti", R, J, w)
    np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), rtol=0, atol=1e-7)
    energy = np.einsum("ti,ij,tj->t", w, J, w) / 2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)
    np.testing.assert_allclose(
        np.linalg.norm(result["body.attitude"], axis=1), 1.0, rtol=0, atol=FOURTH_ORDER
    )
    np.testing.assert_allclose(
        R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), rtol=0, atol=1e-12
    )
    assert w[:, 1].min() < -1.5  # it has turned over


def test_spin_about_an_axis_is_exact():
    result = run(RigidBody(1.0, [1.0, 1.0, 2.0], rate=[0.0, 0.0, 2.0]), 3.0)
    t = result["time"].values
    expected = np.column_stack([np.cos(t), 0 * t, 0 * t, np.sin(t)])
    np.testing.assert_allclose(result["body.attitude"], expected, rtol=0, atol=FOURTH_ORDER)


def test_force_turns_with_the_body():
    """A thrust along the body's x while it spins about z at 2 rad/s: a circle of velocity."""
    result = run(
        RigidBody(2.0, [1.0, 1.0, 2.0], rate=[0.0, 0.0, 2.0], gravity=[0, 0, -1.0]),
        3.0,
        force=[4.0, 0.0, 0.0],
    )
    t = result["time"].values
    velocity = np.column_stack([np.sin(2 * t), 1 - np.cos(2 * t), -t])
    np.testing.assert_allclose(result["body.velocity"], velocity, rtol=0, atol=FOURTH_ORDER)
    position = np.column_stack([(1 - np.cos(2 * t)) / 2, t - np.sin(2 * t) / 2, -(t**2) / 2])
    np.testing.assert_allclose(result["body.position"], position, rtol=0, atol=FOURTH_ORDER)


def test_torque_spins_it_up():
    result = run(RigidBody(1.0, np.diag([1.0, 2.0, 4.0])), 1.0, torque=[0.0, 3.0, 0.0])
    np.testing.assert_allclose(result["body.rate"][-1], [0.0, 1.5, 0.0], rtol=0, atol=FOURTH_ORDER)
    angle = 0.75
    np.testing.assert_allclose(
        result["body.attitude"][-1], [np.cos(angle / 2), 0, np.sin(angle / 2), 0], rtol=0, atol=FOURTH_ORDER
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mass": 0.0, "inertia": np.eye(3)}, "'mass' of RigidBody is 0.0; it must be above 0"),
        (
            {"mass": 1.0, "inertia": [1.0, 1.0, -1.0]},
            "the inertia of RigidBody must be symmetric and positive",
        ),
        ({"mass": 1.0, "inertia": [[1, 1, 0], [0, 1, 0], [0, 0, 1]]}, "must be symmetric"),
        ({"mass": 1.0, "inertia": np.eye(3), "attitude": [1, 1, 0, 0]}, "must be a unit quaternion"),
    ],
)
def test_nonsense_is_refused(arguments, message):
    with pytest.raises(ParameterError, match=message):
        RigidBody(**arguments)

"""Accelerometers measure the second derivative of the position of their point."""

from dataclasses import replace

import numpy as np
import pytest
from systems import simulate_block

from trussflow.blocks import Constant, Signals
from trussflow.blocks.errors import BlockError
from trussflow.models import Hardware, Measurement, SpaceTruss, arm_terms
from trussflow.models.geometry.rotation import euler_rate_matrix, euler_rotation
from trussflow.models.hardware.accelerations import PointAccelerations
from trussflow.models.robots.hand_motion import hand_motion


def places(dynamics, q):
    """Return where grasp points and bases are (robots, 2, 3), and their axes (robots, 2, 3, 3)."""
    rotation, still, rigid = (
        euler_rotation(q[3:6]),
        np.zeros(6),
        dynamics.rigid_coordinates,
    )
    points, axes = [], []
    for i, arm in enumerate(dynamics.arms):
        hand = hand_motion(
            dynamics.modes.data, i, q[rigid:], still, 0 * q[rigid:], exact=True
        )
        angles = q[6 + 7 * i : 13 + 7 * i]
        terms = arm_terms(
            arm, angles, 0 * angles, hand.rotation, hand.position, still, still
        )
        points.append(
            [q[:3] + rotation @ hand.position, q[:3] + rotation @ terms.base_position]
        )
        axes.append([rotation, rotation @ terms.base_rotation])
    return np.array(points), np.array(axes)


def test_acceleration_is_that_of_the_place():
    """On a path that turns, folds the arms and bends the truss; the error falls as the sample squared."""
    dynamics = SpaceTruss.consistent(arm="jaco").dynamics
    rng = np.random.default_rng(4)
    start, reach = rng.uniform(-0.5, 0.5, (2, dynamics.coordinates))

    def path(t):
        return start + reach * np.sin(t)

    def signals(t):
        q, rates = path(t), reach * np.cos(t)
        linear, turning = (
            euler_rotation(q[3:6]).T @ rates[:3],
            euler_rate_matrix(q[3:6]) @ rates[3:6],
        )
        return Signals(
            "u",
            {"coordinates": q, "speeds": np.concatenate([linear, turning, rates[6:]])},
        )

    time, small, errors = 0.3, 1e-3, []
    before, now, after = (
        places(dynamics, path(time + k * small))[0] for k in (-1, 0, 1)
    )
    inertial = (before - 2 * now + after) / small**2
    expected = np.einsum("rkji,rkj->rki", places(dynamics, path(time))[1], inertial)
    none = Signals("p", {})
    for sample in (0.04, 0.02, 0.01):
        block = PointAccelerations(dynamics, sample)
        state = Signals(
            "x", block.update(np.float64(0), none, signals(time - sample / 2), none)
        )
        found = block.output(np.float64(0), state, signals(time + sample / 2), none)
        errors.append(
            np.abs(np.stack([found["grasp"], found["base"]], axis=1) - expected).max()
        )
    assert np.abs(expected).max() > 0.1
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(slopes, 2.0, rtol=0, atol=0.1)


def test_sensors_may_have_accelerometers():
    """At rest they show their noise; every axis its own."""
    truss = SpaceTruss.published(modes=2)
    hardware = replace(
        Hardware.flight(), accelerometer=Measurement(sample_time=0.1, noise=1e-3)
    )
    sensors = hardware.sensors(truss, seed=1)
    sources = {
        "coordinates": Constant(truss.dynamics.rest),
        "speeds": Constant(np.zeros(truss.n)),
    }
    log = [sensors.grasp_acceleration, sensors.base_acceleration]
    result = simulate_block(sensors, 20.0, sources, step=0.02, log=log, log_step=0.1)
    for port in log:
        values = result[f"block.{port.name}"].values[:-1].reshape(200, 12)
        np.testing.assert_allclose(
            values.std(axis=0), 1e-3, rtol=4.5 / np.sqrt(400), atol=0
        )


def test_sample_time_must_make_sense():
    with pytest.raises(
        BlockError, match=r"cannot sample 'PointAccelerations' every 0.0 s"
    ):
        PointAccelerations(SpaceTruss.published(modes=0).dynamics, 0.0)

"""Measured quaternions: an attitude, turned by noise about each axis of the truss."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from systems import assert_near, simulate_block

from trussflow.blocks import Constant
from trussflow.models import Hardware, SpaceTruss

NOISE = 1e-3  # rad
SAMPLES = 4000
# four standard deviations of an estimated standard deviation
SCATTER = 4.0 / np.sqrt(2.0 * SAMPLES)


@pytest.mark.parametrize("attitude", [(1.0, 0.0, 0.0, 0.0), (0.1, -0.7, 0.5, -0.5)])
def test_noise_is_a_small_turn_about_each_axis(attitude):
    truss = SpaceTruss.consistent(modes=0).with_quaternion().turned(np.array(attitude))
    q, speeds = truss.parameters["initial_coordinates"], np.zeros(truss.n)
    speeds[3:6] = 0.1, 0.2, 0.3
    sensors = Hardware.exact(1.0, noise=NOISE).sensors(truss, seed=2)
    log = [sensors.task_position, sensors.task_velocity]
    sources = {"coordinates": Constant(q), "speeds": Constant(speeds)}
    run = simulate_block(sensors, SAMPLES, sources, step=1.0, log=log)
    numbers = run["block.task_position"].values[1:, 3:7]
    assert np.abs(np.linalg.norm(numbers, axis=1) - 1.0).max() < 1e-15
    true = Rotation.from_quat(np.roll(attitude, -1))
    errors = (true.inv() * Rotation.from_quat(np.roll(numbers, -1, axis=1))).as_rotvec()
    covariance = np.cov(errors.T) / NOISE**2
    assert_near(covariance, np.eye(3), 2.0 * SCATTER)
    assert np.abs(errors.mean(axis=0)).max() < 4.0 * NOISE / np.sqrt(SAMPLES)
    assert (
        np.abs(run["block.task_velocity"].values[1:, 3:6] - speeds[3:6]).max()
        < 6.0 * NOISE
    )  # along body axes

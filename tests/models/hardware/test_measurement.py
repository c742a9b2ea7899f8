"""Sensors and drives: errors, delays, limits, and friction."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import assert_near, simulate_block

from trussflow.blocks import Constant, Ramp
from trussflow.blocks.errors import TrussflowError
from trussflow.models import Joint, JointDrives, Measurement


def watch(measurement, source, size, duration, **settings):
    """Return the signal of a sensor, and the true one, at its samples."""
    settings = {
        "step": measurement.sample_time,
        "backend": "numpy",
        "log": ["block.y", "u_source.y"],
    } | settings
    result = simulate_block(
        measurement.sensor(size, seed=3), duration, {"u": source}, **settings
    )
    return result["block.y"].values, result["u_source.y"].values


def test_noise_is_white_and_has_the_deviation_asked_for():
    measured, true = watch(
        Measurement(sample_time=0.1, noise=1e-4),
        Constant(np.full(100, 7.0)),
        100,
        100.0,
    )
    error = (measured - true)[:-1] / 1e-4
    count = error.size
    assert error.var() == pytest.approx(1.0, abs=4 * np.sqrt(2 / count))
    assert abs(error.mean()) < 4 / np.sqrt(count)
    assert abs(np.mean(error[1:] * error[:-1])) < 4 / np.sqrt(count)
    assert abs(np.mean(error[:, 1:] * error[:, :-1])) < 4 / np.sqrt(count)


def gyro_rate(channels, duration, **law):
    """Return the rate that gyros at rest measure."""
    measurement = Measurement(sample_time=0.1, **law)
    return watch(measurement, Constant(np.zeros(channels)), channels, duration)[0][:-1]


def test_a_gyro_obeys_its_data_sheet():
    """Angle random walk N √t of the integrated rate; a bias B of its own, with correlation time τ."""
    rate = gyro_rate(1000, 10.0, noise=0.01 / np.sqrt(0.1))
    angle = rate.sum(axis=0) * 0.1
    assert angle.std() == pytest.approx(0.01 * np.sqrt(10.0), rel=4 / np.sqrt(2000))
    bias, time = 0.02, 0.5
    walk = {"random_walk": bias * np.sqrt(2.0 / time), "correlation_time": time}
    rate = gyro_rate(1000, 10.0, initial_bias=bias, **walk)
    assert_allclose(rate.std(axis=1), bias, rtol=4 / np.sqrt(2000))
    assert np.mean(rate[:-5] * rate[5:]) / bias**2 == pytest.approx(
        np.exp(-1), abs=0.02
    )
    rate = gyro_rate(50, 2.0, initial_bias=bias)
    # without a correlation time the bias stays
    assert_array_equal(rate[0], rate[-1])
    assert rate.std() == pytest.approx(bias, rel=0.4)


def test_an_encoder_counts_steps_of_a_turn():
    step = 2 * np.pi / 256
    encoder = Measurement(sample_time=0.1, quantum=step)
    measured, true = watch(encoder, Ramp([0.5, -0.3]), 2, 20.0)
    assert_near(measured, true, step / 2 * (1 + 1e-9))
    assert_near(measured / step, np.rint(measured / step), 1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.04, 0.1, 0.25])
def test_a_sample_is_shown_after_the_delay(delay):
    measurement = Measurement(sample_time=0.1, delay=delay)
    measured, _ = watch(measurement, Ramp([1.0]), 1, 2.0, step=0.01)
    ticks, late = np.arange(201), round(delay * 100)
    expected = np.where(ticks < late, 0.0, (ticks - late) // 10 * 0.1)
    assert_near(measured[:, 0], expected, 1e-12)


def test_drives_limit_torque_and_rub():
    joints = [Joint(name) for name in "abcd"]
    drives = JointDrives(joints, torque=0.3, viscous=0.2, coulomb=0.05, transition=1e-3)
    sources = {
        "command": Constant([1.0, -1.0, 0.1, 1.0]),
        "rate": Constant([0.0, 0.5, -0.5, 0.5]),
        "effectiveness": Constant([1.0, 1.0, 0.5, 0.0]),
    }
    result = simulate_block(drives, 0.1, sources, step=0.1)
    assert_near(
        result["block.torque"][0], [0.3, -0.3 - 0.15, 0.05 + 0.15, -0.15], 1e-12
    )


@pytest.mark.parametrize(
    "settings, message",
    [
        ({"sample_time": 0.0}, "a measurement: sample_time is 0; it must be above 0"),
        ({"noise": -1.0}, "a measurement: noise is -1; it must be at least 0"),
        ({"delay": -0.1}, r"a measurement: delay is -0.1; it must be at least 0"),
        (
            {"correlation_time": 0.0},
            "a measurement: correlation_time is 0; it must be above 0",
        ),
        ({"delay": 0.012345678}, r"cannot delay samples of 0.1 s by 0.0123457 s"),
    ],
)
def test_errors_of_measurements(settings, message):
    with pytest.raises(TrussflowError, match=message):
        Measurement(**{"sample_time": 0.1} | settings).sensor(1, seed=1)


@pytest.mark.parametrize(
    "joints, torque, message",
    [
        ([Joint("a")], -0.3, r"'maximum' of JointDrives is -0.3"),
        ([], 0.3, r"JointDrives needs a sequence of at least one Joint, not \[\]"),
    ],
)
def test_errors_of_drives(joints, torque, message):
    with pytest.raises(TrussflowError, match=message):
        JointDrives(joints, torque=torque)

"""Sensors and drives: what they show, and when; what they pass on."""

from typing import Any

import numpy as np
import pytest

from trussflow.blocks import BlockError, Constant, Diagram, ParameterError, Ramp, simulate
from trussflow.models import JointDrives, Measurement, ModelError


def watch(measurement, source, size, duration, **more):
    """Return what a sensor shows, and the truth, at its samples."""
    diagram = Diagram("test")
    sensor, source = diagram.add(sensor=measurement.sensor(size, seed=3), source=source)
    source.y >> sensor.u
    log = {"seen": sensor.y, "true": source.y}
    step = measurement.sample_time
    settings: dict[str, Any] = {"step": step, "log_step": step, "backend": "interpreted", "progress": False}
    return simulate(diagram, duration, log=log, **settings | more)


def test_noise_is_white_and_has_the_deviation_asked_for():
    result = watch(Measurement(sample_time=0.1, noise=1e-4), Constant(np.full(100, 7.0)), 100, 100.0)
    error = (result["seen"].values - 7.0)[:-1] / 1e-4
    count = error.size
    assert error.var() == pytest.approx(1.0, abs=4 * np.sqrt(2 / count))
    assert abs(error.mean()) < 4 / np.sqrt(count)
    assert abs(np.mean(error[1:] * error[:-1])) < 4 / np.sqrt(count)
    assert abs(np.mean(error[:, 1:] * error[:, :-1])) < 4 / np.sqrt(count)


def test_a_gyro_is_what_its_data_sheet_says():
    """Angle random walk N √t of the integrated rate; a bias of its own, that forgets with time τ."""
    law = Measurement.gyro(0.1, angle_random_walk=0.01, bias_instability=0.0)
    rate = watch(law, Constant(np.zeros(1000)), 1000, 40.0)["seen"].values[:-1]
    angle = rate.sum(axis=0) * 0.1
    assert angle.std() == pytest.approx(0.01 * np.sqrt(40.0), rel=4 / np.sqrt(2000))
    law = Measurement.gyro(0.1, angle_random_walk=0.0, bias_instability=0.02, correlation_time=5.0)
    rate = watch(law, Constant(np.zeros(1000)), 1000, 40.0)["seen"].values[:-1]
    np.testing.assert_allclose(rate.std(axis=1), 0.02, rtol=4 / np.sqrt(2000), atol=0)
    assert np.mean(rate[:-50] * rate[50:]) / 0.02**2 == pytest.approx(np.exp(-1), abs=0.02)
    law = Measurement.gyro(0.1, angle_random_walk=0.0, bias_instability=0.02)
    rate = watch(law, Constant(np.zeros(50)), 50, 2.0)["seen"].values
    np.testing.assert_array_equal(rate[0], rate[-1])  # without a correlation time the bias stays
    assert rate.std() == pytest.approx(0.02, rel=0.4)


def test_an_encoder_counts_steps_of_a_turn():
    result = watch(Measurement.encoder(0.1, bits=8), Ramp([0.5, -0.3]), 2, 20.0)
    step = 2 * np.pi / 256
    assert np.abs(result["seen"] - result["true"]).max() <= step / 2 * (1 + 1e-9)
    np.testing.assert_allclose(result["seen"] / step, np.rint(result["seen"] / step), rtol=0, atol=1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.04, 0.1, 0.25])
def test_a_sample_is_shown_after_the_delay(delay):
    measurement = Measurement(sample_time=0.1, delay=delay)
    result = watch(measurement, Ramp([1.0]), 1, 2.0, step=0.01, log_step=0.01)
    ticks, late = np.arange(201), round(delay * 100)
    expected = np.where(ticks < late, 0.0, (ticks - late) // 10 * 0.1)
    np.testing.assert_allclose(result["seen"][:, 0], expected, rtol=0, atol=1e-12)


def test_everything_together_is_the_same_in_every_run():
    law = Measurement(sample_time=0.1, noise=0.1, random_walk=0.1, initial_bias=0.1, quantum=0.01, delay=0.1)
    first, second = (watch(law, Constant([1.0, 2.0]), 2, 5.0, backend=b) for b in ("numpy", "compiled"))
    # Round-off of the noise may choose another step, but did not for this seed.
    np.testing.assert_allclose(first["seen"], second["seen"], rtol=0, atol=1e-12)


def test_drives_limit_torque_and_rub():
    diagram = Diagram("test")
    drives, command, rate, health = diagram.add(
        drives=JointDrives(4, torque=0.3, viscous=0.2, coulomb=0.05, transition=1e-3),
        command=Constant([1.0, -1.0, 0.1, 1.0]),
        rate=Constant([0.0, 0.5, -0.5, 0.5]),
        health=Constant([1.0, 1.0, 0.5, 0.0]),
    )
    command.y >> drives.command
    rate.y >> drives.rate
    health.y >> drives.effectiveness
    result = simulate(diagram, 0.1, step=0.1, backend="interpreted", progress=False)
    np.testing.assert_allclose(
        result["drives.torque"][0], [0.3, -0.3 - 0.15, 0.05 + 0.15, -0.15], rtol=0, atol=1e-12
    )


def test_nonsense_is_refused():
    with pytest.raises(ModelError, match="a measurement: sample_time is 0; it must be above 0"):
        Measurement(sample_time=0.0)
    with pytest.raises(ModelError, match="a measurement: noise is -1; it must be at least 0"):
        Measurement(sample_time=0.1, noise=-1.0)
    with pytest.raises(ModelError, match=r"a measurement: delay is -0.1; it must be at least 0"):
        Measurement(sample_time=0.1, delay=-0.1)
    with pytest.raises(ModelError, match="a measurement: correlation_time is 0; it must be above 0"):
        Measurement(sample_time=0.1, correlation_time=0.0)
    with pytest.raises(BlockError, match=r"cannot delay samples of 0.1 s by 0.0123457 s"):
        Measurement(sample_time=0.1, delay=0.012345678).sensor(1, seed=1)
    with pytest.raises(ParameterError, match=r"'maximum' of JointDrives is -0.3"):
        JointDrives(7, torque=-0.3)
    with pytest.raises(BlockError, match="JointDrives needs at least one joint, not 0"):
        JointDrives(0, torque=0.3)

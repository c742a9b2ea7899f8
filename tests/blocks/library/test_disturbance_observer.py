"""The observer is a first-order lag of the true disturbance: d̂' = L (d - d̂)."""

import numpy as np
import pytest

from trussflow.blocks import (
    Constant,
    Diagram,
    DisturbanceObserver,
    Integrator,
    ParameterError,
    Ramp,
    Sine,
    Step,
    simulate,
)

# Classical Runge-Kutta at 0.01 s with L up to 4/s.
RK4 = 1e-7
LAW = np.array([2.0, 4.0])


def observed(disturbance, gain=LAW, initial_velocity=0.7):
    """Simulate v' = a + d, where the observer knows v and a."""
    diagram = Diagram()
    d, a, velocity, observer = diagram.add(
        d=disturbance,
        a=Sine([1.0, -2.0], 0.5),
        velocity=Integrator([initial_velocity] * 2),
        observer=DisturbanceObserver(gain),
    )
    (a.y + d.y) >> velocity.u
    velocity.y >> observer.velocity
    a.y >> observer.nominal_acceleration
    return simulate(diagram, 4.0, step=0.01, backend="interpreted", progress=False)


def test_estimate_of_a_constant_rises_exponentially_from_zero():
    d = np.array([0.3, -1.0])
    result = observed(Constant(d))
    t = result["time"].values[:, None]
    estimate = result["observer.disturbance_estimate"]
    assert np.abs(estimate[0]).max() < 1e-15
    np.testing.assert_allclose(estimate, d * (1.0 - np.exp(-LAW * t)), rtol=0, atol=RK4)


def test_estimate_of_a_ramp_lags_by_its_slope_over_the_gain():
    """The bound ξ/L of theorem 1 is reached by a ramp of slope ξ."""
    slope = np.array([0.3, -1.0])
    result = observed(Ramp(slope))
    t = result["time"].values[:, None]
    lag = result["d.y"].values - result["observer.disturbance_estimate"].values
    np.testing.assert_allclose(lag, slope / LAW * (1.0 - np.exp(-LAW * t)), rtol=0, atol=RK4)


def test_estimate_of_a_sine_is_that_of_a_first_order_lag():
    frequency = 1.5
    result = observed(Sine([1.0, 1.0], frequency))
    response = LAW / (2j * np.pi * frequency + LAW)
    t = result["time"].values[300:, None]  # three seconds on, exp(-L t) is below 0.003
    steady = np.imag(response * np.exp(2j * np.pi * frequency * t))
    transient = np.imag(response) * np.exp(-LAW * t)
    found = result["observer.disturbance_estimate"][300:]
    np.testing.assert_allclose(found, steady - transient, rtol=0, atol=1e-6)


def test_one_gain_serves_all_elements():
    np.testing.assert_allclose(
        observed(Constant([0.3, -1.0]), 4.0)["observer.disturbance_estimate"][:, 1],
        observed(Constant([0.3, -1.0]))["observer.disturbance_estimate"][:, 1],
        rtol=0,
        atol=1e-14,
    )


def test_estimate_may_be_fed_back_to_the_acceleration():
    """No algebraic loop: the estimate does not depend on the acceleration of the same instant."""
    diagram = Diagram()
    d, velocity, observer = diagram.add(d=Step(1.0), velocity=Integrator(), observer=DisturbanceObserver(4.0))
    compensation = -observer.disturbance_estimate
    (compensation + d.y) >> velocity.u
    velocity.y >> observer.velocity
    compensation >> observer.nominal_acceleration
    result = simulate(diagram, 6.0, step=0.01, backend="interpreted", progress=False)
    # What is left of the disturbance, exp(-L t), leaves the velocity at its integral 1/L.
    assert float(result["velocity.y"][-1]) == pytest.approx(0.25, rel=0.01)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: DisturbanceObserver(0.0), "'gain' of DisturbanceObserver is 0.0; .* above 0"),
        (lambda: DisturbanceObserver([1, 2], shape=3), r"'gain' of .* has shape \(2,\), but the shape"),
    ],
)
def test_nonsense_is_refused(build, message):
    with pytest.raises(ParameterError, match=message):
        build()

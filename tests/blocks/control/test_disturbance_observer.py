"""The observer is a first-order lag of the true disturbance: d̂' = L (d - d̂)."""

import numpy as np
from systems import assert_near

from trussflow.blocks import Diagram, DisturbanceObserver, Integrator, Sine, simulate

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
    return simulate(diagram, 4.0, step=0.01)


def test_estimate_is_a_first_order_lag_from_zero():
    """A constant and a sine, for which the response is that of the lag, less its decaying initial value."""
    frequency, constant = 1.5, np.array([0.3, -1.0])
    result = observed(Sine([1.0, 1.0], frequency, bias=constant))
    response = LAW / (2j * np.pi * frequency + LAW)
    t = result["time"].values[:, None]
    estimate = constant + np.imag(response * np.exp(2j * np.pi * frequency * t))
    estimate -= (constant + np.imag(response)) * np.exp(-LAW * t)
    assert_near(result["observer.disturbance_estimate"], estimate, 1e-6)

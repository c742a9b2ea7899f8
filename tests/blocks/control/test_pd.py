"""PD control makes a unit mass a damped oscillator."""

import numpy as np
from numpy.testing import assert_array_equal
from systems import assert_near

from trussflow.blocks import PD, Constant, Diagram, Integrator, simulate


def test_mass_under_pd_control_is_a_damped_oscillator():
    """For each element, e'' + k_d e' + k_p e = 0."""
    kp, kd, e0 = np.array([4.0, 9.0]), np.array([0.4, 3.0]), np.array([0.5, -1.0])
    diagram = Diagram()
    rest, control, velocity, position = diagram.add(
        rest=Constant([0.0, 0.0]),
        control=PD(kp, kd),
        velocity=Integrator(shape=2),
        position=Integrator(e0),
    )
    rest.y >> control.reference_position
    rest.y >> control.reference_velocity
    velocity.y >> position.u
    velocity.y >> control.velocity
    position.y >> control.position
    control.force >> velocity.u
    result = simulate(diagram, 5.0, step=0.01)
    t = result["time"].values[:, None]
    decay, frequency = kd / 2, np.sqrt(kp - kd**2 / 4)
    shape = np.cos(frequency * t) + decay / frequency * np.sin(frequency * t)
    exact = e0 * np.exp(-decay * t) * shape
    assert_near(result["control.error"], exact, 1e-7)
    assert_array_equal(result["control.error_rate"], result["velocity.y"])


def test_units_are_checked_where_given():
    block = PD(2000.0, 2000.0, unit=("m", "rad"), force_unit=("N", "N*m"))
    assert block.velocity.unit == ("m/s", "rad/s")
    assert block.force.unit == ("N", "N*m")

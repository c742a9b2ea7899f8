"""Sliding-mode laws, on a double integrator that does what they command."""

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import assert_near

from trussflow.blocks import (
    ConventionalSlidingMode,
    Diagram,
    IntegralSlidingMode,
    Integrator,
    Quintic,
    simulate,
)
from trussflow.blocks.control.sliding_mode import signed_power, unit_vector

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each
GAINS = {
    "gamma": 1.0,
    "mu": 0.25,
    "beta": 0.9,
    "eta": 0.001,
    "sigma": 0.3,
    "boundary_layer": 1e-3,
}
INPUTS = (
    "reference_position",
    "reference_velocity",
    "reference_acceleration",
    "position",
    "velocity",
)


def tracked(controller, duration, offset):
    """Simulate x'' = a along a quintic, from an error of position and velocity."""
    diagram = Diagram()
    trajectory, control, velocity, position = diagram.add(
        trajectory=Quintic([1.0, -2.0], 4.0),
        control=controller,
        velocity=Integrator([offset[1]] * 2),
        position=Integrator([offset[0]] * 2),
    )
    for name in ("position", "velocity", "acceleration"):
        trajectory.port(name) >> control.port(f"reference_{name}")
    velocity.y >> position.u
    velocity.y >> control.velocity
    position.y >> control.position
    control.acceleration >> velocity.u
    return simulate(diagram, duration, step=0.01)


def rate(values):
    """Return central differences over time steps of 0.01 s, of fourth order."""
    return (values[:-4] - 8 * values[1:-3] + 8 * values[3:-1] - values[4:]) / 0.12


@pytest.fixture(scope="module")
def integral():
    return tracked(IntegralSlidingMode(**(GAINS | {"eta": 0.05})), 60.0, (0.5, -0.2))


def test_integral_sliding_variable_obeys_its_reaching_law(integral):
    """For the whole vector, s' = -η s / (|s| + ι) - σ s."""
    s = integral["control.sliding_variable"].values[:1000]
    norm = np.linalg.norm(s, axis=1, keepdims=True)
    law = -0.05 * s / (norm + 1e-3) - 0.3 * s
    # within some layers of zero the differences lose their order
    away = norm[2:-2, 0] > 0.02
    assert away.sum() > 100
    assert_near(rate(s)[away], law[2:-2][away], 1e-5)


def test_integral_law_brings_the_error_to_zero(integral):
    assert_array_equal(integral["control.sliding_variable"][0], [-0.2, -0.2])
    assert_near(integral["control.error"][-1], 0.0, 1e-4)
    assert_near(integral["control.error_rate"][-1], 0.0, 1e-4)
    assert_array_equal(
        integral["control.feedforward"], integral["trajectory.acceleration"]
    )


def test_integral_law_is_the_published_formula(evaluate):
    """Eqs. (52)-(54), written out for one point."""
    e, de, w = np.array([0.3, -0.2]), np.array([-0.1, 0.4]), np.array([0.05, 0.02])
    block = IntegralSlidingMode(**GAINS)
    u = dict.fromkeys(INPUTS, np.ones(2)) | {"position": 1.0 + e, "velocity": 1.0 + de}
    found = evaluate(block, states={"integral": w}, **u)
    s = de + w
    nominal = 1.0 * np.abs(de) ** 0.9 * np.sign(de)
    nominal += 0.25 * np.abs(e) ** (0.9 / 1.1) * np.sign(e)
    reaching = 0.001 * s / (np.sqrt(s @ s) + 0.001) + 0.3 * s
    assert_allclose(found["feedback"], -nominal - reaching, rtol=1e-14)
    assert_allclose(found["acceleration"], 1.0 - nominal - reaching, rtol=1e-14)


def test_derivatives_at_zero_are_finite():
    """Linearization at zero error sees the linear law, and the slope 1/ι of the layer."""
    x = ca.SX.sym("x", 3)
    array = ca.ArrayInterface.SX(x, (3,))
    for result, slope in (
        (signed_power(array, 0.9), 1.0),
        (unit_vector(array, 1e-3), 1e3),
    ):
        jacobian = ca.Function("j", [x], [ca.jacobian(ca.SX(result), x)])
        assert_allclose(jacobian(np.zeros(3)).full(), slope * np.eye(3), rtol=1e-12)


@pytest.mark.parametrize("exponent", [0.5, 0.9, 1.0])
def test_signed_power_is_odd_with_the_right_size(exponent):
    x = np.array([-2.0, -1e-12, 0.0, 1e-300, 3.0])
    expected = np.sign(x) * np.abs(x) ** exponent
    assert_allclose(signed_power(x, exponent), expected, rtol=1e-13)


def test_conventional_sliding_variable_is_switched_off_at_a_constant_rate():
    """Until s is zero s' = -η sgn(s), then e decays at the rate λ."""
    controller = ConventionalSlidingMode(slope=2.0, eta=0.5)
    result = tracked(controller, 6.0, (0.5, -0.2))
    s, t = result["control.sliding_variable"].values[:, 0], result["time"].values
    reached = 0.8 / 0.5
    truncation = 1e-11  # of RK4: steps of λ h = 0.02
    assert_near(s[t < reached], 0.8 - 0.5 * t[t < reached], truncation)
    # chatters within one step
    assert np.abs(s[t > reached + 0.01]).max() <= 0.5 * 0.01 * 1.01
    e = result["control.error"].values[:, 0]
    late = t >= 2.0
    assert_near(e[late], e[t == 2.0] * np.exp(-2.0 * (t[late] - 2.0)), 0.5 * 0.01)


def test_boundary_layer_smooths_the_switching(evaluate):
    block = ConventionalSlidingMode(
        slope=2.0, eta=[1.0, 1.0, 1.0, 4.0], boundary_layer=0.1
    )
    u = dict.fromkeys(INPUTS, np.zeros(4)) | {
        "position": np.array([0.5, 0.025, -0.025, 0.025])
    }
    assert_allclose(
        evaluate(block, **u)["feedback"], [-1.0, -0.5, 0.5, -2.0], rtol=ROUND_OFF
    )


def test_units_follow_from_that_of_the_position():
    block = IntegralSlidingMode(**GAINS, unit=("m", "rad"))
    assert block.error.unit == ("m", "rad")
    assert block.sliding_variable.unit == ("m/s", "rad/s")
    assert block.reference_acceleration.unit == ("m/s**2", "rad/s**2")

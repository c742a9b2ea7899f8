"""Sliding-mode laws, on a double integrator that does what they command."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
import xarray as xr

from trussflow.blocks import (
    ConventionalSlidingMode,
    Diagram,
    Function,
    Input,
    IntegralSlidingMode,
    Integrator,
    Output,
    ParameterError,
    Quintic,
    Step,
    simulate,
)
from trussflow.blocks.library.sliding_mode import signed_power, unit_vector

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each
Evaluate = Callable[..., dict[str, Any]]
Respond = Callable[..., xr.Dataset]
SOURCE: dict[str, Any] = {
    "gamma": 1.0,
    "mu": 0.25,
    "beta": 0.9,
    "eta": 0.001,
    "sigma": 0.3,
    "boundary_layer": 1e-3,
}
INPUTS = ("reference_position", "reference_velocity", "reference_acceleration", "position", "velocity")


def tracked(controller, duration, offset, disturbance=None):
    """Simulate x'' = a + d along a quintic, from an error of position and velocity."""
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
    if disturbance is None:
        control.acceleration >> velocity.u
    else:
        (control.acceleration + diagram.add(disturbance=disturbance).y) >> velocity.u
    return simulate(diagram, duration, step=0.01, backend="interpreted", progress=False)


def rate(values):
    """Return central differences over time steps of 0.01 s, of fourth order."""
    return (values[:-4] - 8 * values[1:-3] + 8 * values[3:-1] - values[4:]) / 0.12


@pytest.fixture(scope="module")
def integral():
    return tracked(IntegralSlidingMode(**(SOURCE | {"eta": 0.05})), 60.0, (0.5, -0.2))


def test_integral_sliding_variable_obeys_its_reaching_law(integral):
    """For the whole vector, s' = -η s / (|s| + ι) - σ s."""
    s = integral["control.sliding_variable"].values[:1000]
    norm = np.linalg.norm(s, axis=1, keepdims=True)
    law = -0.05 * s / (norm + 1e-3) - 0.3 * s
    away = norm[2:-2, 0] > 0.02  # within some layers of zero the differences lose their order
    assert away.sum() > 100
    np.testing.assert_allclose(rate(s)[away], law[2:-2][away], rtol=0, atol=1e-5)


def test_integral_sliding_variable_starts_at_the_error_rate(integral):
    np.testing.assert_array_equal(integral["control.sliding_variable"][0], [-0.2, -0.2])


def test_integral_law_brings_the_error_to_zero(integral):
    error = np.abs(integral["control.error"].values).max(axis=1)
    assert error[0] == 0.5
    assert error[-1] < 1e-4
    assert np.abs(integral["control.error_rate"][-1]).max() < 1e-4


def test_parts_of_the_command_add_up(integral):
    parts = integral["control.feedforward"].values + integral["control.feedback"].values
    np.testing.assert_allclose(parts, integral["control.acceleration"], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(integral["control.feedforward"], integral["trajectory.acceleration"])


def test_matched_disturbance_is_held_where_reaching_balances_it():
    """At rest, η s / (|s| + ι) + σ s = d."""
    d = np.array([0.03, -0.04])
    result = tracked(IntegralSlidingMode(**SOURCE), 60.0, (0.0, 0.0), Step(1.0, final_value=d))
    s = result["control.sliding_variable"].values[-1]
    balance = 0.001 * s / (np.linalg.norm(s) + 1e-3) + 0.3 * s
    np.testing.assert_allclose(balance, d, rtol=0, atol=1e-6)


def test_integral_law_is_the_published_formula(evaluate):
    """Eqs. (52)-(54), written out for one point."""
    e, de, w = np.array([0.3, -0.2]), np.array([-0.1, 0.4]), np.array([0.05, 0.02])
    block = IntegralSlidingMode(**SOURCE)
    u = dict.fromkeys(INPUTS, np.ones(2)) | {"position": 1.0 + e, "velocity": 1.0 + de}
    found = evaluate(block, states={"integral": w}, **u)
    s = de + w
    nominal = 1.0 * np.abs(de) ** 0.9 * np.sign(de)
    nominal += 0.25 * np.abs(e) ** (0.9 / 1.1) * np.sign(e)
    reaching = 0.001 * s / (np.sqrt(s @ s) + 0.001) + 0.3 * s
    np.testing.assert_allclose(found["feedback"], -nominal - reaching, rtol=1e-14)
    np.testing.assert_allclose(found["acceleration"], 1.0 - nominal - reaching, rtol=1e-14)


def test_linear_limit_is_a_linear_law(evaluate):
    """With β = 1 and η = 0: feedback = -(γ + σ) ė - μ e - σ w."""
    block = IntegralSlidingMode(**(SOURCE | {"beta": 1.0, "eta": 0.0}))
    u = dict.fromkeys(INPUTS, 0.0) | {"position": 0.3, "velocity": -0.7}
    found = evaluate(block, states={"integral": 0.1}, **u)
    assert found["feedback"] == pytest.approx(-1.3 * -0.7 - 0.25 * 0.3 - 0.3 * 0.1)


def test_derivatives_at_zero_are_finite():
    """Linearization at zero error sees the linear law, and the slope 1/ι of the layer."""
    x = ca.SX.sym("x", 3)
    array = ca.ArrayInterface.SX(x, (3,))
    for result, slope in ((signed_power(array, 0.9), 1.0), (unit_vector(array, 1e-3), 1e3)):
        jacobian = ca.Function("j", [x], [ca.jacobian(ca.SX(result), x)])
        np.testing.assert_allclose(jacobian(np.zeros(3)).full(), slope * np.eye(3), rtol=1e-12)


@pytest.mark.parametrize("exponent", [0.5, 0.9, 1.0])
def test_signed_power_is_odd_with_the_right_size(exponent):
    x = np.array([-2.0, -1e-12, 0.0, 1e-300, 3.0])
    expected = np.sign(x) * np.abs(x) ** exponent
    np.testing.assert_allclose(signed_power(x, exponent), expected, rtol=1e-13)


def test_conventional_sliding_variable_is_switched_off_at_a_constant_rate():
    """Until s is zero s' = -η sgn(s), then e decays at the rate λ."""
    controller = ConventionalSlidingMode(slope=2.0, eta=0.5)
    result = tracked(controller, 6.0, (0.5, -0.2))
    s, t = result["control.sliding_variable"].values[:, 0], result["time"].values
    assert s[0] == pytest.approx(0.8)
    reached = 0.8 / 0.5
    truncation = 1e-11  # of RK4: steps of λ h = 0.02
    np.testing.assert_allclose(s[t < reached], 0.8 - 0.5 * t[t < reached], rtol=0, atol=truncation)
    assert np.abs(s[t > reached + 0.01]).max() <= 0.5 * 0.01 * 1.01  # chatters within one step
    e = result["control.error"].values[:, 0]
    late = t >= 2.0
    np.testing.assert_allclose(e[late], e[t == 2.0] * np.exp(-2.0 * (t[late] - 2.0)), rtol=0, atol=0.5 * 0.01)


def test_boundary_layer_smooths_the_switching(evaluate):
    block = ConventionalSlidingMode(slope=2.0, eta=[1.0, 1.0, 1.0, 4.0], boundary_layer=0.1)
    u = dict.fromkeys(INPUTS, np.zeros(4)) | {"position": np.array([0.5, 0.025, -0.025, 0.025])}
    np.testing.assert_allclose(evaluate(block, **u)["feedback"], [-1.0, -0.5, 0.5, -2.0], rtol=ROUND_OFF)


def test_boundary_layer_does_not_hide_nan(respond):
    """An undefined position must not look like one at the edge of the layer."""
    undefined = Function(lambda u: np.sqrt(u - 1.0), {"u": Input(default=0.0)}, {"y": Output()})
    block = ConventionalSlidingMode(slope=2.0, eta=1.0, boundary_layer=0.1)
    inputs = dict.fromkeys(INPUTS, 0.0) | {"position": undefined}
    result = respond(block, 0.01, {"log": ["block.feedback"], "not_finite": "ignore"}, **inputs)
    assert np.isnan(result["block.feedback"]).all()


def test_units_follow_from_that_of_the_position():
    block = IntegralSlidingMode(**SOURCE, unit=("m", "rad"))
    assert block.error.unit == ("m", "rad")
    assert block.sliding_variable.unit == ("m/s", "rad/s")
    assert block.reference_acceleration.unit == ("m/s**2", "rad/s**2")


@pytest.mark.parametrize(
    ("build", "message"),
    [
        *(
            (lambda name=name: IntegralSlidingMode(**(SOURCE | {name: -1.0})), f"'{name}' of .* is -1")
            for name in SOURCE
        ),
        (lambda: IntegralSlidingMode(**(SOURCE | {"beta": 1.5})), "is 1.5; it must be above 0, at m"),
        (
            lambda: IntegralSlidingMode(**(SOURCE | {"mu": [1, 2], "eta": [1, 2, 3]})),
            r"'eta' of .* has shape \(3,\), but the shape of parameter 'mu' is \(2,\)",
        ),
        (lambda: ConventionalSlidingMode(slope=0.0, eta=1.0), "'slope' of Conventional.* is 0"),
        (lambda: ConventionalSlidingMode(slope=1.0, eta=-1.0), "'eta' of Conventional.* is -1"),
        (
            lambda: ConventionalSlidingMode(slope=1, eta=1, boundary_layer=-1),
            "'boundary_layer' of Conv.* is -1",
        ),
    ],
)
def test_nonsense_is_refused(build, message):
    with pytest.raises(ParameterError, match=message):
        build()

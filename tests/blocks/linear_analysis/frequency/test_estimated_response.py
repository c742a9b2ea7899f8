"""Broadband excitation of several inputs: what linear models say must be seen there, and what they cannot."""

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import assert_near, ports, ring, series

from trussflow.blocks import (
    Constant,
    Diagram,
    DiscreteStateSpace,
    Function,
    Gain,
    Integrator,
    Noise,
    OperatingPoint,
    PythonFunction,
    StateSpace,
    Sum,
    ZeroOrderHold,
    estimated_response,
    linearize,
)
from trussflow.blocks.errors import LinearAnalysisError, ParameterError

OMEGA = np.geomspace(0.3, 20.0, 12)


def masses():
    """Return two masses on springs under two forces; three signals are measured."""
    A = np.array([[0, 1, 0, 0], [-4, -0.4, 1, 0], [0, 0, 0, 1], [1, 0, -9, -0.6]])
    B = np.array([[0, 0], [1, 0.2], [0, 0], [0, 2]])
    return StateSpace(A, B, [[1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0]])


def test_of_a_linear_plant_the_response_matrix_is_that_of_linearize():
    """RK4 at 5 ms is right to 1e-8 there."""
    found = estimated_response(
        masses(),
        omega=OMEGA,
        amplitude=[0.1, 3.0],
        step=5e-3,
        tolerance=1e-8,
        realizations=2,
    )
    exact = linearize(masses()).frequency_response(found.omega)
    assert found.complex.shape == (3, 2, OMEGA.size)
    assert_near(found.complex, exact.complex, 1e-7)
    # moved by half a line of five at most
    assert_allclose(found.omega, OMEGA, rtol=0.1)
    assert found.standard_error.shape == (3, 2, OMEGA.size)
    assert found.standard_error.max() < 1e-7
    assert isinstance(found, control.FrequencyResponseData)
    assert found.input_labels == ["u[0]", "u[1]"]


def sampled_loop():
    """Return a plant under a sampled controller, at 0.1 s, with a disturbance at each of the two signals."""
    diagram = Diagram("loop")
    plant, law, force, error = diagram.add(
        plant=StateSpace([[0.0, 1.0], [-2.0, -0.5]], [0.0, 1.0], [1.0, 0.0]),
        law=DiscreteStateSpace([[0.6]], [1.0], [-0.4], -1.5, sample_time=0.1),
        force=Sum("++"),
        error=Sum("++"),
    )
    plant >> error.u1
    error >> law >> force.u1
    force >> plant
    diagram.expose(load=force.u2, disturbance=error.u2, y=plant.y, command=law.y)
    return diagram


def test_of_a_sampled_loop_the_response_is_that_of_the_exact_discrete_model():
    found = estimated_response(
        sampled_loop(),
        # up to almost half the rate of sampling, 31.4 rad/s
        omega=np.linspace(1.0, 30.0, 12),
        amplitude=1.0,
        step=0.01,
        sample_time=0.1,
        tolerance=1e-10,
        realizations=2,
    )
    exact = linearize(sampled_loop()).frequency_response(found.omega)
    assert_near(found.complex, exact.complex, 1e-8)


def test_of_a_cube_the_estimate_is_the_best_linear_approximation():
    """Each of K sines of amplitude b comes out with b^3 (3/4 + 3/2 (K - 1)), besides distortions."""
    lines, amplitude = 20, 0.7
    found = estimated_response(
        Function(lambda u: u**3),
        omega=np.linspace(1.0, 30.0, lines),
        amplitude=amplitude,
        step=0.01,
        realizations=40,
    )
    each = amplitude / np.sqrt(found.omega.size)
    expected = each**2 * (0.75 + 1.5 * (found.omega.size - 1))
    error = np.abs(np.ravel(found.complex) - expected)
    assert found.omega.size == lines
    # Distances have the standard error as their root mean square, so their squares sum up to the number.
    assert np.mean((error / found.standard_error[0, 0]) ** 2) == pytest.approx(
        1.0, abs=0.7
    )
    assert 0.01 < (found.standard_error[0, 0] / expected).mean() < 0.1


def test_the_standard_error_says_how_far_noise_takes_the_estimate():
    diagram = Diagram("noisy")
    plant, noise, measured = diagram.add(
        plant=masses(),
        noise=Noise(np.full(3, 1e-2), sample_time=0.05, seed=1),
        measured=Sum("++"),
    )
    plant.y >> measured.u1
    noise.y >> measured.u2
    diagram.expose(u=plant.u, y=measured.y)
    found = estimated_response(
        diagram,
        omega=OMEGA,
        amplitude=1.0,
        step=0.0125,
        tolerance=np.inf,
        realizations=12,
        cycles=8,
    )
    exact = linearize(masses()).frequency_response(found.omega).complex
    ratio = np.abs(found.complex - exact) / found.standard_error
    assert found.standard_error.min() > 1e-6
    # An F distribution with 2 and 22 degrees of freedom: mean 1.1, and of 24 of them with a spread of 0.23.
    assert np.mean(ratio**2) == pytest.approx(1.1, abs=0.7)


def test_a_nonlinear_loop_around_a_point_answers_as_its_linear_model():
    """The slope of 8 - x³ at x = 2 is -12."""
    diagram = ring(rate=Function(lambda x: 8.0 - x**3), x=Integrator())
    settings = {"omega": OMEGA, "amplitude": 1e-3, "step": 5e-3}
    point = OperatingPoint(states={"x.integral": 2.0})
    found = estimated_response(diagram, "x.u", "x.y", at=point, **settings)
    assert_near(np.ravel(found.complex), 1.0 / (1j * found.omega + 12.0), 1e-5)


def test_a_held_signal_is_the_mean_of_as_many_delays_as_steps():
    """Y / U = (1 + q + ... + q^49) / 50 with q = exp(-j w h), also behind a sampled Python block."""
    diagram = Diagram()
    hold, code, wire = diagram.add(
        hold=ZeroOrderHold(0.1),
        code=PythonFunction(lambda u: 2.0 * u, 0.1, **ports(u=(), y=())),
        wire=Gain(1.0),
    )
    wire >> hold
    wire >> code
    diagram.expose(u=wire.u, held=hold.y, code_=code.y)
    found = estimated_response(
        diagram, "u", omega=[2.0, np.pi], amplitude=1.0, step=2e-3, realizations=1
    )
    expected = np.exp(-2e-3j * np.outer(np.arange(50), found.omega)).mean(axis=0)
    assert_allclose(found.complex[:, 0], [expected, 2 * expected], rtol=1e-9)
    assert np.isnan(found.standard_error).all()  # one realization does not say


def test_inputs_from_outside_keep_the_values_of_the_point_and_parameters_count():
    diagram = Diagram()
    block, gain, one = diagram.add(
        block=Function(lambda a, b: a * b, **ports(a=(), b=2, y=2)),
        gain=Gain(1.0),
        one=Constant(1.0),
    )
    one >> gain >> block.a
    diagram.expose(b=block.b, y=block.y)
    at = OperatingPoint(inputs={"b": [3.0, 4.0]}, parameters={"gain.gain": 5.0})
    for port, expected in (
        ("gain.u", [15, 20]),
        ("b[1]", [0, 5]),
        ("block.b[1]", [0, 5]),
    ):
        found = estimated_response(
            diagram, port, "y", omega=[1.0], amplitude=0.1, step=0.05, at=at
        )
        assert_near(found.complex[:, 0, 0], expected, 1e-9)


@pytest.mark.parametrize(
    "changed, message",
    [
        (
            {"amplitude": [1.0, 2.0, 3.0]},
            r"amplitude has shape \(3,\); it must have shape \(2,\)",
        ),
        ({"amplitude": 0.0}, "amplitude = 0.0 must be"),
        ({"step": 0.1}, "the response is read every 0.1 s, less than 10 times"),
        ({"sample_time": 0.2}, "the response is read every 0.2 s, less than 2 times"),
        ({"inputs": []}, r"without inputs: name ports with inputs=\["),
        ({"outputs": ["y[0]", "y"]}, "outputs name elements twice: y\\[0\\]"),
        ({"seed": -1}, "seed = -1 must be a whole number"),
        ({"tolerance": 0.0}, "tolerance = 0.0 must be positive"),
        ({"inputs": ["y"]}, "nothing reads 'masses.y'"),
        ({"omega": [1e-6, 1.0]}, "leave out the lowest frequencies"),
        ({"tolerance": 1e-14, "omega": [20.0]}, "not periodic after 64 periods"),
    ],
)
def test_what_makes_no_sense_is_refused_with_the_way_out(changed, message):
    given = {"omega": OMEGA, "amplitude": 1.0, "step": 0.01} | changed
    diagram = series("masses", plant=masses())
    diagram.expose(u=diagram.plant.u, y=diagram.plant.y)
    with pytest.raises((LinearAnalysisError, ParameterError), match=message):
        estimated_response(diagram, **given)

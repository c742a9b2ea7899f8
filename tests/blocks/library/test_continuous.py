"""Continuous linear blocks have the exact solutions of their equations."""

import itertools
from collections.abc import Callable

import control
import numpy as np
import pytest
import xarray as xr
from scipy.linalg import expm

from trussflow.blocks import (
    BlockError,
    Diagram,
    DiscreteStateSpace,
    Integrator,
    ParameterError,
    Ramp,
    Sine,
    StateSpace,
    TransferFunction,
    from_control,
    simulate,
)

ROUND_OFF = 1e-13  # relative: a sum of some hundred steps
Respond = Callable[..., xr.Dataset]
# Classical Runge-Kutta with steps of 0.01 s on systems with rates around 1/s.
RK4 = 1e-8
A = np.array([[0.0, 1.0, 0.0], [-4.0, -0.3, 0.5], [0.2, 0.0, -1.0]])
B = np.array([[0.0, 1.0], [1.0, 0.0], [0.5, -1.0]])
C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 2.0]])
D = np.array([[0.0, 0.1], [0.2, 0.0]])


@pytest.mark.parametrize(("degree", "error"), [(3, 1e-13), (4, 1e-8)])
def test_integrator_integrates_polynomials(degree, error):
    """RK4 is exact on a cubic, and on a quartic to its order."""
    diagram = Diagram()
    chain = [diagram.add(ramp=Ramp())]
    chain += [diagram.add(**{f"i{k}": Integrator()}) for k in range(2, degree + 1)]
    for source, target in itertools.pairwise(chain):
        source.y >> target.u
    result = simulate(diagram, 1.0, step=0.1, backend="interpreted", progress=False)
    factorial = float(np.prod(np.arange(1, degree + 1)))
    assert abs(float(result[f"i{degree}.y"][-1]) - 1.0 / factorial) < error


def test_integrator_starts_at_its_initial_value_and_derives_units(respond):
    block = Integrator([1.0, 2.0], unit=("m", "rad"))
    assert block.u.unit == ("m/s", "rad/s")
    result = respond(block, 1.0, u=[3.0, -1.0])
    np.testing.assert_allclose(result["block.y"][-1], [4.0, 1.0], rtol=ROUND_OFF)


def test_state_space_follows_the_matrix_exponential(respond):
    x0, u = np.array([1.0, -1.0, 0.5]), np.array([0.3, -0.7])
    result = respond(StateSpace(A, B, C, D, initial_value=x0), 3.0, u=u)
    # One exponential of the state with the constant input beside it.
    whole = np.zeros((5, 5))
    whole[:3, :3], whole[:3, 3:] = A, B
    x = (expm(3.0 * whole) @ np.concatenate([x0, u]))[:3]
    np.testing.assert_allclose(result["block.y"][-1], C @ x + D @ u, rtol=0, atol=RK4)


@pytest.mark.parametrize("inputs", ["scalar", "vector"])
@pytest.mark.parametrize("outputs", ["scalar", "vector"])
def test_vectors_as_matrices_give_scalar_ports(inputs, outputs, respond):
    b, u = (B[:, 0], 0.3) if inputs == "scalar" else (B, np.array([0.3, 0.0]))
    c = C[0] if outputs == "scalar" else C
    d = D[(0 if outputs == "scalar" else slice(None)), (0 if inputs == "scalar" else slice(None))]
    block = StateSpace(A, b, c, d)
    assert block.u.shape == np.shape(u)
    y = respond(block, 1.0, u=u)["block.y"][-1]
    reference = respond(StateSpace(A, B, C, D), 1.0, u=[0.3, 0.0])["block.y"][-1]
    np.testing.assert_allclose(y, reference[0] if outputs == "scalar" else reference, rtol=0, atol=1e-14)


def test_state_space_agrees_with_python_control(respond):
    system = control.ss(A, B[:, :1], C, D[:, :1], inputs=["thrust"], outputs=["angle", "rate"])
    block = from_control(system)
    assert isinstance(block, StateSpace)
    assert (block.u.shape, block.y.shape) == ((1,), (2,))
    assert block.u.declaration.meaning == "thrust"
    assert block.y.declaration.meaning == "angle, rate"
    result = respond(block, 5.0, {"log_step": 0.1}, u=Sine([1.0], [0.3]))
    times = result["time"].values
    # forced_response interpolates its input linearly, so give it many points.
    fine = np.linspace(0.0, 5.0, 5001)
    response = control.forced_response(system, fine, np.sin(2 * np.pi * 0.3 * fine))
    np.testing.assert_allclose(result["block.y"].T, response.outputs[:, ::100], rtol=0, atol=1e-6)
    assert times.size == 51


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [([2.0], [0.5, 1.0]), ([1.0, 3.0], [1.0, 0.4, 4.0]), ([2.0, 0.0, 1.0], [2.0, 1.0, 3.0])],
)
def test_transfer_function_agrees_with_python_control(numerator, denominator, respond):
    block = TransferFunction(numerator, denominator)
    assert (block.u.shape, block.y.shape) == ((), ())
    result = respond(block, 4.0, {"log_step": 0.1}, u=1.0)
    system = control.tf(numerator, denominator)
    response = control.step_response(system, result["time"].values)
    np.testing.assert_allclose(result["block.y"], response.outputs, rtol=0, atol=RK4)
    same = respond(from_control(system), 4.0, {"log_step": 0.1}, u=1.0)
    np.testing.assert_allclose(same["block.y"], result["block.y"], rtol=0, atol=1e-13)


def test_system_with_one_input_and_one_output_has_scalar_ports(respond):
    system = control.ss(A, B[:, :1], C[:1], [[0.5]])
    result = respond(from_control(system), 2.0, u=1.0)
    reference = control.step_response(system, [0.0, 1.0, 2.0]).outputs
    assert result["block.y"].shape == (201,)
    np.testing.assert_allclose(result["block.y"][::100], reference, rtol=0, atol=RK4)


def test_realization_has_the_frequency_response():
    s, block = 0.7j, TransferFunction([1.0, 2.0, 3.0], [2.0, 1.0, 4.0, 5.0])
    value = block.C @ np.linalg.solve(s * np.eye(3) - block.A, block.B) + block.D
    assert value == pytest.approx((s**2 + 2 * s + 3) / (2 * s**3 + s**2 + 4 * s + 5))


def test_discrete_systems_become_sampled_blocks():
    block = from_control(control.ss(0.5, 1.0, 1.0, 0.0, 0.1))
    assert isinstance(block, DiscreteStateSpace)
    assert block.sample_time == 0.1


def nonsense():
    two_by_two = [[[1.0], [1.0]], [[1.0], [1.0]]]
    return [
        (lambda: Integrator([1, 2], shape=3), ParameterError, r"'initial_value' of Integrator has"),
        (lambda: StateSpace(np.ones((2, 3)), B, C), BlockError, r"A has shape \(2, 3\); it must be"),
        (lambda: StateSpace(A, B[:2], C), BlockError, r"B has shape \(2, 2\); with 3 states it"),
        (lambda: StateSpace(A, B, C.T), BlockError, r"C has shape \(3, 2\); with 3 states it"),
        (lambda: StateSpace(A, B, C, [1.0]), BlockError, r"D has shape \(1,\); .* ask for \(2, 2\)"),
        (lambda: StateSpace(A * np.nan, B, C), BlockError, "A of StateSpace is not finite"),
        (lambda: StateSpace("A", B, C), BlockError, "A of StateSpace must be numeric, not 'A'"),
        (
            lambda: StateSpace(A, B, C, initial_value=[1.0, 2.0]),
            ParameterError,
            r"'initial_value' of StateSpace has shape \(2,\); it must have shape \(3,\)",
        ),
        (lambda: TransferFunction([1.0], [2.0]), BlockError, "has no pole; use a Gain"),
        (lambda: TransferFunction([1], [0.0]), BlockError, "has no pole"),
        (lambda: TransferFunction([1, 0, 0], [1, 1]), BlockError, "numerator has order 2, the den"),
        (lambda: TransferFunction([[1]], [1, 1]), BlockError, "numerator must be a list of coef"),
        (lambda: from_control(3.0), BlockError, "cannot make a block of 3.0: it must be a control"),
        (
            lambda: from_control(control.tf(two_by_two, [[[1.0, 1.0]] * 2] * 2)),
            BlockError,
            r"2 inputs and 2 outputs; convert it with control.ss\(system\) first",
        ),
        (lambda: from_control(control.ss(0.5, 1.0, 1.0, 0.0, True)), BlockError, "sample time is not given"),
    ]


@pytest.mark.parametrize(("build", "error", "message"), nonsense())
def test_nonsense_is_refused(build, error, message):
    with pytest.raises(error, match=message):
        build()

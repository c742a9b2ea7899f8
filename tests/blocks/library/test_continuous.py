"""Continuous linear blocks have the exact solutions of their equations."""

import math

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm
from systems import assert_near

from trussflow.blocks import (
    Diagram,
    DiscreteStateSpace,
    Integrator,
    Ramp,
    Sine,
    StateSpace,
    TransferFunction,
    from_control,
    simulate,
)

ROUND_OFF = 1e-13  # relative: a sum of some hundred steps
# Classical Runge-Kutta with steps of 0.01 s on systems with rates around 1/s.
RK4 = 1e-8
A = np.array([[0.0, 1.0, 0.0], [-4.0, -0.3, 0.5], [0.2, 0.0, -1.0]])
B = np.array([[0.0, 1.0], [1.0, 0.0], [0.5, -1.0]])
C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 2.0]])
D = np.array([[0.0, 0.1], [0.2, 0.0]])


@pytest.mark.parametrize("degree, error", [(3, 1e-13), (4, 1e-8)])
def test_integrator_integrates_polynomials(degree, error):
    """RK4 is exact on a cubic, and on a quartic to its order."""
    diagram = Diagram()
    source = diagram.add("ramp", Ramp())
    for k in range(2, degree + 1):
        source = source >> diagram.add(f"i{k}", Integrator())
    result = simulate(diagram, 1.0, step=0.1)
    assert abs(result[f"i{degree}.y"][-1] - 1.0 / math.factorial(degree)) < error


def test_integrator_starts_at_its_initial_value_and_derives_units(respond):
    block = Integrator([1.0, 2.0], unit=("m", "rad"))
    assert block.u.unit == ("m/s", "rad/s")
    result = respond(block, 1.0, u=[3.0, -1.0])
    assert_allclose(result["block.y"][-1], [4.0, 1.0], rtol=ROUND_OFF)


def test_state_space_follows_the_matrix_exponential(respond):
    x0, u = np.array([1.0, -1.0, 0.5]), np.array([0.3, -0.7])
    result = respond(StateSpace(A, B, C, D, initial_value=x0), 3.0, u=u)
    # One exponential of the state with the constant input beside it.
    whole = np.zeros((5, 5))
    whole[:3, :3], whole[:3, 3:] = A, B
    x = (expm(3.0 * whole) @ np.concatenate([x0, u]))[:3]
    assert_near(result["block.y"][-1], C @ x + D @ u, RK4)


@pytest.mark.parametrize("inputs", ["scalar", "vector"])
@pytest.mark.parametrize("outputs", ["scalar", "vector"])
def test_vectors_as_matrices_give_scalar_ports(inputs, outputs, respond):
    b, u = (B[:, 0], 0.3) if inputs == "scalar" else (B, np.array([0.3, 0.0]))
    c = C[0] if outputs == "scalar" else C
    d = D[
        (0 if outputs == "scalar" else slice(None)),
        (0 if inputs == "scalar" else slice(None)),
    ]
    block = StateSpace(A, b, c, d)
    assert block.u.shape == np.shape(u)
    y = respond(block, 1.0, u=u)["block.y"][-1]
    reference = respond(StateSpace(A, B, C, D), 1.0, u=[0.3, 0.0])["block.y"][-1]
    assert_near(y, reference[0] if outputs == "scalar" else reference, 1e-14)


def test_state_space_agrees_with_python_control(respond):
    system = control.ss(A, B[:, :1], C, D[:, :1])
    block = from_control(system)
    assert (block.u.shape, block.y.shape) == ((1,), (2,))
    result = respond(block, 5.0, {"log_step": 0.1}, u=Sine([1.0], [0.3]))
    # forced_response interpolates its input linearly, so give it many points.
    fine = np.linspace(0.0, 5.0, 5001)
    response = control.forced_response(system, fine, np.sin(2 * np.pi * 0.3 * fine))
    assert_near(result["block.y"].T, response.outputs[:, ::100], 1e-6)


@pytest.mark.parametrize(
    "numerator, denominator",
    [
        ([2.0], [0.5, 1.0]),
        ([1.0, 3.0], [1.0, 0.4, 4.0]),
        ([1.0, 2.0, 3.0], [2.0, 1.0, 4.0, 5.0]),
    ],
)
def test_transfer_function_agrees_with_python_control(numerator, denominator, respond):
    block = TransferFunction(numerator, denominator)
    assert (block.u.shape, block.y.shape) == ((), ())
    result = respond(block, 4.0, {"log_step": 0.1}, u=1.0)
    system = control.tf(numerator, denominator)
    response = control.step_response(system, result["time"].values)
    assert_near(result["block.y"], response.outputs, RK4)
    same = respond(from_control(system), 4.0, {"log_step": 0.1}, u=1.0)
    assert_near(same["block.y"], result["block.y"], 1e-13)


def test_discrete_systems_become_sampled_blocks():
    block = from_control(control.ss(0.5, 1.0, 1.0, 0.0, 0.1))
    assert isinstance(block, DiscreteStateSpace)
    assert block.sample_time == 0.1

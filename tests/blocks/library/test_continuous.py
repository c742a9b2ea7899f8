"""Continuous linear blocks have the exact solutions of their equations."""

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm
from systems import assert_near

from trussflow.blocks import Integrator, StateSpace, TransferFunction, from_control

ROUND_OFF = 1e-13  # relative: a sum of some hundred steps
# Classical Runge-Kutta with steps of 0.01 s on systems with rates around 1/s.
RK4 = 1e-8
A = np.array([[0.0, 1.0, 0.0], [-4.0, -0.3, 0.5], [0.2, 0.0, -1.0]])
B = np.array([[0.0, 1.0], [1.0, 0.0], [0.5, -1.0]])
C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 2.0]])
D = np.array([[0.0, 0.1], [0.2, 0.0]])


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

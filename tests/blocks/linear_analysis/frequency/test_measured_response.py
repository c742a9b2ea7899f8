"""Swept sines on the simulated diagram: what linear models say must be seen there."""

from typing import Any

import numpy as np
import pytest
from systems import ports

from trussflow.blocks import (
    Constant,
    Diagram,
    Function,
    Gain,
    OperatingPoint,
    PythonFunction,
    StateSpace,
    ZeroOrderHold,
    linearize,
    loop_transfer,
    measured_response,
    trim,
)
from trussflow.blocks.framework.errors import LinearAnalysisError

OMEGA = np.geomspace(0.2, 20.0, 10)
SWEEP: dict[str, Any] = {"omega": OMEGA, "amplitude": 1e-3, "step": 2e-3, "cycles": 3, "tolerance": 1e-4}


def test_linear_and_measured_response_agree_around_trim_to_1_percent(pendulum):
    at = trim(pendulum, inputs={"torque": 1.5})
    assert at.states["inertia.x"][0] > 0.3  # well away from rest, where sines are lines
    model = linearize(pendulum, at=at)
    measured = measured_response(pendulum, "torque[0]", at=at, **SWEEP)
    exact = model(1j * OMEGA)[:, 0]
    np.testing.assert_allclose(measured.frdata[:, 0, :], exact, rtol=0.01)
    assert measured.output_labels == model.output_labels
    assert measured.input_labels == model.input_labels


def test_a_loop_gain_is_seen_in_the_signals_at_the_wire(pendulum):
    """The response at the wire to an added signal is -L / (1 + L) before and 1 / (1 + L) behind it."""
    at = trim(pendulum, inputs={"torque": 1.0})
    gain = loop_transfer(pendulum, "law.y", at=at)(1j * OMEGA)
    measured = measured_response(pendulum, "gravity.u[0]", ["law.y", "gravity.u"], at=at, **SWEEP)
    np.testing.assert_allclose(measured.frdata[0, 0], -gain / (1 + gain), rtol=0.01)
    np.testing.assert_allclose(measured.frdata[1, 0], 1 / (1 + gain), rtol=0.01)
    assert measured.output_labels == ["law/y[0]", "gravity/u[0]"]


def test_sampled_and_python_blocks_are_measured_too():
    """A held signal: gain sinc(w T / 2), and a delay of half a period, less half a step."""
    diagram = Diagram()
    hold, code, wire = diagram.add(
        hold=ZeroOrderHold(0.1),
        code=PythonFunction(lambda u: 2.0 * u, 0.1, **ports(u=(), y=())),
        wire=Gain(1.0),
    )
    wire >> hold
    wire >> code
    diagram.expose(u=wire.u, held=hold.y, code_=code.y)
    omega = np.array([2 * np.pi / 2.0])  # twenty samples in a period
    found = measured_response(diagram, "u", omega=omega, amplitude=1.0, step=2e-3)
    # one sample of 5000 more or less in the window matters by 2e-4, since the signal jumps
    expected = np.sinc(omega * 0.05 / np.pi) * np.exp(-0.049j * omega)
    np.testing.assert_allclose(found.frdata[0, 0], expected, rtol=5e-4)
    np.testing.assert_allclose(found.frdata[1, 0], 2 * expected, rtol=5e-4)


def test_a_start_on_the_oscillation_shortens_the_wait():
    """Without damping the free motion never ends; started on the forced one, there is none."""
    spring = StateSpace([[0.0, 1.0], [-4.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    start = [{"StateSpace.x": [0.0, 1.3 / (4 - 1.69)]}]  # x = sin(1.3 t) / (4 - 1.69)
    arguments: dict[str, Any] = {"omega": [1.3], "amplitude": 1.0, "step": 1e-2}
    found = measured_response(spring, "u[0]", initial=start, **arguments)
    np.testing.assert_allclose(found.frdata.ravel(), [1 / (4 - 1.69)], rtol=1e-6)
    with pytest.raises(LinearAnalysisError, match=r"at 1.3 rad/s is not steady after 100 windows of 5"):
        measured_response(spring, "u[0]", **arguments)


def test_an_odd_step_is_no_obstacle():
    lag = StateSpace([[-1.0]], [[1.0]], [[1.0]])
    for solver in ("rk4", "RK45"):
        found = measured_response(lag, "u", omega=[1.0], amplitude=1.0, step=np.pi / 500, solver=solver)
        np.testing.assert_allclose(found.frdata.ravel(), [1 / (1 + 1j)], rtol=1e-3)


def test_inputs_from_outside_keep_the_values_of_the_point_and_parameters_count():
    diagram = Diagram()
    block, gain, one = diagram.add(
        block=Function(lambda a, b: a * b, **ports(a=(), b=2, y=2)), gain=Gain(1.0), one=Constant(1.0)
    )
    one >> gain >> block.a
    diagram.expose(b=block.b, y=block.y)
    at = OperatingPoint(inputs={"b": [3.0, 4.0]}, parameters={"gain.gain": 5.0})
    for port, expected in (("gain.u", [15, 20]), ("b[1]", [0, 5]), ("block.b[1]", [0, 5])):
        found = measured_response(diagram, port, "y", omega=[1.0], amplitude=0.1, step=0.05, at=at)
        np.testing.assert_allclose(found.frdata[:, 0, 0], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"omega": [0.0]}, r"omega = .* must be a positive and finite"),
        ({"amplitude": -1.0}, r"amplitude = -1.0 must be a positive and finite"),
        ({"step": 0.2}, r"step = 0.2 s is less than 10 times within a period of 5 rad/s"),
        ({"step": np.inf}, r"step = inf must be a positive and finite"),
        ({"input": "inertia.y"}, r"'inertia.y' has 2 elements; name one, such as 'block.port\[0\]'"),
        ({"cycles": 0}, r"cycles = 0 must be a positive and finite"),
        ({"tolerance": 0.0}, r"tolerance = 0.0 must be a positive and finite"),
        ({"omega": [1.0, 2.0], "initial": [{}]}, r"initial = .* does not fit 2 frequencies"),
    ],
)
def test_bad_arguments_are_refused(pendulum, change, message):
    arguments: dict[str, Any] = {"input": "torque", "omega": [5.0], "amplitude": 1e-3, "step": 0.01}
    with pytest.raises(LinearAnalysisError, match=message):
        measured_response(pendulum, **arguments | change)

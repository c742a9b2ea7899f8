"""Linear models of continuous diagrams: exact derivatives, between any ports, under their names."""

from itertools import pairwise

import control
import numpy as np
import pytest

from trussflow.blocks import (
    Block,
    Diagram,
    Function,
    Input,
    Linearizer,
    NameLookupError,
    OperatingPoint,
    Output,
    Parameter,
    ParameterError,
    Signals,
    State,
    WiringError,
    linearize,
)
from trussflow.blocks.framework.errors import LinearAnalysisError

ROUND_OFF = 1e-13
POINT = OperatingPoint(states={"arm.q": [0.7, -0.4], "arm.v": [1.3, 0.2]}, inputs={"force": [2, 1]})


class Arm(Block):
    """Two pendulums, coupled; everything in it is nonlinear."""

    u = Input((2,), unit="N")
    q_out = Output((2,), unit="rad")
    power = Output(unit="W")
    q = State((2,), initial=0.1)
    v = State((2,))
    length = Parameter(1.5, unit="m", above=0.0)

    def output(self, t, x, u, p):
        return {"q_out": np.sin(x.q) * p.length, "power": np.sum(u.u * x.v)}

    def derivative(self, t, x, u, p):
        swing = np.sin(x.q) / p.length + 0.3 * np.tanh(x.v * x.q[::-1]) + t * x.v**3
        return {"q": x.v, "v": u.u * np.cos(x.q) - swing}


def driven_arm():
    diagram = Diagram("driven arm")
    arm = diagram.add(arm=Arm())
    diagram.expose(force=arm.u, angle=arm.q_out, power=arm.power)
    return diagram


def richardson(function, point, step=0.02):
    """Return the Jacobian by central differences, extrapolated to step zero."""
    columns = []
    for direction in np.eye(point.size):
        table = []
        for k in range(5):
            h = direction * step / 2**k
            table.append((function(point + h) - function(point - h)) / (2 * step / 2**k))
        for order in range(1, 5):
            weight = 4.0**order
            table = [(weight * b - a) / (weight - 1) for a, b in pairwise(table)]
        columns.append(table[0])
    return np.stack(columns, axis=1)


def equations(block, t, z):
    """Return dq/dt, dv/dt, outputs of the arm by (q, v, u)."""
    x, u = Signals("arm", {"q": z[:2], "v": z[2:4]}), Signals("arm", {"u": z[4:]})
    p = Signals("arm", block.parameters)
    rates, outputs = block.derivative(np.float64(t), x, u, p), block.output(np.float64(t), x, u, p)
    return np.hstack([rates["q"], rates["v"], outputs["q_out"], outputs["power"]])


@pytest.mark.parametrize("time", [0.0, 0.6])
def test_jacobians_agree_with_differences_to_1e_8(time):
    model = linearize(driven_arm(), at=OperatingPoint(time=time, **_given(POINT)))
    z = np.array([0.7, -0.4, 1.3, 0.2, 2.0, 1.0])
    exact = richardson(lambda point: equations(Arm(), time, point), z)
    found = np.block([[model.A, model.B], [model.C, model.D]])
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-8)


def _given(point):
    return {"states": point.states, "inputs": point.inputs}


def test_names_units_and_the_point_come_with_the_model():
    model = linearize(driven_arm(), at=POINT)
    assert isinstance(model, control.StateSpace)
    assert model.name == "driven_arm"
    assert model.isctime()
    assert model.input_labels == ["force[0]", "force[1]"]
    assert model.output_labels == ["angle[0]", "angle[1]", "power"]
    assert model.state_labels == ["arm/q[0]", "arm/q[1]", "arm/v[0]", "arm/v[1]"]
    assert model.input_units == ["N", "N"]
    assert model.output_units == ["rad", "rad", "W"]
    assert model.derivatives == {}
    np.testing.assert_allclose(model.operating_point.states["arm.q"], [0.7, -0.4], rtol=ROUND_OFF)
    np.testing.assert_allclose(
        model.operating_point.outputs["angle"], 1.5 * np.sin([0.7, -0.4]), rtol=ROUND_OFF
    )
    np.testing.assert_allclose(model.operating_point.outputs["power"], 2 * 1.3 + 0.2, rtol=ROUND_OFF)


def test_a_single_block_is_linearized_as_it_is():
    block, diagram = Arm(), linearize(driven_arm(), at=POINT)
    at = OperatingPoint(states={"Arm.q": [0.7, -0.4], "Arm.v": [1.3, 0.2]}, inputs={"u": [2, 1]})
    model = linearize(block, at=at)
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(model, name), getattr(diagram, name))
    assert model.input_labels == ["u[0]", "u[1]"]


@pytest.mark.parametrize("index", ["[0]", "[1:2]", "[::-1]", "[-1]", "[:]"])
@pytest.mark.parametrize("where", ["force", "arm.u"])
def test_slices_select_rows_and_columns_in_their_order(index, where):
    diagram = driven_arm()
    whole = linearize(diagram, at=POINT)
    model = linearize(diagram, [where + index], ["arm.q_out" + index], at=POINT)
    chosen = np.atleast_1d(eval(f"np.arange(2){index}"))
    np.testing.assert_array_equal(model.B, whole.B[:, chosen])
    np.testing.assert_array_equal(model.C, whole.C[:2][chosen])
    label = where.replace(".", "/")
    assert model.input_labels == [f"{label}[{i}]" for i in chosen]
    assert model.output_labels == [f"arm/q_out[{i}]" for i in chosen]


def test_ports_as_objects_mean_the_same_as_text():
    diagram = driven_arm()
    text = linearize(diagram, "arm.u[1]", "arm.power", at=POINT)
    ports = linearize(diagram, diagram.arm.u[1], [diagram.arm.power], at=POINT)
    np.testing.assert_array_equal(text.B, ports.B)
    np.testing.assert_array_equal(text.D, ports.D)
    assert (text.input_labels, text.output_labels) == (ports.input_labels, ports.output_labels)


def test_parameters_of_the_point_count_and_a_linearizer_serves_many_points():
    linearizer = Linearizer(driven_arm())
    for length in (0.5, 2.0):
        model = linearizer.at(OperatingPoint(parameters={"arm.length": length}))
        assert model.A[2, 0] == pytest.approx(-np.cos(0.1) / length, abs=ROUND_OFF)
        assert model.operating_point.parameters == {"arm.length": length}
    np.testing.assert_array_equal(linearizer.point().states["arm.q"], [0.1, 0.1])


def test_directions_differentiate_exactly_what_has_no_simple_form():
    """The complex step is exact to round-off."""
    matrix = np.array([[2.0, 0.3], [0.1, 1.5]])

    def law(x, y):
        return np.linalg.solve(matrix + np.outer(x, y), x * np.exp(y))

    two = {"x": Input((2,)), "y": Input((2,))}
    model = linearize(
        Function(law, inputs=two, outputs={"z": Output((2,))}),
        at=OperatingPoint(inputs={"x": [0.2, -0.5], "y": [1.0, 0.3]}),
    )
    for k in range(4):
        z = np.array([0.2, -0.5, 1.0, 0.3], dtype=complex)
        z[k] += 1e-30j
        np.testing.assert_allclose(model.D[:, k], law(z[:2], z[2:]).imag / 1e-30, rtol=1e-13)


def test_python_control_takes_the_model_as_its_own():
    model = linearize(driven_arm(), "arm.u[0]", "arm.q_out[0]", at=POINT)
    closed = control.feedback(model * 2.0, 1)
    assert type(closed) is control.StateSpace
    np.testing.assert_allclose(
        np.sort_complex(closed.poles()), np.sort_complex(np.linalg.eigvals(closed.A)), rtol=ROUND_OFF
    )
    control.bode_plot(model, np.geomspace(0.1, 10, 9))
    omega = np.array([0.3, 3.0])
    expected = model.C @ np.linalg.inv(3j * np.eye(4) - model.A) @ model.B + model.D
    assert model(3j) == pytest.approx(expected[0, 0])
    assert control.frequency_response(model, omega).frdata.shape[-1] == 2


# -- what makes no sense -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (
            ("arm.v", "angle"),
            NameLookupError,
            r"'arm' \(Arm\) has no port 'v', it is a state.*; inputs: u; outputs: "
            "q_out, power",
        ),
        (("leg.u", "angle"), NameLookupError, r"no block 'leg' for 'leg.u'; the blocks are: arm$"),
        (("forc", "angle"), NameLookupError, r"has no port 'forc'; inputs: force; outputs: angle"),
        ((7, "angle"), NameLookupError, r"name a port, as a port or as 'block.port'; not 7"),
        (("arm.u[x]", "angle"), NameLookupError, r"an index is made of integers and slices"),
        (("arm.u[1:2:3:4]", "angle"), NameLookupError, r"an index is made of integers and slices"),
        (("arm.u[2]", "angle"), WiringError, r"index \[2\] does not fit 'arm.u'"),
        (([], "angle"), LinearAnalysisError, r"without inputs: name ports with inputs=\[...\]"),
        (("force", []), LinearAnalysisError, r"without outputs: name ports with outputs="),
        ((["arm.u[0]", "arm.u"], "angle"), LinearAnalysisError, r"inputs name elements twice: arm/u\[0\]"),
        (("arm.power", "angle"), LinearAnalysisError, r"nothing reads 'arm.power', so nothing can"),
    ],
)
def test_unknown_ports_are_refused_with_the_valid_ones(arguments, error, message):
    with pytest.raises(error, match=message):
        linearize(driven_arm(), *arguments)


def test_ports_of_other_diagrams_are_refused():
    with pytest.raises(NameLookupError, match=r"port 'arm.u' is not in this diagram"):
        linearize(driven_arm(), driven_arm().arm.u)


def test_cuts_must_name_what_is_put_in_or_read_out():
    message = r"'arm.u' is cut, but 'arm.u\[0\]' is put in or read out: name the same elements"
    with pytest.raises(LinearAnalysisError, match=message):
        linearize(driven_arm(), "arm.u[0]", "angle", cut="arm.u")
    with pytest.raises(LinearAnalysisError, match=message):
        linearize(driven_arm(), "arm.u", "arm.u[0]", cut="arm.u")


@pytest.mark.parametrize(
    ("point", "error", "message"),
    [
        ({"states": {"arm.p": 0.0}}, NameLookupError, r"no state 'arm.p'; .* arm.q, arm.v"),
        ({"states": {"arm.q": [1, 2, 3]}}, ParameterError, r"'arm.q' has shape \(3,\)"),
        ({"inputs": {"f": 0.0}}, NameLookupError, r"no input 'f'; the inputs .* are: force"),
        ({"held": {"arm.u": 0.0}}, NameLookupError, r"no held output 'arm.u'; .* are: none"),
        ({"parameters": {"arm.l": 0.0}}, NameLookupError, r"no parameter 'arm.l'; .* arm.length"),
        ({"parameters": {"arm.length": 0.0}}, ParameterError, r"'length'"),
    ],
)
def test_points_that_name_what_is_not_there_are_refused(point, error, message):
    with pytest.raises(error, match=message):
        linearize(driven_arm(), at=OperatingPoint(**point))

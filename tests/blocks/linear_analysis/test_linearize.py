"""Linear models of continuous diagrams: exact derivatives, between any ports, under their names."""

from dataclasses import replace
from functools import partial

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import block_diag
from systems import assert_near, jacobian, ports

from trussflow.blocks import (
    Block,
    Diagram,
    Function,
    Input,
    Linearizer,
    OperatingPoint,
    Output,
    Parameter,
    Signals,
    State,
    StateSpace,
    linearize,
    modal_table,
)
from trussflow.blocks.errors import (
    LinearAnalysisError,
    NameLookupError,
    ParameterError,
    WiringError,
)

ROUND_OFF = 1e-13
POINT = OperatingPoint(
    states={"arm.q": [0.7, -0.4], "arm.v": [1.3, 0.2]}, inputs={"force": [2, 1]}
)


class Arm(Block):
    """Two pendulums, coupled; everything in it is nonlinear."""

    u = Input(2, unit="N")
    q_out = Output(2, unit="rad")
    power = Output(unit="W")
    q = State(2, initial=0.1)
    v = State(2)
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


def equations(t, z):
    """Return dq/dt, dv/dt and the outputs of the arm by (q, v, u)."""
    x = Signals("arm", {"q": z[:2], "v": z[2:4]})
    u = Signals("arm", {"u": z[4:]})
    arm = Arm()
    p = Signals("arm", arm.parameters)
    values = arm.derivative(t, x, u, p) | arm.output(t, x, u, p)
    return np.hstack([*values.values()])


@pytest.mark.parametrize("time", [0.0, 0.6])
def test_jacobians_are_exact(time):
    model = linearize(driven_arm(), at=replace(POINT, time=time))
    exact = jacobian(
        partial(equations, time), np.array([0.7, -0.4, 1.3, 0.2, 2.0, 1.0])
    )
    found = np.block([[model.A, model.B], [model.C, model.D]])
    assert_near(found, exact, ROUND_OFF)


def test_names_units_and_the_point_come_with_the_model():
    model = linearize(driven_arm(), at=POINT)
    assert isinstance(model, control.StateSpace)
    assert model.name == "driven_arm"
    assert model.isctime()
    assert model.input_labels == ["force[0]", "force[1]"]
    assert model.output_labels == ["angle[0]", "angle[1]", "power"]
    assert model.state_labels == ["arm/q[0]", "arm/q[1]", "arm/v[0]", "arm/v[1]"]
    assert model.derivatives == {}
    outputs = model.operating_point.outputs
    assert_allclose(outputs["angle"], 1.5 * np.sin([0.7, -0.4]), rtol=ROUND_OFF)


@pytest.mark.parametrize("index", ["[0]", "[1:2]", "[::-1]", "[-1]", "[:]"])
@pytest.mark.parametrize("where", ["force", "arm.u"])
def test_slices_select_rows_and_columns_in_their_order(index, where):
    diagram = driven_arm()
    whole = linearize(diagram, at=POINT)
    model = linearize(
        diagram, [where + index], [eval(f"diagram.arm.q_out{index}")], at=POINT
    )
    chosen = np.atleast_1d(eval(f"np.arange(2){index}"))
    assert_array_equal(model.B, whole.B[:, chosen])
    assert_array_equal(model.C, whole.C[:2][chosen])
    label = where.replace(".", "/")
    assert model.input_labels == [f"{label}[{i}]" for i in chosen]
    assert model.output_labels == [f"arm/q_out[{i}]" for i in chosen]


def test_parameters_of_the_point_count_and_a_linearizer_serves_many_points():
    linearizer = Linearizer(driven_arm())
    for length in (0.5, 2.0):
        model = linearizer.at(OperatingPoint(parameters={"arm.length": length}))
        assert model.A[2, 0] == pytest.approx(-np.cos(0.1) / length, abs=ROUND_OFF)
        assert model.operating_point.parameters == {"arm.length": length}
    assert_array_equal(linearizer.at().operating_point.states["arm.q"], [0.1, 0.1])


def test_directions_differentiate_exactly_what_has_no_simple_form():
    """The complex step is exact to round-off."""
    matrix = np.array([[2.0, 0.3], [0.1, 1.5]])

    def law(x, y):
        return np.linalg.solve(matrix + np.outer(x, y), x * np.exp(y))

    model = linearize(
        Function(law, **ports(x=2, y=2, z=2)),
        at=OperatingPoint(inputs={"x": [0.2, -0.5], "y": [1.0, 0.3]}),
    )
    exact = jacobian(lambda z: law(z[:2], z[2:]), np.array([0.2, -0.5, 1.0, 0.3]))
    assert_allclose(model.D, exact, rtol=1e-13)


# -- what makes no sense -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments, error, message",
    [
        (
            ("arm.v", "angle"),
            NameLookupError,
            r"'arm' \(Arm\) has no port 'v', it is a state.*; inputs: u; outputs: q_out, power",
        ),
        (
            ("leg.u", "angle"),
            NameLookupError,
            r"no block 'leg' for 'leg.u'; the blocks are: arm$",
        ),
        (
            ("forc", "angle"),
            NameLookupError,
            r"has no port 'forc'; inputs: force; outputs: angle",
        ),
        (
            (7, "angle"),
            NameLookupError,
            r"name a port, as a port or as 'block.port'; not 7",
        ),
        (
            ("arm.u[x]", "angle"),
            NameLookupError,
            r"an index is made of integers and slices",
        ),
        (
            ("arm.u[1:2:3:4]", "angle"),
            NameLookupError,
            r"an index is made of integers and slices",
        ),
        (("arm.u[2]", "angle"), WiringError, r"index \[2\] does not fit 'arm.u'"),
        (
            ([], "angle"),
            LinearAnalysisError,
            r"without inputs: name ports with inputs=\[...\]",
        ),
        (
            ("force", []),
            LinearAnalysisError,
            r"without outputs: name ports with outputs=",
        ),
        (
            (["arm.u[0]", "arm.u"], "angle"),
            LinearAnalysisError,
            r"inputs name elements twice: arm/u\[0\]",
        ),
        (
            ("arm.power", "angle"),
            LinearAnalysisError,
            r"nothing reads 'arm.power', so it cannot",
        ),
    ],
)
def test_unknown_ports_are_refused_with_the_valid_ones(arguments, error, message):
    with pytest.raises(error, match=message):
        linearize(driven_arm(), *arguments)


def test_ports_of_other_diagrams_are_refused():
    with pytest.raises(NameLookupError, match=r"port 'arm.u' is not in this diagram"):
        linearize(driven_arm(), driven_arm().arm.u)


@pytest.mark.parametrize("between", [("arm.u[0]", "angle"), ("arm.u", "arm.u[0]")])
def test_cuts_must_name_an_input_or_output_of_the_model(between):
    message = r"'arm.u' is cut, but 'arm.u\[0\]' is put in or read out: name the same elements"
    with pytest.raises(LinearAnalysisError, match=message):
        linearize(driven_arm(), *between, cut="arm.u")


@pytest.mark.parametrize(
    "point, error, message",
    [
        (
            {"states": {"arm.p": 0.0}},
            NameLookupError,
            r"no state 'arm.p'; .* arm.q, arm.v",
        ),
        ({"states": {"arm.q": [1, 2, 3]}}, ParameterError, r"'arm.q' has shape \(3,\)"),
        (
            {"inputs": {"f": 0.0}},
            NameLookupError,
            r"no input 'f'; the external inputs are: force",
        ),
        (
            {"held": {"arm.u": 0.0}},
            NameLookupError,
            r"no held output 'arm.u'; .* are: none",
        ),
        (
            {"parameters": {"arm.l": 0.0}},
            NameLookupError,
            r"no parameter 'arm.l'; .* arm.length",
        ),
        ({"parameters": {"arm.length": 0.0}}, ParameterError, r"'length'"),
    ],
)
def test_points_that_name_what_is_not_there_are_refused(point, error, message):
    with pytest.raises(error, match=message):
        linearize(driven_arm(), at=OperatingPoint(**point))


@pytest.mark.parametrize("period", [None, 0.01])
def test_modal_table_of_two_springs(period):
    """Damping ratios of 2 % and -1 %, with two real poles."""
    rates = {20.0: 0.02, 5.0: -0.01}
    springs = [np.array([[0.0, 1.0], [-(w**2), -2 * z * w]]) for w, z in rates.items()]
    B = np.zeros((6, 2))
    B[1], B[3, 1], B[4:] = [3.0, 4.0], 7.0, 1.0
    plant = StateSpace(block_diag(*springs, 0.0, -3.0), B, np.eye(6))
    found = modal_table(
        plant if period is None else control.sample_system(linearize(plant), period)
    )
    assert [2 * np.pi * mode.frequency for mode in found.modes] == pytest.approx(
        [5.0, 20.0]
    )
    assert [mode.damping_ratio for mode in found.modes] == pytest.approx([-0.01, 0.02])
    shares = [list(mode.shares.values()) for mode in found.modes]
    assert_allclose(shares, [[0.0, 1.0], [0.36, 0.64]], rtol=1e-9, atol=1e-15)
    assert "mode 2  3.183 Hz   2.000%         u[1] 64%, u[0] 36%" in repr(found)

"""Names, vectors, units and values of a block from an FMU's description."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import assert_near, series

from trussflow.blocks import Constant, Diagram, Ramp, Session, simulate
from trussflow.blocks.errors import BlockError
from trussflow.fmu import Fmu, FmuError, FmuUnitError
from trussflow.fmu.fmi_units import FmiUnit
from trussflow.fmu.importing.unit_table import UnitTable
from trussflow.fmu.runtime.array_ports import gather, legal_names
from trussflow.fmu.runtime.description import FmuDescription, FmuVariable

ZEROS = {"u": 0.0, "number": 0.0, "flag": 0.0}


def variables(names, causality="input"):
    return [
        FmuVariable(name, i, "Real", causality, "continuous", "", "0", "", ())
        for i, name in enumerate(names)
    ]


@pytest.mark.parametrize(
    "names, expected",
    [
        (["u[1]", "u[2]", "u[3]"], [("u", (3,))]),
        (["u[0]", "u[1]"], [("u", (2,))]),
        (["u[1]"], [("u", (1,))]),
        (["u[2]", "u[1]"], [("u", (2,))]),
        (
            ["J[1,1]", "J[1,2]", "J[2,1]", "J[2, 2]", "J[3,1]", "J[3,2]"],
            [("J", (3, 2))],
        ),
        (["a.b[1]", "a.b[2]", "x"], [("a.b", (2,)), ("x", ())]),
        (["der(x[1])", "der(x[2])"], [("der(x)", (2,))]),
        (["arm[1].q", "arm[2].q"], [("arm[1].q", ()), ("arm[2].q", ())]),
        (["u[1]", "u[3]"], [("u[1]", ()), ("u[3]", ())]),  # a gap
        (["u[5]", "u[6]"], [("u[5]", ()), ("u[6]", ())]),  # counts from five
        (["u[1]", "u[1,1]"], [("u[1]", ()), ("u[1,1]", ())]),  # two shapes
        # the name is taken
        (["u[1]", "u[2]", "u"], [("u[1]", ()), ("u[2]", ()), ("u", ())]),
    ],
)
def test_scalars_become_arrays(names, expected):
    assert [(g.name, g.shape) for g in gather(variables(names))] == expected


def test_elements_stand_in_row_major_order():
    group = gather(variables(["J[2,2]", "J[1,2]", "J[2,1]", "J[1,1]"]))[0]
    assert [v.name for v in group.variables] == ["J[1,1]", "J[1,2]", "J[2,1]", "J[2,2]"]


def test_elements_of_two_kinds_stay_apart():
    mixed = variables(["u[1]"]) + variables(["u[2]"], "parameter")
    assert [g.name for g in gather(mixed)] == ["u[1]", "u[2]"]


def test_legal_names():
    names = ["arm.q", "der(x)", "u[3]", "for", "2nd", "arm_q", "name", "α β", "[]"]
    legal = [
        "arm_q",
        "der_x",
        "u_3",
        "for_",
        "_2nd",
        "arm_q_",
        "name_",
        "α_β",
        "variable",
    ]
    assert list(legal_names(names, {"name"}).values()) == legal


# -- units ----------------------------------------------------------------------------------------


def table(name, definition=None, factor=1.0, offset=0.0, given=None):
    unit = FmiUnit(name, definition, factor, offset)
    return UnitTable(FmuDescription("m", 2, "", {}, {}, {name: unit}, {}), given)


@pytest.mark.parametrize(
    "theirs, base, factor, ours",
    [
        ("N.m", {"kg": 1, "m": 2, "s": -2}, 1.0, "N*m"),
        ("m/s2", {"m": 1, "s": -2}, 1.0, "m/s**2"),
        ("kg.m2", {"kg": 1, "m": 2}, 1.0, "kg*m**2"),
        ("W/(m2.K)", {"kg": 1, "s": -3, "K": -1}, 1.0, "W/(m**2*K)"),
        ("s-1", {"s": -1}, 1.0, "s**-1"),
        ("rad/s", {"rad": 1, "s": -1}, 1.0, "rad/s"),
        ("rad/s", {"s": -1}, 1.0, "rad/s"),  # many tools leave out the radian
        ("deg", {"rad": 1}, np.pi / 180, "deg"),
        ("1", {}, 1.0, ""),
        ("-", None, 1.0, ""),
        ("kN", {"kg": 1, "m": 1, "s": -2}, 1000.0, "kN"),
        ("N.m", None, 1.0, "N*m"),
        # as our own exports write modal quantities
        ("kg**0.5*m", None, 1.0, "kg**0.5*m"),
        ("thrust", {"kg": 1, "m": 1, "s": -2}, 1.0, "kg*m*s**-2"),  # by its definition
    ],
)
def test_units_in_our_words(theirs, base, factor, ours):
    assert table(theirs, base, factor).unit(theirs) == ours


def test_degrees_celsius_keep_their_zero():
    assert table("degC", {"K": 1}, 1.0, 273.15).unit("degC") == "degC"


def test_unknown_units_can_be_named():
    with pytest.raises(
        FmuUnitError,
        match="the unit 'smoot', which is unknown and which the FMU does not define",
    ):
        table("smoot").unit("smoot")
    with pytest.raises(
        FmuUnitError, match=r"defines its unit 'smoot' as 1\.7 m; .*no equal unit"
    ):
        table("smoot", {"m": 1}, 1.7).unit("smoot")
    assert table("smoot", given={"smoot": "m"}).unit("smoot") == "m"
    with pytest.raises(
        FmuUnitError, match="has no unit 'furlong'; its units are: smoot"
    ):
        table("smoot", given={"furlong": "m"})
    with pytest.raises(FmuUnitError, match="cannot use 'blah' for 'smoot'"):
        table("smoot", given={"smoot": "blah"})


# -- blocks ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "version, flags", [(2, ""), (3, ""), (3, 'hasEventMode="true"')]
)
def test_types_arrays_and_units_of_ports(make_fmu, version, flags):
    block = Fmu(make_fmu("types", version, flags=flags), kind="cs", step=0.1)
    assert block.u.unit == block.y.unit == "N*m"
    diagram = Diagram("types")
    diagram.add(
        fmu=block,
        torque=Constant(1.5, unit="N*m"),
        number=Constant(7.0),
        on=Constant(1.0),
    )
    diagram.torque >> diagram.fmu.u
    diagram.number >> diagram.fmu.number
    diagram.on >> diagram.fmu.flag
    if version == 3:
        diagram.add(vector=Constant([1.0, 2.0, 3.0]))
        diagram.vector >> diagram.fmu.in_
    result = simulate(diagram, 0.3, step=0.1)
    for name, expected in (("y", 3.0), ("next", 8.0), ("inverse", 0.0)):
        assert_array_equal(result[f"fmu.{name}"], expected)
    if version == 3:
        assert_array_equal(result["fmu.out"][-1].values, [2.0, 4.0, 6.0])


def test_a_unit_may_be_only_a_name(make_fmu):
    """A unit that the FMU does not define has the meaning that it has here."""
    path = make_fmu("ball", replace={'<BaseUnit m="1" s="-2"/>': ""})
    assert Fmu(path, step=0.1).description.units["m/s2"].exponents is None


BLOB = (
    '<Binary name="blob" valueReference="900" causality="parameter" variability="fixed">'
    '<Start value="00"/></Binary></ModelVariables>'
)
BALL = ("ball", 2, {})
TYPES = ("types", 3, {})
WITH_BLOB = ("types", 3, {"</ModelVariables>": BLOB})


@pytest.mark.parametrize(
    "fmu, settings, message",
    [
        (
            BALL,
            {"parameters": {"gg": 1.0}},
            r"no variable 'gg' that can be set; some that can: .*g",
        ),
        (
            BALL,
            {"parameters": {"der(h)": 1.0}},
            r"'der\(h\)' cannot be set; it is local, continuous, and",
        ),
        (BALL, {"parameters": {"g": [1.0, 2.0]}}, "'g' has 1 elements, not 2"),
        (BALL, {"parameters": {"g": "much"}}, "'g' must be a number, not 'much'"),
        (BALL, {"parameters": {"g": np.inf}}, "'g' must be finite"),
        (BALL, {"parameters": {"text": 3.0}}, r"'text' takes 1 text\(s\)"),
        (
            BALL,
            {"parameters": {"g": 1.0}, "start": {"g": 1.0}},
            "'g' is given both as a parameter and as a start value",
        ),
        (TYPES, {"start": {"n": -1}}, r"'n' sets array sizes; .* not -1"),
        (
            TYPES,
            {"start": {"in": [1.0, 2.0, 3.0]}},
            "input 'in' can be given one value for all its elements",
        ),
        (
            WITH_BLOB,
            {"start": {"blob": 1}},
            "'blob' is of type Binary, which cannot be set from here",
        ),
        (BALL, {"kind": "cs", "step": None}, "suggests no step size; give step"),
        (BALL, {"step": 0.0}, r"every 0\.0 s(.|\n)*must be positive and finite"),
        (BALL, {"kind": "me"}, "the diagram's solver sets the step .*; leave out step"),
        (
            BALL,
            {"kind": "me", "step": None, "delayed": True},
            "inputs are not held; leave out step and delayed",
        ),
        (
            BALL,
            {"memory_limit": 1e9},
            "memory_limit needs a child process; give time_limit too",
        ),
        *(
            (BALL, {option: value}, f"{option} = .* must be a positive and finite")
            for option in ("tolerance", "time_limit", "memory_limit")
            for value in (0.0, np.inf, np.nan)
        ),
    ],
)
def test_settings_that_are_refused(make_fmu, fmu, settings, message):
    model, version, replace = fmu
    path = make_fmu(model, version, replace=replace)
    with pytest.raises((FmuError, BlockError, TypeError), match=message):
        Fmu(path, **({"step": 0.1} | settings))


def test_a_step_may_come_from_the_fmu(make_fmu):
    experiment = '<DefaultExperiment stepSize="0.25"/><ModelVariables>'
    assert (
        Fmu(make_fmu("ball", replace={"<ModelVariables>": experiment})).sample_time
        == 0.25
    )


def test_variables_that_cannot_be_set_are_no_parameters(make_fmu):
    model, version, replace = WITH_BLOB
    assert (
        "blob" not in Fmu(make_fmu(model, version, replace=replace), step=0.1).variables
    )


def ball(make_fmu, version, kind, **settings):
    return Fmu(
        make_fmu("ball", version),
        kind=kind,
        step=0.1 if kind == "cs" else None,
        **settings,
    )


@pytest.mark.parametrize("version, time_limit", [(2, None), (3, None), (3, 20.0)])
def test_parameters_and_start_values(make_fmu, version, kind, time_limit):
    """A ball on the moon, let go at 2 m with 1 m/s: a parabola; by name, by run, and tuned."""
    moon = {
        "parameters": {"g": 1.6},
        "start": {"h": 2.0, "v": 1.0},
        "time_limit": time_limit,
    }
    diagram = series("moon", fmu=ball(make_fmu, version, kind, **moon))
    assert diagram.fmu.variables["g"] == ("g",)
    for g, parameters in ((1.6, {}), (3.7, {"fmu.g": 3.7})):
        result = simulate(diagram, 0.5, step=0.1, parameters=parameters)
        t = result["time"].values
        assert_near(result["fmu.h"], 2 + t - g * t**2 / 2, 1e-12)


def test_parameters_may_be_tuned(make_fmu, version, kind):
    """Gravity ends at 0.2 s; from there on the ball keeps its speed."""
    with Session(ball(make_fmu, version, kind), step=0.1) as session:
        session.advance(0.2)
        session.tune({f"{session.prepared.plan.python_blocks[0].path}.g": 0.0})
        session.advance(0.4)
        exact = 1 - 9.81 * 0.2**2 / 2 - 9.81 * 0.2 * 0.2
        assert session.outputs["h"] == pytest.approx(exact, abs=1e-12)


def test_gathered_parameters(make_fmu):
    """Two scalars with indices are one vector parameter, and either name reaches them."""
    path = make_fmu(
        "ball", replace={'name="g"': 'name="k[1]"', 'name="hmax"': 'name="k[2]"'}
    )
    block = Fmu(path, kind="me", parameters={"k": [1.6, 7.0]})
    assert_array_equal(block.parameters["k"], [1.6, 7.0])
    assert block.variables["k"] == ("k[1]", "k[2]")
    assert_array_equal(
        Fmu(path, kind="me", parameters={"k[2]": 7.0}).parameters["k"], [9.81, 7.0]
    )
    diagram = series(fmu=block)
    last = simulate(diagram, 0.5, step=0.1)["fmu.h"][-1]
    assert last.item() == pytest.approx(1 - 1.6 * 0.125, abs=1e-12)
    with pytest.raises(
        FmuError, match=r"'k\[1\]' is given two values, the second by 'k\[1\]'"
    ):
        Fmu(path, kind="me", parameters={"k": [1.6, 7.0], "k[1]": 2.0})


@pytest.mark.parametrize("delayed", [False, True])
def test_outputs_may_be_delayed_on_purpose(make_fmu, delayed):
    """Y = 2 u directly; delayed, it is computed with the input of the instant before."""
    block = Fmu(make_fmu("types"), step=0.1, start=ZEROS, delayed=delayed)
    assert block.feedthrough()["y"] == (() if delayed else ("u",))
    diagram = Diagram("delay")
    ramp = diagram.add(fmu=block, ramp=Ramp())[1]
    ramp >> block.u
    y = simulate(diagram, 0.4, step=0.1)["fmu.y"].values
    expected = 2 * np.array([0.0, 0.1, 0.2, 0.3]) if delayed else 0.2 * np.arange(1, 5)
    assert_allclose(y[1:], expected, rtol=1e-15, atol=1e-15)

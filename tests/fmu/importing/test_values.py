"""Values on their way into an FMU: all arrive, and none is changed to fit a type."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from systems import ports, series

from trussflow.blocks import Constant, Diagram, PythonFunction, Step, simulate
from trussflow.fmu import Fmu, FmuError
from trussflow.fmu.runtime.description import INTEGER_TYPES, FmuVariable
from trussflow.fmu.runtime.library3 import Library3
from trussflow.fmu.runtime.variable_buffers import VariableBuffers

VARIABLE = FmuVariable("a", 0, "Real", "input", "continuous", "", "0", "", ())


@pytest.mark.parametrize(
    "chosen, gains",
    [
        ({}, 2.0),
        ({"n": 3, "gains": 0.0}, 0.0),
        ({"n": 5}, None),
        ({"n": 5, "gains": 0.0}, 0.0),
        ({"n": 5, "gains": [0, 0, 3, 0, 0]}, [0.0, 0, 3, 0, 0]),
        ({"n": 2, "gains": 2.0}, 2.0),
    ],
)
def test_a_resized_array_has_the_values_of_the_block(make_fmu, chosen, gains):
    """Zeros are sent too. Values of the FMU's own are unknown after resizing: then it is no parameter."""
    others = {"in": 1.0, "u": 0.0, "number": 0.0, "flag": 0.0}
    block = Fmu(make_fmu("types", 3), kind="cs", step=0.1, start=others | chosen)
    diagram = series(fmu=block)
    expected = np.broadcast_to(2.0 if gains is None else gains, block.out.shape)
    assert (gains is None) == ("gains" not in block.parameters)
    if gains is not None:
        assert_array_equal(block.parameters["gains"], expected)
    assert_array_equal(simulate(diagram, 0.1, step=0.1)["fmu.out"].values[-1], expected)


@pytest.mark.parametrize("kind", [*INTEGER_TYPES, "Float32", "Boolean"])
@example(2.0**63)
@example(2.0**64)
@example(1e300)
@given(
    value=st.one_of(
        st.floats(-1e300, 1e300),
        st.integers(-(2**70), 2**70).map(float),
        st.integers(0, 70).map(lambda n: 2.0**n),
        st.integers(0, 70).map(lambda n: -(2.0**n)),
    )
)
def test_no_number_is_bent_to_fit_a_type(kind, value):
    """An FMU receives the number itself, or its single precision, or there is an error."""
    variable = replace(VARIABLE, type=kind)
    library = SimpleNamespace(
        accessors=Library3.accessors, description=SimpleNamespace(name="f")
    )
    bank = VariableBuffers([variable], library, writes=True)
    sent = []
    (part,) = bank._parts
    part.call = lambda: sent.append(part.buffer[0].item())
    bank.values[:] = value
    try:
        bank.write()
    except FmuError:
        assert not sent
        exact = value.is_integer() and abs(value) < 2.0 ** (
            64 if kind == "UInt64" else 63
        )
        assert not (
            exact and kind.endswith("Int64") and (value >= 0 or kind == "Int64")
        )
    else:
        assert sent[0] == (
            pytest.approx(value, rel=1e-7, abs=1e-45) if kind == "Float32" else value
        )


@pytest.mark.parametrize("value", [2**53 + 1, 2**63 - 1, [2**64 - 1]])
def test_whole_numbers_that_no_float_is_are_refused(make_fmu, value):
    """They became the next float, and 2^63 - 1 as Int64 became -2^63."""
    path = make_fmu(
        "types", 3, replace={'<Int32 name="number"': '<Int64 name="number"'}
    )
    with pytest.raises(
        FmuError, match=r"'number' cannot be .*: numbers are passed as floats"
    ):
        Fmu(path, kind="cs", step=0.1, start={"number": value})


@pytest.mark.parametrize("name", ["number", "flag", "fault"])
def test_fractions_of_what_is_whole_are_refused(make_fmu, version, name):
    """They were refused in a run only, and written to SSP without the fraction."""
    with pytest.raises(
        FmuError, match=rf"'{name}' is of type .*; it takes whole numbers, not 2\.5"
    ):
        Fmu(make_fmu("types", version), kind="cs", step=0.1, start={name: 2.5})


def test_states_of_size_zero(make_fmu):
    """A structural parameter may leave no state: then there is the placeholder beside it."""
    more = (
        '<Float64 name="s" valueReference="103" causality="local" variability="continuous" initial="exact" '
        'start="0 0 0"><Dimension valueReference="20"/></Float64><Float64 name="der(s)" valueReference="104" '
        'causality="local" derivative="103"><Dimension valueReference="20"/></Float64></ModelVariables>'
    )
    rate = '<ContinuousStateDerivative valueReference="104"/></ModelStructure>'
    changes = {"</ModelVariables>": more, "</ModelStructure>": rate}
    path = make_fmu("types", 3, ["me"], replace=changes)
    diagram = Diagram("none")
    given = {"n": 0, "u": 1.5, "number": 0.0, "flag": 0.0, "in": 0.0}
    diagram.add(fmu=Fmu(path, kind="me", start=given))
    assert simulate(diagram, 0.2, step=0.1)["fmu.y"].values.tolist() == [3.0, 3.0, 3.0]


@pytest.mark.parametrize("solver", ["rk4", "DOP853"])
def test_discrete_inputs_come_with_the_others(make_fmu, version, solver):
    """Discrete inputs must not arrive one step later than continuous ones."""
    diagram = Diagram("jump")
    fmu = Fmu(
        make_fmu("types", version), kind="me", start={"in": 0.0} if version == 3 else {}
    )
    jump = Step(0.5)
    diagram.add(fmu=fmu, jump=jump)
    for name in ("u", "number", "flag"):
        jump.y >> fmu.port(name)
    result = simulate(diagram, 1.0, step=0.1, solver=solver)
    after = (result["time"].values >= 0.5).astype(float)
    for name, before, change in (("y", 0, 2), ("next", 1, 1), ("inverse", 1, -1)):
        assert_array_equal(result[f"fmu.{name}"], before + change * after)


@pytest.mark.parametrize("every", [None, 0.1])
def test_an_fmu_begins_with_what_python_blocks_show(make_fmu, version, every):
    """It was initialized with zeros, which may not be allowed, and followed them at the start."""
    diagram = Diagram("start")
    given = {"u": 1.5, "flag": 1.0} | ({"in": 0.0} if version == 3 else {})
    diagram.add(
        fmu=Fmu(make_fmu("types", version), kind="me", start=given), goal=Constant(2.0)
    )
    more = PythonFunction(lambda u: u + 1.0, every, **ports(u=(), y=()))
    number = diagram.add("number", more)
    diagram.goal >> number
    number.y >> diagram.fmu.port("number")
    assert simulate(diagram, 0.2, step=0.1)["fmu.next"].values.tolist() == [
        4.0,
        4.0,
        4.0,
    ]


def test_all_states_of_an_fmu_may_be_given(make_fmu, version):
    """It was not initialized then: there was nothing to find out."""
    diagram = series(fmu=Fmu(make_fmu("ball", version), kind="me"))
    result = simulate(
        diagram, 0.2, step=0.1, initial={"fmu.h_state": 3.0, "fmu.v": 1.0}
    )
    t = result["time"].values
    assert_allclose(result["fmu.h"], 3.0 + t - 9.81 * t**2 / 2, rtol=1e-12)

"""Names, references, start values, units and dependencies of an exported block."""

from xml.etree import ElementTree

import numpy as np
import pytest
from systems import Lag, doubled, ports, series

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    DisturbanceObserver,
    Function,
    Integrator,
    Output,
    UnitDelay,
)
from trussflow.blocks.errors import ParameterError
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.model_description import model_description
from trussflow.fmu.fmi_units import fmi_unit


def by_name(item, **settings):
    return {v.name: v for v in ExportInterface.of(item, **settings).variables}


def test_value_references_count_scalars(systems):
    variables = by_name(systems.Oscillator(3))
    references = [r for v in variables.values() for r in v.references]
    assert references == list(range(1, 1 + len(references)))
    words = "time force stiffness cubic damping initial_position q v der(q) der(v) position angle total"
    assert list(variables) == words.split()
    assert list(variables["der(q)"].scalars()) == [
        "der(q[1])",
        "der(q[2])",
        "der(q[3])",
    ]


def test_matrices_are_named_row_by_row(systems):
    axes = by_name(systems.Rotor())["axes"]
    assert list(axes.scalars()) == ["axes[1,1]", "axes[1,2]", "axes[2,1]", "axes[2,2]"]
    assert axes.description() == "units in order: 2 x m, 2 x rad"


def test_parameters_that_only_set_the_start_are_fixed(systems):
    variables = by_name(systems.Oscillator(2))
    kinds = {
        n: v.variability for n, v in variables.items() if v.causality == "parameter"
    }
    tunable = dict.fromkeys(("stiffness", "cubic", "damping"), "tunable")
    assert kinds == tunable | {"initial_position": "fixed"}
    assert variables["q"].initial == "calculated"
    assert variables["v"].initial == "exact"
    assert variables["v"].start.tolist() == [0.0, 0.0]


def test_start_values(systems):
    assert by_name(systems.Rotor())["torque"].start.tolist() == [2.5]
    variables = by_name(
        systems.Oscillator(2), start={"force": [1.0, 2.0]}, parameters={"cubic": 3.0}
    )
    assert variables["force"].start.tolist() == [1.0, 2.0]
    assert variables["cubic"].start.tolist() == [3.0]


def dependencies(item):
    """Return a function from a table and a row to the names of scalars that the row depends on."""
    interface = ExportInterface.of(item)
    names = [name for v in interface.variables for name in v.scalars()]

    def row(table, index):
        return {
            names[i]
            for i in np.flatnonzero(getattr(interface.dependencies, table)[index])
        }

    return row


def test_dependencies_are_those_of_the_equations(systems):
    """Each mass hangs on its own spring; the energy depends on all states and springs."""
    row = dependencies(systems.Oscillator(2))
    springs = {"stiffness[1]", "stiffness[2]"}
    assert row("outputs", 0) == {"q[1]"}
    assert row("outputs", 2) == {"time", "v[1]"}
    assert row("outputs", 3) == {"q[1]", "q[2]", "v[1]", "v[2]", *springs}
    own = {"force[2]", "stiffness[2]", "cubic", "damping", "q[2]", "v[2]"}
    assert row("derivatives", 3) == own
    assert row("initial_outputs", 1) == {"initial_position[2]"}
    assert row("initial_states", 3) == {"v[2]"}


def test_an_output_sampled_now_depends_on_the_input(systems):
    """Between the instants it depends on nothing; at them, on the sampled signal."""
    row = dependencies(systems.hybrid())
    position, held, force = (row("outputs", index) for index in range(3))
    assert position == held == {"plant.q[1]"}
    assert "target[1]" in force
    assert by_name(systems.hybrid())["held"].variability == "discrete"


def test_initial_states_that_follow_from_inputs():
    """The observer starts at z = -L v: v is an input from outside, L a parameter."""
    observer = DisturbanceObserver([2.0, 3.0])
    (state,) = ExportInterface.of(observer).variables.states
    assert state.initial == "calculated"
    assert dependencies(observer)("initial_states", 1) == {"gain[2]", "velocity[2]"}


def test_token_changes_with_equations_names_and_settings(systems):
    base = ExportInterface.of(systems.Oscillator(2)).token
    assert ExportInterface.of(systems.Oscillator(2)).token == base
    assert ExportInterface.of(systems.Oscillator(3)).token != base
    assert ExportInterface.of(systems.Oscillator(2), step=2e-3).token != base
    assert ExportInterface.of(systems.Oscillator(2), solver="RK45").token != base
    assert (
        ExportInterface.of(systems.Oscillator(2), parameters={"cubic": 0.6}).token
        != base
    )


class Clock(Block):
    """A clock whose ports have an unusual name and that of the independent variable."""

    ω = Output()
    time = Output(unit="s")

    def output(self, t, x, u, p):
        return {"ω": t, "time": t}


def test_unusual_names():
    text = model_description(ExportInterface.of(Clock()), "2.0", {"CoSimulation": {}})
    assert 'variableNamingConvention="flat"' in text
    assert 'name="ω"' in text
    names = {name: v.causality for name, v in by_name(Clock()).items()}
    assert names == {"independent_time": "independent", "ω": "output", "time": "output"}


def test_description(version, systems):
    interface = ExportInterface.of(
        systems.Oscillator(2), stop_time=3.0, step=2e-3, tolerance=1e-5
    )
    text = model_description(interface, version, {"CoSimulation": {}})
    for part in (
        'startTime="0.0"',
        'stopTime="3.0"',
        'tolerance="1e-05"',
        'stepSize="0.002"',
        'description="Masses on springs',
    ):
        assert part in text
    shown = ElementTree.fromstring(text).find(
        "UnitDefinitions/Unit[@name='rad/s']/DisplayUnit"
    )
    assert shown.get("name") == "deg/s"


@pytest.mark.parametrize(
    "name, exponents, factor, offset",
    [
        ("N*m", {"kg": 1, "m": 2, "s": -2}, 1.0, 0.0),
        ("km/h", {"m": 1, "s": -1}, 1 / 3.6, 0.0),
        ("degC", {"K": 1}, 1.0, 273.15),
        ("deg", {"rad": 1}, np.pi / 180, 0.0),
        ("1", {}, 1.0, 0.0),
        ("kg**0.5*m", None, 1.0, 0.0),
        # what follows is beyond XML's whole numbers, or all numbers
        ("m**1e300", None, 1.0, 0.0),
        ("km**400", None, 1.0, 0.0),
        ("km**-400", None, 1.0, 0.0),
    ],
)
def test_units(name, exponents, factor, offset):
    unit = fmi_unit(name)
    assert unit.exponents == exponents
    assert unit.factor == pytest.approx(factor, rel=1e-14)
    assert unit.offset == pytest.approx(offset, rel=1e-14)


def test_units_of_angle_are_shown_in_degrees():
    assert fmi_unit("rad/s").display == "deg/s"
    assert fmi_unit("rad**2").display == ""
    assert fmi_unit("m").display == ""


def inverse():
    return Function(lambda u: 1 / u, **ports(u=(), y=()))


def silent():
    return series("silent", one=Constant(1.0))


def slow():
    diagram = Diagram("slow")
    delay = diagram.add(delay=UnitDelay(0.0015))
    diagram.expose(u=delay.u, y=delay.y)
    return diagram


@pytest.mark.parametrize(
    "make, settings, text",
    [
        (silent, {}, r"'silent': it has no output; diagram.expose"),
        (lambda: 3, {}, "cannot export 3: it is neither a block nor a diagram"),
        (
            Integrator,
            {"parameters": {"gian": 1.0}},
            "unknown parameter of .* 'gian'; choose from: in",
        ),
        (Integrator, {"start": {"v": 1.0}}, "unknown input of .* 'v'; choose from: u"),
        (Integrator, {"step": -1.0}, "step = -1.0 must be a positive and finite"),
        (Integrator, {"stop_time": np.inf}, "stop_time = inf must be a positive"),
        (
            inverse,
            {},
            "'y' has no start value: with the inputs and parameters at their start",
        ),
        (
            slow,
            {},
            "cannot export 'slow' with step=0.001: the sample time of 0.0015 s is not a",
        ),
    ],
)
def test_exports_that_are_refused(make, settings, text):
    with pytest.raises(ExportError, match=text):
        ExportInterface.of(make(), **settings)


@pytest.mark.parametrize(
    "settings, text",
    [
        ({"parameters": {"stiffness": -1.0}}, "stiffness"),
        ({"start": {"force": np.nan}}, "input 'force' of .* is not finite"),
        ({"start": {"force": np.ones(3)}}, r"has shape \(3,\); it must have shape"),
    ],
)
def test_values_that_are_refused(systems, settings, text):
    with pytest.raises(ParameterError, match=text):
        ExportInterface.of(systems.Oscillator(2), **settings)


class PythonLag(Lag):
    """A low pass that is Python code."""

    traced = False


def sampled_in_python():
    diagram = doubled(Integrator())
    diagram.expose(u=diagram.source.u)
    return diagram


@pytest.mark.parametrize(
    "make, table",
    [
        (PythonLag, "derivatives"),
        (PythonLag, "outputs"),
        (sampled_in_python, "outputs"),
    ],
)
def test_dependencies_of_python_blocks_are_unknown(make, table):
    assert getattr(ExportInterface.of(make()).dependencies, table).all()

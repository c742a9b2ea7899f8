"""What an exported block shows: names, references, start values, units, dependencies."""

from xml.etree import ElementTree

import numpy as np
import pytest

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    DisturbanceObserver,
    Input,
    Integrator,
    Output,
    ParameterError,
    PythonFunction,
    State,
    UnitDelay,
)
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.model_description import Use, model_description
from trussflow.fmu.fmi_units import fmi_unit


def by_name(interface):
    return {v.name: v for v in interface.variables}


def test_value_references_count_scalars(systems):
    interface = ExportInterface.of(systems.Oscillator(3))
    references = [r for v in interface.variables for r in v.references]
    assert references == list(range(len(references)))
    names = [v.name for v in interface.variables]
    assert names == [
        "time",
        "force",
        "stiffness",
        "cubic",
        "damping",
        "initial_position",
        "q",
        "v",
        "der(q)",
        "der(v)",
        "position",
        "angle",
        "total",
    ]
    assert list(by_name(interface)["der(q)"].scalars()) == ["der(q[1])", "der(q[2])", "der(q[3])"]


def test_matrices_are_named_row_by_row(systems):
    axes = by_name(ExportInterface.of(systems.Rotor()))["axes"]
    assert list(axes.scalars()) == ["axes[1,1]", "axes[1,2]", "axes[2,1]", "axes[2,2]"]
    assert axes.description() == "units in order: 2 x m, 2 x rad"


def test_parameters_that_only_set_the_start_are_fixed(systems):
    variables = by_name(ExportInterface.of(systems.Oscillator(2)))
    kinds = {n: v.variability for n, v in variables.items() if v.causality == "parameter"}
    assert kinds == {
        "stiffness": "tunable",
        "cubic": "tunable",
        "damping": "tunable",
        "initial_position": "fixed",
    }
    assert variables["q"].initial == "calculated"
    assert variables["v"].initial == "exact"
    assert variables["v"].start.tolist() == [0.0, 0.0]


def test_start_values(systems):
    assert by_name(ExportInterface.of(systems.Rotor()))["torque"].start.tolist() == [2.5]
    block = systems.Oscillator(2)
    interface = ExportInterface.of(block, start={"force": [1.0, 2.0]}, parameters={"cubic": 3.0})
    assert by_name(interface)["force"].start.tolist() == [1.0, 2.0]
    assert by_name(interface)["cubic"].start.tolist() == [3.0]
    assert interface.d.tolist() == [1.0, 2.0]


def test_dependencies_are_those_of_the_equations(systems):
    """Each mass hangs on its own spring; the energy depends on all states and springs."""
    interface = ExportInterface.of(systems.Oscillator(2))
    at = {n: v.reference for n, v in by_name(interface).items()}
    outputs = interface.dependencies.outputs
    first = interface.variables.outputs[0].reference
    assert known(outputs[at["position"] - first]) == {at["q"]}
    assert known(outputs[at["angle"] - first]) == {0, at["v"]}
    total = {at["q"], at["q"] + 1, at["v"], at["v"] + 1, at["stiffness"], at["stiffness"] + 1}
    assert known(outputs[at["total"] - first]) == total
    rates = interface.dependencies.derivatives
    assert known(rates[3]) == {
        at["force"] + 1,
        at["stiffness"] + 1,
        at["cubic"],
        at["damping"],
        at["q"] + 1,
        at["v"] + 1,
    }
    start = interface.dependencies.initial_outputs
    assert known(start[1]) == {at["initial_position"] + 1}
    assert known(interface.dependencies.initial_states[3]) == {at["v"] + 1}


def known(row):
    return {int(i) for i in np.flatnonzero(row)}


def test_an_output_sampled_now_depends_on_the_input(systems):
    """Between the instants it depends on nothing; at them, on what is sampled."""
    interface = ExportInterface.of(systems.hybrid())
    at = {n: v.reference for n, v in by_name(interface).items()}
    first = interface.variables.outputs[0].reference
    outputs = interface.dependencies.outputs
    assert known(outputs[at["held"] - first]) == {at["plant.q"]}
    assert at["target"] in known(outputs[at["force"] - first])
    assert by_name(interface)["held"].variability == "discrete"


def test_nothing_is_known_of_python_blocks():
    diagram = Diagram("python")
    double = PythonFunction(lambda u: 2 * u, 0.1, inputs={"u": Input()}, outputs={"y": Output()})
    one, double = diagram.add(one=Integrator(), double=double)
    one >> double
    diagram.expose(u=one.u, y=double.y)
    interface = ExportInterface.of(diagram)
    assert interface.dependencies.outputs.all()


def test_initial_states_that_follow_from_inputs():
    """The observer starts at z = -L v: v is an input from outside, L a parameter."""
    interface = ExportInterface.of(DisturbanceObserver([2.0, 3.0]))
    at = {n: v.reference for n, v in by_name(interface).items()}
    (state,) = interface.variables.states
    assert state.initial == "calculated"
    assert known(interface.dependencies.initial_states[1]) == {at["gain"] + 1, at["velocity"] + 1}


def test_token_changes_with_equations_names_and_settings(systems):
    base = ExportInterface.of(systems.Oscillator(2)).token
    assert ExportInterface.of(systems.Oscillator(2)).token == base
    assert ExportInterface.of(systems.Oscillator(3)).token != base
    assert ExportInterface.of(systems.Oscillator(2), step=2e-3).token != base
    assert ExportInterface.of(systems.Oscillator(2), parameters={"cubic": 0.6}).token != base


def test_names_outside_the_convention_make_it_flat():
    class Greek(Block):
        ω = Output()

        def output(self, t, x, u, p):
            return {"ω": t}

    text = model_description(ExportInterface.of(Greek()), "2.0", [Use("CoSimulation")])
    assert 'variableNamingConvention="flat"' in text
    assert 'name="ω"' in text


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_description(version, systems):
    interface = ExportInterface.of(systems.Oscillator(2), stop_time=3.0, step=2e-3, tolerance=1e-5)
    root = ElementTree.fromstring(model_description(interface, version, [Use("CoSimulation")]))
    experiment = root.find("DefaultExperiment")
    assert experiment is not None
    assert experiment.attrib == {
        "startTime": "0.0",
        "stopTime": "3.0",
        "tolerance": "1e-05",
        "stepSize": "0.002",
    }
    assert root.get("description", "").startswith("Masses on springs")
    shown = root.find("UnitDefinitions/Unit[@name='rad/s']/DisplayUnit")
    assert shown is not None
    assert shown.get("name") == "deg/s"


@pytest.mark.parametrize(
    ("name", "exponents", "factor", "offset"),
    [
        ("N*m", {"kg": 1, "m": 2, "s": -2}, 1.0, 0.0),
        ("km/h", {"m": 1, "s": -1}, 1 / 3.6, 0.0),
        ("degC", {"K": 1}, 1.0, 273.15),
        ("deg", {"rad": 1}, np.pi / 180, 0.0),
        ("1", {}, 1.0, 0.0),
        ("kg**0.5*m", None, 1.0, 0.0),
        ("m**1e300", None, 1.0, 0.0),  # what follows is beyond XML's whole numbers, or all numbers
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
    assert fmi_unit("rad/s").display == (("deg/s", 180 / np.pi),)
    assert fmi_unit("rad**2").display == ()
    assert fmi_unit("m").display == ()


class Inverse(Block):
    """1 / u, which nothing at zero defines."""

    y = Output()

    def __init__(self):
        self.extra_ports = {"u": Input()}
        super().__init__()

    def output(self, t, x, u, p):
        return {"y": 1 / u.u}


def silent():
    diagram = Diagram("silent")
    diagram.add(one=Constant(1.0))
    return diagram


def slow():
    diagram = Diagram("slow")
    delay = diagram.add(delay=UnitDelay(0.0015))
    diagram.expose(u=delay.u, y=delay.y)
    return diagram


@pytest.mark.parametrize(
    ("make", "settings", "text"),
    [
        (silent, {}, r"'silent': it exposes no output; expose one with diagram.expose"),
        (lambda: 3, {}, "cannot export 3: it is neither a block nor a diagram"),
        (Integrator, {"parameters": {"gian": 1.0}}, "no parameter 'gian'; the parameters are: in"),
        (Integrator, {"start": {"v": 1.0}}, "no input 'v' to start; the inputs are: u"),
        (Integrator, {"start": {"u": np.nan}}, "the start of input 'u' is not finite: nan; give start="),
        (Integrator, {"start": {"u": [1.0, 2.0]}}, r"input 'u' has shape \(2,\); it must have shape \(\)"),
        (Integrator, {"step": -1.0}, "step = -1.0 must be a positive and finite"),
        (Integrator, {"stop_time": np.inf}, "stop_time = inf must be a positive"),
        (Integrator, {"step": "short"}, "step = 'short' must be a positive and finite number"),
        (Inverse, {}, "'y' has no start value: with the inputs and parameters at their start"),
        (slow, {}, "cannot export 'slow' with step=0.001: the sample time of 0.0015 s is not a"),
    ],
)
def test_what_cannot_be_exported(make, settings, text):
    with pytest.raises(ExportError, match=text):
        ExportInterface.of(make(), **settings)


def test_parameters_out_of_bounds(systems):
    with pytest.raises(ParameterError, match="stiffness"):
        ExportInterface.of(systems.Oscillator(2), parameters={"stiffness": -1.0})


def test_a_port_called_time_keeps_its_name():
    class Clockwork(Block):
        """Tells the time."""

        time = Output(unit="s")

        def output(self, t, x, u, p):
            return {"time": t}

    names = {v.name: v.causality for v in ExportInterface.of(Clockwork()).variables}
    assert names == {"independent_time": "independent", "time": "output"}


def test_nothing_is_known_of_python_blocks_with_continuous_states():
    class Live(Block):
        """A low pass that is Python code."""

        traced = False
        u = Input()
        y = Output()
        x = State()

        def output(self, t, x, u, p):
            return {"y": x.x}

        def derivative(self, t, x, u, p):
            return {"x": u.u - x.x}

    interface = ExportInterface.of(Live())
    assert interface.dependencies.derivatives.all()
    assert interface.dependencies.outputs.all()

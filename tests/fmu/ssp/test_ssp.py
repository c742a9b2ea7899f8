"""Exported SSP files run elsewhere with the same digits, and come back unchanged."""

import gc
import re
import zipfile
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from numpy.testing import assert_allclose

from trussflow.blocks import (
    Block,
    Diagram,
    Input,
    Output,
    Parameter,
    State,
    StateSpace,
    Step,
    cosimulate,
)
from trussflow.blocks.errors import WiringError
from trussflow.fmu import ExportError, Fmu, SspError, export
from trussflow.fmu.ssp import export_ssp, import_ssp

TIME_STEP = 2.0**-7  # s; a power of two, so that times added up are exact


class Mass(Block):
    """A mass on a spring, pushed from two sides."""

    force, wind = Input(2, unit="N"), Input(unit="N")
    position, motion = Output(unit="m"), Output(2, unit=("m", "m/s"))
    q, v = State(unit="m"), State(unit="m/s", initial=1.0)
    stiffness = Parameter(9.0, unit="N/m")

    def output(self, t, x, u, p):
        return {"position": x.q, "motion": np.stack([x.q, x.v])}

    def derivative(self, t, x, u, p):
        return {
            "q": x.v,
            "v": u.force[0] + u.force[1] + u.wind - p.stiffness * x.q - 0.3 * x.v,
        }


class Filter(Block):
    """Two lags, from position to force."""

    position, force = Input(unit="m"), Output(2, unit="N")
    x = State(2)

    def output(self, t, x, u, p):
        return {"force": x.x}

    def derivative(self, t, x, u, p):
        return {
            "x": np.stack(
                [-2.0 * x.x[0] + 3.0 * u.position, -5.0 * x.x[1] - u.position]
            )
        }


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmus")
    export(Mass(), folder / "mass.fmu", step=TIME_STEP)
    export(Filter(), folder / "filter.fmu", step=TIME_STEP)
    return folder


def loop(fmus, **limits):
    diagram = Diagram("loop")
    mass, law = diagram.add(
        mass=Fmu(
            fmus / "mass.fmu", parameters={"stiffness": 7.0}, start={"wind": 0.25}
        ),
        law=Fmu(
            fmus / "filter.fmu",
            step=2 * TIME_STEP,
            tolerance=1e-6,
            delayed=True,
            **limits,
        ),
    )
    mass.position >> law.position
    law.force >> mass.force
    return diagram


def limited(fmus):
    return loop(fmus, time_limit=60.0, memory_limit=4e9, logging=True)


@pytest.fixture
def file(fmus, tmp_path):
    """Return the loop, exported."""
    return export_ssp(loop(fmus), tmp_path / "loop.ssp")


def nested(fmus):
    """Return slices, grounds, exposed vectors, a diagram within, and one FMU twice."""
    inner = Diagram("inner")
    mass, law = inner.add(mass=Fmu(fmus / "mass.fmu"), law=Fmu(fmus / "filter.fmu"))
    mass.motion[0] >> law.position
    law.force[::-1] >> mass.force
    inner.expose(wind=mass.wind, motion=mass.motion)
    outer = Diagram("outer")
    outer.add(inner=inner, other=Fmu(fmus / "mass.fmu"), last=Fmu(fmus / "filter.fmu"))
    outer.connect(outer.inner.motion[0], outer.last.position)
    outer.connect(outer.last.force[1:2], outer.other.force[0:1])
    outer.ground(outer.other.force[1])
    outer.expose(wind=(outer.inner.wind, outer.other.wind), force=outer.last.force)
    return outer


def facts(diagram):
    """Return all that a diagram is made of."""
    found = {"name": diagram.name, "blocks": {}, "wires": set()}
    for name, block in diagram.blocks.items():
        if isinstance(block, Diagram):
            found["blocks"][name] = facts(block)
            continue
        found["blocks"][name] = (
            block.file.path.read_bytes(),
            block.kind,
            block.sample_time,
            block.tolerance,
            block.delayed,
            block.options,
            block.units,
            {k: v.tolist() for k, v in block.parameters.items()},
            {p.name: getattr(p.declaration, "default", None) for p in block.inputs()},
        )
    for wire in diagram.wires:
        elements = wire.target.elements().ravel()
        sources = [None] * elements.size
        if wire.source is not None:
            sources = [(wire.source.path, i) for i in wire.source.elements().ravel()]
        found["wires"] |= {
            (s, wire.target.path, i) for s, i in zip(sources, elements, strict=True)
        }
    found["exposed"] = {
        name: tuple(port.path for port in ports)
        for name, ports in diagram.exposed.items()
    }
    return found


@pytest.mark.parametrize("make", [limited, nested])
def test_a_diagram_comes_back_unchanged(make, fmus, tmp_path):
    diagram = make(fmus)
    file = export_ssp(diagram, tmp_path / "system.ssp", step=TIME_STEP)
    again = import_ssp(file)
    assert facts(again) == facts(diagram)
    second = export_ssp(again, tmp_path / "again.ssp", step=TIME_STEP)
    assert second.read_bytes() == file.read_bytes()


def test_fmpy_runs_it_with_the_same_digits(fmus, tmp_path):
    """Its algorithm is Jacobi's, and begins with all inputs at zero."""

    def diagram():
        found = Diagram("open")
        mass, law = found.add(
            mass=Fmu(fmus / "mass.fmu", parameters={"stiffness": 7.0}),
            law=Fmu(fmus / "filter.fmu"),
        )
        mass.position >> law.position
        law.force >> mass.force
        return found

    theirs = diagram()
    # fmpy connects inputs without a connection to something: leave none
    theirs.expose(wind=theirs.mass.wind)
    file = export_ssp(theirs, tmp_path / "loop.ssp", step=TIME_STEP)
    stiffness = SimpleNamespace(
        parameters=[SimpleNamespace(name="mass.stiffness", value=7.0)]
    )
    expected = simulate_ssp(
        str(file),
        stop_time=2.0,
        step_size=TIME_STEP,
        parameter_set=stiffness,
        input={"wind": lambda _t: 0.25},
    )
    ours = diagram()
    ours.add(gust=Step(TIME_STEP, final_value=0.25, unit="N")) >> ours.mass.wind
    found = cosimulate(ours, 2.0, step=TIME_STEP)
    # fmpy's row at t is what its FMUs show at t + H
    for name, signal in (
        ("mass.position", found["mass.position"]),
        ("law.force[2]", found["law.force"][:, 1]),
        ("mass.motion[2]", found["mass.motion"][:, 1]),
    ):
        assert_allclose(expected[name], signal[1:], rtol=1e-12, atol=1e-15)
        assert abs(signal).max() > 0.02


def test_the_fmus_of_an_import_are_deleted_with_the_diagram(file):
    diagram = import_ssp(file)
    fmu = diagram.blocks["mass"].file.path
    assert fmu.is_file()
    del diagram
    gc.collect()
    assert not fmu.exists()


def with_plant(fmus):
    diagram = loop(fmus)
    diagram.add(plant=StateSpace([[-1.0]], [[1.0]], [[1.0]]))
    return diagram


@pytest.mark.parametrize(
    "make, path, step, message",
    [
        (
            with_plant,
            "a.ssp",
            TIME_STEP,
            r"'loop' to SSP.*'plant' \(StateSpace\).*trussflow\.fmu",
        ),
        (
            lambda fmus: Fmu(fmus / "mass.fmu"),
            "a.ssp",
            TIME_STEP,
            "to SSP: it is not a diagram; add it to a diagram",
        ),
        (
            lambda _: Diagram("empty"),
            "a.ssp",
            TIME_STEP,
            r"'empty' to SSP.*it has no block",
        ),
        (loop, "a.ssp", -1.0, r"step = -1\.0 must be a positive"),
        (loop, "nowhere/a.ssp", TIME_STEP, r"cannot write .*there is no folder"),
    ],
)
def test_exports_that_are_refused(make, path, step, message, fmus, tmp_path):
    with pytest.raises(ExportError, match=message):
        export_ssp(make(fmus), tmp_path / path, step=step)
    assert not list(tmp_path.iterdir())


def test_arrays_of_fmi_3_are_refused(tmp_path):
    export(Filter(), tmp_path / "three.fmu", version="3.0", step=TIME_STEP)
    diagram = Diagram("three")
    diagram.ground(diagram.add(law=Fmu(tmp_path / "three.fmu")).position)
    with pytest.raises(
        ExportError, match=r"'law\.force' to SSP.*array variable of FMI 3.*FMI 2\.0"
    ):
        export_ssp(diagram, tmp_path / "three.ssp")


def rewritten(file, target, changes):
    """Copy an SSP file with changes in its text."""
    with zipfile.ZipFile(file) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name.endswith(".ssd"):
                text = content.decode()
                for before, after in changes.items():
                    assert before in text
                    text = text.replace(before, after, 1)
                content = text.encode()
            new.writestr(name, content)
    return target


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"resources/mass.fmu": "../mass.fmu"}, r"contains no file '\.\./mass\.fmu'"),
        ({"resources/mass.fmu": "n" * 300}, "it contains no file 'nnn"),
        ({"resources/mass.fmu": "resources/no.fmu"}, r"no file 'resources/no\.fmu'"),
        (
            {'type="application/x-fmu-sharedlibrary"': 'type="text/plain"'},
            "of type 'text/plain'",
        ),
        (
            {'startConnector="position"': 'startConnector="speed"'},
            "connector 'speed' of 'mass', which does not exist",
        ),
        ({'name="law"': 'name="mass"'}, "two elements have the same name"),
        (
            {'value="7.0"': 'value="seven"'},
            "parameter 'stiffness' 'seven' is not a number",
        ),
        (
            {
                'endConnector="position" />': 'endConnector="position"><ssc:LinearTransformation '
                'factor="2" /></ssd:Connection>'
            },
            "'position' to 'position' converts values",
        ),
        (
            {"<ssd:SystemStructureD": "<ssd:D", "</ssd:SystemStructureD": "</ssd:D"},
            "not a system structure of SSP 1",
        ),
    ],
)
def test_imports_that_are_refused(changes, message, file, tmp_path):
    with pytest.raises(SspError, match=message):
        import_ssp(rewritten(file, tmp_path / "bad.ssp", changes))


def test_values_may_come_from_the_system_and_from_files(file, tmp_path):
    """Other tools write parameters into .ssv files, under the names of the elements."""
    values = (
        '<?xml version="1.0"?><ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/'
        'SystemStructureParameterValues" version="1.0" name="v"><ssv:Parameters>'
        '<ssv:Parameter name="mass.stiffness"><ssv:Real value="5.5"/></ssv:Parameter>'
        "</ssv:Parameters></ssv:ParameterSet>"
    )
    other = rewritten(
        file,
        tmp_path / "other.ssp",
        {
            "<ssd:Elements>": "<ssd:ParameterBindings><ssd:ParameterBinding "
            'source="resources/v.ssv" /></ssd:ParameterBindings><ssd:Elements>',
            '<ssv:Parameter name="stiffness">': '<ssv:Parameter name="wind">',
        },
    )
    with zipfile.ZipFile(other, "a") as archive:
        archive.writestr("resources/v.ssv", values)
    assert import_ssp(other).blocks["mass"].parameters["stiffness"] == 5.5


def test_units_are_checked_as_everywhere(file, tmp_path):
    wrong = rewritten(
        file,
        tmp_path / "wrong.ssp",
        {
            'Connector="position" endElement="law"': 'Connector="motion[2]" endElement="law"'
        },
    )
    with pytest.raises(WiringError, match="m/s"):
        import_ssp(wrong)


def test_other_tools_find_nothing_but_ssp(fmus, tmp_path):
    """OMSimulator refuses annotations of others, and names that are no words; XML it takes for its own."""
    diagram = nested(fmus)
    object.__setattr__(diagram, "name", "2 arms, with law é")
    file = export_ssp(diagram, tmp_path / "arms.ssp")
    with zipfile.ZipFile(file) as archive:
        assert [n for n in archive.namelist() if n.endswith(".xml")] == []
        root = ElementTree.fromstring(archive.read("SystemStructure.ssd"))
    named = [
        e.get("name", "")
        for e in root.iter()
        if e.tag.endswith(("System", "Component", "Description"))
    ]
    assert len(named) == 7
    assert all(re.fullmatch("[a-zA-Z][a-zA-Z0-9_-]*", name) for name in named), named
    notes = [e for e in root.iter() if e.tag.endswith("}Annotation")]
    assert [e.get("type") for e in notes] == ["org.openmodelica"]
    assert facts(import_ssp(file)) == facts(diagram)


@pytest.mark.parametrize(
    "notes, message",
    [
        ("{", "JSONDecodeError"),
        ("[1]", "TypeError"),
        ("[" * 100_000, "RecursionError"),
        ('{"name": "a"}', "KeyError: 'fmus'"),
        ('{"name": "a", "fmus": {"mass": 3}}', "TypeError"),
        ('{"name": "a", "fmus": {"mass": {"path": "x"}}}', "TypeError: .*'path'"),
    ],
)
def test_damaged_notes_are_refused(notes, message, file, tmp_path):
    with (
        zipfile.ZipFile(file) as old,
        zipfile.ZipFile(tmp_path / "bad.ssp", "w") as new,
    ):
        for name in old.namelist():
            new.writestr(name, notes if name.endswith(".json") else old.read(name))
    with pytest.raises(SspError, match=f"cannot read 'bad.ssp': {message}"):
        import_ssp(tmp_path / "bad.ssp")

"""SSP files as other tools write them, right ones and wrong ones."""

import zipfile

import numpy as np
import pytest

from trussflow.blocks import StateSpace, cosimulate
from trussflow.blocks.errors import OpenInputError
from trussflow.fmu import FmuError, SspError, export
from trussflow.fmu.ssp import import_ssp
from trussflow.fmu.ssp.names import XML_NAMESPACES


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmus")
    line = StateSpace(np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)))
    export(line, folder / "mass.fmu", step=0.125)
    return folder


def foreign(fmus, target, structure):
    """Return a file with one FMU and a structure as other tools write it."""
    text = "".join(
        f' xmlns:{p}="{XML_NAMESPACES[p]}"' for p in ("ssd", "ssc", "ssv", "ssm")
    )
    with zipfile.ZipFile(target, "w") as archive:
        archive.write(fmus / "mass.fmu", "resources/mass.fmu")
        root = f'<ssd:SystemStructureDescription{text} name="s" version="1.0"><ssd:System name="s">'
        end = "</ssd:System></ssd:SystemStructureDescription>"
        archive.writestr("SystemStructure.ssd", root + structure + end)
    return target


MASS = '<ssd:Elements><ssd:Component name="mass" source="resources/mass.fmu"/></ssd:Elements>'


def test_the_step_may_be_given(fmus, tmp_path):
    """An FMU that suggests none could not be imported."""
    silent = tmp_path / "silent"
    silent.mkdir()
    with (
        zipfile.ZipFile(fmus / "mass.fmu") as old,
        zipfile.ZipFile(silent / "mass.fmu", "w") as new,
    ):
        for name in old.namelist():
            content = old.read(name)
            new.writestr(
                name,
                content.replace(b'stepSize="', b'version="')
                if name.endswith(".xml")
                else content,
            )
    file = foreign(silent, tmp_path / "s.ssp", MASS)
    with pytest.raises(FmuError, match="suggests no step size; give step"):
        import_ssp(file)
    assert import_ssp(file, step=0.25).blocks["mass"].sample_time == 0.25
    assert (
        import_ssp(foreign(fmus, tmp_path / "s.ssp", MASS), step=0.25)
        .blocks["mass"]
        .sample_time
        == 0.25
    )


@pytest.mark.parametrize("outer", ['startElement="" ', ""])
def test_parameters_of_a_system_reach_its_fmus(outer, fmus, tmp_path):
    """They were taken for signals: there was no such connector."""
    structure = (
        '<ssd:Connectors><ssd:Connector name="k" kind="parameter"/></ssd:Connectors>'
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
        '<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters><ssv:Parameter name="k">'
        '<ssv:Real value="3.5"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>'
        "</ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"
        f'{MASS}<ssd:Connections><ssd:Connection {outer}startConnector="k" endElement="mass" '
        'endConnector="initial_value[2]"/></ssd:Connections>'
    )
    block = import_ssp(foreign(fmus, tmp_path / "s.ssp", structure)).blocks["mass"]
    assert block.parameters["initial_value"][1] == 3.5


REAL, TEXT, LINEAR = (
    '<ssv:Real value="3.5"/>',
    '<ssv:String value="red"/>',
    "<ssc:LinearTransformation",
)


@pytest.mark.parametrize(
    "given, conversion, result",
    [
        (REAL, "", 3.5),
        (REAL, f'{LINEAR} factor="2" offset="-1"/>', 6.0),
        (REAL, f"{LINEAR} factor='x'/>", "factor 'x' is not a number"),
        (
            REAL,
            "<ssc:BooleanMappingTransformation/>",
            r"'k' to 'mass.initial_value\[2\]' is not a linear conversion",
        ),
        (
            TEXT,
            f'{LINEAR} factor="2"/>',
            r"'k' to 'mass.*' is not a linear conversion of a number",
        ),
        (TEXT, "", r"'initial_value\[2\]' must be a number, not 'red'"),
    ],
)
def test_parameter_mappings(given, conversion, result, fmus, tmp_path):
    """Values go to the names that the mapping says, converted linearly; others are left out."""
    structure = (
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
        '<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters><ssv:Parameter name="k">'
        f'{given}</ssv:Parameter><ssv:Parameter name="mass.initial_value[1]">'
        '<ssv:Real value="9"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>'
        '<ssd:ParameterMapping><ssm:ParameterMapping version="1.0"><ssm:MappingEntry source="k" '
        f'target="mass.initial_value[2]">{conversion}</ssm:MappingEntry></ssm:ParameterMapping>'
        f"</ssd:ParameterMapping></ssd:ParameterBinding></ssd:ParameterBindings>{MASS}"
    )
    file = foreign(fmus, tmp_path / "s.ssp", structure)
    if isinstance(result, str):
        with pytest.raises(FmuError, match=result):
            import_ssp(file)
    else:
        assert import_ssp(file).blocks["mass"].parameters["initial_value"].tolist() == [
            0.0,
            result,
        ]


def test_open_inputs_may_keep_their_start_values(fmus, tmp_path):
    """In x' = x + u: the FMU declares u = 0."""
    connectors = "".join(f'<ssd:Connector name="u[{i}]" kind="input"/>' for i in (1, 2))
    connections = "".join(
        f'<ssd:Connection startConnector="u[{i}]" endElement="mass" endConnector="u[{i}]"/>'
        for i in (1, 2)
    )
    structure = f"<ssd:Connectors>{connectors}</ssd:Connectors>{MASS}<ssd:Connections>{connections}</ssd:Connections>"
    file = foreign(fmus, tmp_path / "s.ssp", structure)
    with pytest.raises(OpenInputError):
        cosimulate(import_ssp(file), 0.25, step=0.125)
    assert not cosimulate(import_ssp(file, open_inputs="start"), 0.25, step=0.125)[
        "mass.y"
    ].any()
    with pytest.raises(
        SspError, match="unknown open_inputs 'zero'; choose from: expose, start"
    ):
        import_ssp(file, open_inputs="zero")


def test_names_of_no_known_space_are_said(fmus, tmp_path):
    file = foreign(fmus, tmp_path / "s.ssp", f"{MASS}<osp:Annotation/>")
    with pytest.raises(
        FmuError, match=r"'SystemStructure\.ssd' of 's\.ssp': .*unbound prefix: line 1"
    ):
        import_ssp(file)

"""SSP files as other tools write them, right ones and wrong ones."""

import contextlib
import copy
import random
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trussflow.blocks import Diagram, StateSpace
from trussflow.blocks.framework.errors import TrussflowError
from trussflow.fmu import Fmu, FmuError, export, export_ssp, import_ssp
from trussflow.fmu.ssp.names import SPACES


@pytest.fixture(scope="module")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fmus")
    line = StateSpace(np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)))
    export(line, folder / "mass.fmu", step=0.125)
    return folder


def foreign(fmus: Path, target: Path, structure: str) -> Path:
    """Return a file with one FMU and a structure as other tools write it."""
    text = "".join(f' xmlns:{p}="{SPACES[p]}"' for p in ("ssd", "ssc", "ssv"))
    with zipfile.ZipFile(target, "w") as archive:
        archive.write(fmus / "mass.fmu", "resources/mass.fmu")
        root = f'<ssd:SystemStructureDescription{text} name="s" version="1.0"><ssd:System name="s">'
        end = "</ssd:System></ssd:SystemStructureDescription>"
        archive.writestr("SystemStructure.ssd", root + structure + end)
    return target


MASS = '<ssd:Elements><ssd:Component name="mass" source="resources/mass.fmu"/></ssd:Elements>'


def test_the_step_may_be_given(fmus: Path, tmp_path: Path) -> None:
    """An FMU that suggests none could not be imported."""
    silent = tmp_path / "silent"
    silent.mkdir()
    with zipfile.ZipFile(fmus / "mass.fmu") as old, zipfile.ZipFile(silent / "mass.fmu", "w") as new:
        for name in old.namelist():
            content = old.read(name)
            new.writestr(
                name, content.replace(b'stepSize="', b'version="') if name.endswith(".xml") else content
            )
    file = foreign(silent, tmp_path / "s.ssp", MASS)
    with pytest.raises(FmuError, match="does not say which step suits it; give step"):
        import_ssp(file)
    assert import_ssp(file, step=0.25).blocks["mass"].sample_time == 0.25
    assert import_ssp(foreign(fmus, tmp_path / "s.ssp", MASS), step=0.25).blocks["mass"].sample_time == 0.25


@pytest.mark.parametrize("outer", ['startElement="" ', ""])
def test_parameters_of_a_system_reach_its_fmus(outer: str, fmus: Path, tmp_path: Path) -> None:
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


def test_names_of_no_known_space_are_said(fmus: Path, tmp_path: Path) -> None:
    file = foreign(fmus, tmp_path / "s.ssp", f"{MASS}<osp:Annotation/>")
    with pytest.raises(FmuError, match=r"'SystemStructure\.ssd' of 's\.ssp': .*unbound prefix: line 1"):
        import_ssp(file)


JUNK = ["", "0", "-1", "nan", "1e999", "x y", "../x", "a", "b", "u[1]", "u[3]", "a.b", "[", "1" * 400, "true"]


def damaged(root: Element, chance: random.Random) -> None:
    """Change one thing to three in a tree."""
    everything = list(root.iter())
    for _ in range(chance.randint(1, 3)):
        element, kind = chance.choice(everything), chance.randrange(6)
        if kind == 0 and element.attrib:
            element.set(chance.choice(list(element.attrib)), chance.choice(JUNK))
        elif kind == 1 and element.attrib:
            element.attrib.pop(chance.choice(list(element.attrib)))
        elif kind == 2 and len(element):
            element.remove(chance.choice(list(element)))
        elif kind == 3 and len(element):
            element.append(copy.deepcopy(chance.choice(list(element))))
        elif kind == 4:
            element.append(Element(chance.choice(everything).tag, chance.choice(everything).attrib))
        else:
            element.tag = chance.choice(everything).tag


@given(seed=st.integers(0, 2**32))
def test_damaged_structures_are_read_or_refused(
    seed: int, fmus: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Nothing but errors of ours: a name of 400 characters made one of the file system."""
    inner, outer = Diagram("inner"), Diagram("outer")
    a, b = inner.add(a=Fmu(fmus / "mass.fmu", parameters={"initial_value": 0.5}), b=Fmu(fmus / "mass.fmu"))
    a.y[0] >> b.u[1]
    inner.ground(b.u[0])
    inner.expose(u=a.u)
    outer.add(inner=inner)
    outer.expose(u=inner.u)
    folder = tmp_path_factory.mktemp("ssp")
    with zipfile.ZipFile(export_ssp(outer, folder / "a.ssp")) as old:
        content: dict[str, Any] = {name: old.read(name) for name in old.namelist()}
    root = ElementTree.fromstring(content["SystemStructure.ssd"])
    damaged(root, random.Random(seed))
    with zipfile.ZipFile(folder / "b.ssp", "w") as new:
        for name, text in content.items():
            new.writestr(name, ElementTree.tostring(root) if name.endswith(".ssd") else text)
    with contextlib.suppress(TrussflowError):
        import_ssp(folder / "b.ssp")

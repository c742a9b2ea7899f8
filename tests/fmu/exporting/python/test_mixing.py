"""FMUs in one process keep apart: from each other, and from the code of this process."""

import importlib.util
import sys
import zipfile

import campaign
import casadi as ca
import numpy as np
import pytest
from systems import ports

import trussflow.blocks
from trussflow.blocks import PythonFunction

PLANT = """
import helper_of_plant
from trussflow.blocks import Block, Input, Output, PythonFunction

FACTOR = {factor}

class Plant(Block):
    u = Input()
    y = Output()

    def output(self, t, x, u, p):
        return {{"y": FACTOR * u.u + helper_of_plant.shift()}}

def function(u):
    return FACTOR * u + helper_of_plant.shift()

def python():
    return PythonFunction(function, 0.01, inputs={{"u": Input()}}, outputs={{"y": Output()}})
"""


@pytest.fixture
def plants(tmp_path, export, monkeypatch):
    """Return a function that exports blocks of two scripts of one name, with helpers of one name."""

    def exported(attribute):
        found = []
        for factor, shift in ((1.0, 0.5), (1000.0, 2.0)):
            modules = {
                "helper_of_plant": f"def shift():\n    return {shift}\n",
                "plant": PLANT.format(factor=factor),
            }
            folder = tmp_path / f"{attribute}_{factor}"
            folder.mkdir()
            for name, text in modules.items():
                (folder / f"{name}.py").write_text(text)
                spec = importlib.util.spec_from_file_location(
                    name, folder / f"{name}.py"
                )
                module = importlib.util.module_from_spec(spec)
                monkeypatch.setitem(sys.modules, name, module)
                spec.loader.exec_module(module)
            found.append(export(getattr(sys.modules["plant"], attribute)()))
        for name in ("plant", "helper_of_plant"):
            monkeypatch.delitem(sys.modules, name)
        return found

    return exported


@pytest.mark.parametrize("attribute", ["python", campaign.only("Plant")])
def test_two_fmus_of_scripts_of_one_name(plants, instance, attribute):
    first, second = (instance(fmu).start({"u": 2.0}) for fmu in plants(attribute))
    for one in (first, second):
        one.doStep(0.0, 0.01)
    assert (first.get("y"), second.get("y")) == (2.5, 2002.0)
    assert "plant" not in sys.modules


def test_running_the_fmu_leaves_the_users_class_unchanged(export, instance, make_loop):
    """The FMU has classes of its own, although cloudpickle knows those of this process by name."""
    loop = make_loop(python=True)
    kind = type(loop.blocks["plant"])
    before = {**vars(kind)}
    one = instance(export(loop)).start({"goal[1]": 1.0})
    one.step(0, 3, 0.01)
    assert one.errors == ""
    assert {name: vars(kind)[name] for name in before} == before


def test_the_users_code_may_refer_to_the_package(export, instance):
    """At the top of its file, and within a function."""

    def function(u):
        from trussflow.blocks import Gain

        return (
            trussflow.blocks.Gain(u).parameters["gain"] + Gain(1.0).parameters["gain"]
        )

    fmu = export(PythonFunction(function, 0.01, **ports(u=(), y=())))
    with zipfile.ZipFile(fmu) as archive:
        assert len([name for name in archive.namelist() if name.endswith(".py")]) == 1
    one = instance(fmu).start({"u": 2.0})
    one.doStep(0.0, 0.01)
    assert one.errors == ""
    assert one.get("y") == 3.0


def test_casadi_settings_of_the_host_neither_matter_nor_change(
    export, instance, make_loop
):
    mode = 1 - ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(mode)
    try:
        one = instance(export(make_loop(python=True))).start({"goal[1]": 1.0})
        one.step(0, 3, 0.01)
        assert np.abs(one.get("torque[1]")) > 0.1
        assert one.errors == ""
        assert ca.GlobalOptions.getNumpyMode() == mode
    finally:
        ca.GlobalOptions.setNumpyMode(1 - mode)

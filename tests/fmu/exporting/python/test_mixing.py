"""FMUs in one process keep apart: from each other, and from what is installed."""

import importlib.util
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from systems import ports

import trussflow.blocks
from trussflow.blocks import Gain, PythonFunction
from trussflow.models import SpaceTruss

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
                spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
                assert spec is not None
                assert spec.loader is not None
                module = importlib.util.module_from_spec(spec)
                monkeypatch.setitem(sys.modules, name, module)
                spec.loader.exec_module(module)
            found.append(export(getattr(sys.modules["plant"], attribute)()))
        for name in ("plant", "helper_of_plant"):
            monkeypatch.delitem(sys.modules, name)
        return found

    return exported


@pytest.mark.parametrize("attribute", ["python", pytest.param("Plant", marks=pytest.mark.campaign)])
def test_two_fmus_of_scripts_of_one_name(plants, instance, attribute):
    first, second = (instance(fmu).start({"u": 2.0}) for fmu in plants(attribute))
    for one in (first, second):
        one.doStep(0.0, 0.01)
    assert (first.get("y"), second.get("y")) == (2.5, 2002.0)
    assert "plant" not in sys.modules


def test_beside_an_installed_package_of_another_version(export, tmp_path):
    """There, another version is installed, whose gains are negative: each keeps its own."""
    fmu = export(Gain(3.0))
    folder = tmp_path / "site" / "trussflow" / "blocks"
    source = Path(str(trussflow.blocks.__file__)).parent
    shutil.copytree(source, folder, ignore=shutil.ignore_patterns("__pycache__"))
    (folder.parent / "__init__.py").touch()
    algebra = folder / "library" / "algebra.py"
    text = algebra.read_text()
    assert "p.gain * u.u" in text  # of Gain
    algebra.write_text(text.replace("p.gain * u.u", "-p.gain * u.u"))
    script = tmp_path / "script.py"
    script.write_text(
        "import fmpy, sys\n"
        "import trussflow.blocks as installed\n"
        f"result = fmpy.simulate_fmu({str(fmu)!r}, stop_time=0.1, start_values={{'u': 2.0}})\n"
        "with installed.Session(installed.Gain(3.0), step=0.1, backend='numpy') as session:\n"
        "    session.set(u=2.0)\n"
        "    print(result['y'][-1], float(session.outputs['y']), installed.__file__)\n"
    )
    environment = {"PYTHONPATH": str(tmp_path / "site"), "TRUSSFLOW_CACHE": os.environ["TRUSSFLOW_CACHE"]}
    run = subprocess.run(
        [sys.executable, str(script)], env=environment, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    inside, outside, file = run.stdout.split()
    assert (float(inside), float(outside)) == (6.0, -6.0)
    assert file.startswith(str(tmp_path))


def held(fmu):
    """Return the modules of this package that an FMU holds."""
    with zipfile.ZipFile(fmu) as archive:
        files = [f for f in archive.infolist() if "/trussflow_" in f.filename and f.file_size]
    return {file.filename.split("/", 2)[2] for file in files}


def test_only_needed_modules_go_along(export, instance):
    """Unless the user's code refers to the package as such: then all of it, under its new name."""
    few = held(export(Gain(2.0)))
    assert {"blocks/library/algebra.py", "blocks/tracing/driver.c", "blocks/tracing/fixed_step.h"} <= few
    assert not few & {"blocks/__init__.py", "blocks/control/pd.py", "fmu/exporting/export.py"}

    def function(u):
        return trussflow.blocks.Gain(u).parameters["gain"] + len(trussflow.blocks.__name__)

    fmu = export(PythonFunction(function, 0.01, **ports(u=(), y=())))
    assert {"blocks/__init__.py", "blocks/control/pd.py"} <= held(fmu)
    one = instance(fmu).start({"u": 2.0})
    one.doStep(0.0, 0.01)
    assert one.errors == ""
    assert one.get("y") == 2.0 + len("trussflow_0123456789ab.blocks")


@pytest.mark.campaign
def test_blocks_of_the_models_go_along(export):
    """Their parameter files go along; the copy runs before it is written."""
    few = held(export(SpaceTruss.published()))
    assert "models/plant/space_truss.py" in few
    assert any(name.startswith("models/parameters/") for name in few)
    assert not any(name.startswith("models/transport/") for name in few)


def test_casadi_settings_of_the_host_neither_matter_nor_change(export, instance, make_loop):
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

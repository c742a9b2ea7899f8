"""Misuse: a clear error at export, or the standard's status with a log text that says why."""

import logging
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from trussflow.blocks import Block, Function, Input, Output, PythonFunction
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.export import export as fmu_export

POINT = 0.01
Start = Callable[..., Any]
Export = Callable[..., Path]
PORTS: dict[str, Any] = {"inputs": {"u": Input()}, "outputs": {"y": Output()}}


def python(function):
    return PythonFunction(function, POINT, **PORTS)


def test_nan_input(loop_fmu, slave):
    one = slave(loop_fmu).start()
    one.set({"goal[2]": np.nan})
    with pytest.raises(FMICallException, match="discard"):
        one.fmu.doStep(0.0, POINT)
    assert "the step of 0.01 s from t = 0 s failed: input 'goal' is not finite" in one.errors


def test_fixed_parameter_and_output_cannot_be_set_later(loop_fmu, slave):
    """`release` matters only at the start, so it is fixed; `gain` is tunable.

    Of Python blocks nothing is known: with one in the loop, every parameter is tunable.
    """
    later, never = "once time goes on", "at any time"
    for name, when in (("plant.release[1]", later), ("plant.v[1]", later), ("angle[1]", never)):
        message = f"'{name}' cannot be set {when}"
        one = slave(loop_fmu).start()
        if name == "plant.release[1]" and "mean[1]" in one.references:
            continue
        one.fmu.doStep(0.0, POINT)
        one.set({"law.gain": 3.0})
        one.fmu.doStep(POINT, POINT)
        one.set({name: 1.0})
        assert message in one.errors
        with pytest.raises(FMICallException, match="discard"):
            one.fmu.doStep(2 * POINT, POINT)


def test_parameter_out_of_its_bounds(loop_fmu, slave):
    one = slave(loop_fmu).start()
    one.set({"plant.stiffness": -1.0})
    with pytest.raises(FMICallException, match="discard"):
        one.fmu.doStep(0.0, POINT)
    assert "'stiffness' of block 'plant' is -1.0; it must be above 0 [N*m]" in one.errors
    two = slave(loop_fmu).start({"plant.stiffness": -1.0})
    with pytest.raises(FMICallException, match="discard"):
        two.fmu.doStep(0.0, POINT)
    assert "initialization failed: parameter 'stiffness' of block 'plant' is -1.0" in two.errors


def test_unknown_value_reference_and_wrong_type(loop_fmu, slave):
    one = slave(loop_fmu).start()
    assert np.isnan(one.fmu.getReal([1_000_000])[0])
    assert "there is no variable with value reference 1000000" in one.errors
    one = slave(loop_fmu).start()
    one.fmu.getInteger([1])
    assert "every variable is Real; value references [1] were used otherwise" in one.errors


@pytest.mark.parametrize(
    ("time", "length", "message"),
    [
        (0.5, 0.01, "the step is to begin at t = 0.5 s, but it is t = 0 s"),
        (0.0, -0.01, "a step of -0.01 s from t = 0.0 s makes no sense"),
        (0.0, np.nan, "a step of nan s from t = 0.0 s makes no sense"),
    ],
)
def test_steps_that_make_no_sense(loop_fmu, slave, time, length, message):
    one = slave(loop_fmu).start()
    with pytest.raises(FMICallException, match="discard"):
        one.fmu.doStep(time, length)
    assert message in one.errors


def test_step_without_initialization(loop_fmu, slave):
    one = slave(loop_fmu)
    with pytest.raises(FMICallException, match="discard"):
        one.fmu.doStep(0.0, POINT)
    assert "a step is possible only between initialization and termination" in one.errors


def failing(u):
    if u > 1.0:
        raise ZeroDivisionError(f"100 % of {u}")
    return u


def test_error_in_users_code_is_told_with_its_cause(export, slave, caplog):
    """The traceback leads to the line; Python's log has it as well."""
    one = slave(export(python(failing))).start()
    one.fmu.doStep(0.0, POINT)
    one.set({"u": 2.0})
    with caplog.at_level(logging.ERROR), pytest.raises(FMICallException, match="discard"):
        one.fmu.doStep(POINT, POINT)
    for text in (one.errors, caplog.text):
        assert "raised ZeroDivisionError at t = 0.01 s: 100 %" in text
        # Not the file's name: what cloudpickle 3.1.3 and later packs forgets it, the line stays.
        assert f"line {failing.__code__.co_firstlineno + 2}, in failing" in text


def halved(u):
    """For one test only: a process keeps the modules of an FMU that ran in it before."""
    return u / 2.0


def test_libraries_that_are_missing_are_named(export, slave, tmp_path):
    """NumPy and CasADi are there, but a library of the user's is not."""
    fmu = export(python(halved))
    with zipfile.ZipFile(fmu) as archive:
        needed = archive.read("resources/requirements.txt").decode().split()
    names = [line.partition(">=")[0] for line in needed]
    assert names == ["casadi", "numpy", "platformdirs", "scipy", "tqdm"]
    broken = tmp_path / "broken.fmu"
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(broken, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name.endswith("exporting/python/content.py"):
                data = b"import library_that_is_not_there\n"
            new.writestr(name, data)
    one = slave(broken)
    with pytest.raises(FMICallException, match="discard"):
        one.start().fmu.doStep(0.0, POINT)
    assert "No module named 'library_that_is_not_there'; this FMU needs casadi>=" in one.errors
    assert np.isnan(one.get("y"))


# -- at export ------------------------------------------------------------------------------------


def test_unwritable_path(tmp_path):
    with pytest.raises(ExportError, match=r"cannot write '.*nowhere.*': there is no folder"):
        fmu_export(python(failing), tmp_path / "nowhere" / "it.fmu", kind="python")


def test_versions_and_solvers_that_there_are_not(export):
    with pytest.raises(ExportError, match=r"kind 'python' has version 2\.0 of FMI, not '3\.0'"):
        export(python(failing), version="3.0")
    with pytest.raises(ExportError, match="a native FMU has the solver rk4 inside, not 'BDF'"):
        fmu_export(python(failing), "it.fmu", solver="BDF")
    with pytest.raises(ExportError, match="unknown solver 'magic'; choose from"):
        export(python(failing), solver="magic")


def test_what_cannot_be_taken_along_is_named(export, tmp_path):
    with (tmp_path / "open.txt").open("w") as file:

        def write(u):
            file.write(str(u))
            return u

        with pytest.raises(ExportError, match=r"attribute '_function' of block 'PythonFunction'"):
            export(python(write))


def test_imports_inside_functions(export):
    """What a function imports when it runs is there only if it is installed on the target."""

    def standard(u):
        import math

        return math.sin(u)

    def ours(u):
        from trussflow.blocks import Gain

        return Gain(u)

    export(python(standard))
    with pytest.raises(ExportError, match=r"'ours' \(test_misuse\.py:\d+\) imports 'trussflow\.bl"):
        export(python(ours))


def test_copy_that_does_not_run(export):
    class Once(Block):
        """It cannot be built again from its parts."""

        traced = False
        u = Input()
        y = Output()

        def __setstate__(self, state):
            raise OSError("the device is taken")

        def output(self, t, x, u, p):
            return {"y": u.u}

    with pytest.raises(ExportError, match=r"copy .* does not run: OSError: the device is taken"):
        export(Once().sampled(0.1))


def test_output_without_a_start_value(export):
    inverse = Function(lambda u: 1.0 / u, **PORTS)
    with pytest.raises(ExportError, match="'y' has no start value"):
        export(inverse)
    export(inverse, start={"u": 1.0})


def test_unknown_parameter(export, make_loop):
    with pytest.raises(ExportError, match=r"no parameter 'plant\.mass'; the parameters are: "):
        export(make_loop(python=False), parameters={"plant.mass": 1.0})

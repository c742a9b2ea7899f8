"""Misuse: a clear error at export, or the standard's status with a log text that says why."""

import logging
import re
import zipfile

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from systems import ports

from trussflow.blocks import Block, Function, Input, Output, PythonFunction
from trussflow.blocks.results.dataset import own_version
from trussflow.fmu.errors import ExportError, FmuCallError
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation

COMMUNICATION_STEP = 0.01


def python(function):
    return PythonFunction(function, COMMUNICATION_STEP, **ports(u=(), y=()))


@pytest.fixture
def one(loop_fmu, instance):
    return instance(loop_fmu)


def refused(one, time, length, message):
    with pytest.raises(FMICallException, match="discard"):
        one.doStep(time, length)
    assert message in one.errors


@pytest.mark.parametrize(
    "values, message",
    [
        (
            {"goal[2]": np.nan},
            "the step of 0.01 s from t = 0 s failed: input 'goal' is not finite",
        ),
        (
            {"plant.stiffness": -1.0},
            "'stiffness' of block 'plant' is -1.0; it must be above 0 [N*m]",
        ),
        ({"plant.v[1]": 1.0}, "'plant.v[1]' cannot be set after initialization"),
        ({"angle[1]": 1.0}, "'angle[1]' cannot be set at any time"),
    ],
)
def test_values_that_are_refused(one, values, message):
    one.start()
    one.set(values)
    refused(one, 0.0, COMMUNICATION_STEP, message)


def test_fixed_parameter_cannot_be_set_later(one):
    """`release` matters only at the start, so it is fixed; `gain` is tunable.

    Dependencies of Python blocks are unknown: with one in the loop, every parameter is tunable.
    """
    one.start().doStep(0.0, COMMUNICATION_STEP)
    one.set({"law.gain": 3.0})
    one.doStep(COMMUNICATION_STEP, COMMUNICATION_STEP)
    one.set({"plant.release[1]": 1.0})
    if "sum[1]" in one.references:
        one.doStep(2 * COMMUNICATION_STEP, COMMUNICATION_STEP)
    else:
        refused(
            one,
            2 * COMMUNICATION_STEP,
            COMMUNICATION_STEP,
            "'plant.release[1]' cannot be set after initialization",
        )


def test_initialization_out_of_bounds(one):
    text = "initialization failed: parameter 'stiffness' of block 'plant' is -1.0"
    refused(one.start({"plant.stiffness": -1.0}), 0.0, COMMUNICATION_STEP, text)


def test_unknown_value_reference_and_wrong_type(one):
    one.start()
    assert np.isnan(one.getReal([1_000_000])[0])
    assert "there is no variable with value reference 1000000" in one.errors
    one.getInteger([1])
    assert (
        "all variables are of type Real; value references [1] were used otherwise"
        in one.errors
    )


@pytest.mark.parametrize(
    "time, length, message",
    [
        (0.5, 0.01, "the step starts at t = 0.5 s, but the current time is 0 s"),
        (0.0, -0.01, "a step of -0.01 s from t = 0.0 s is not possible"),
        (0.0, np.nan, "a step of nan s from t = 0.0 s is not possible"),
    ],
)
def test_steps_that_make_no_sense(one, time, length, message):
    refused(one.start(), time, length, message)


def test_step_without_initialization(one):
    refused(
        one,
        0.0,
        COMMUNICATION_STEP,
        "a step is possible only between initialization and termination",
    )


def failing(u):
    if u > 1.0:
        raise ZeroDivisionError(f"100 % of {u}")
    return u


def test_error_in_users_code_is_logged_with_its_cause(export, instance, caplog):
    """The traceback leads to the line; Python's log has it as well."""
    one = instance(export(python(failing))).start()
    one.doStep(0.0, COMMUNICATION_STEP)
    one.set({"u": 2.0})
    with caplog.at_level(logging.ERROR):
        refused(
            one,
            COMMUNICATION_STEP,
            COMMUNICATION_STEP,
            "raised ZeroDivisionError at t = 0.01 s: 100 %",
        )
    # Not the file's name: what cloudpickle 3.1.3 and later packs forgets it, the line stays.
    line = f"line {failing.__code__.co_firstlineno + 2}, in failing"
    assert line in one.errors
    assert "raised ZeroDivisionError at t = 0.01 s: 100 %" in caplog.text
    assert line in caplog.text


MISSING_LIBRARY = (
    b"clibrary_that_is_not_there\nThing\n."  # a pickle that refers to a library
)


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"slave": (b"0.1.0'", b"0.0.9'")}, r"the version of trussflow is 0\.1\.0"),
        ({"slave": (b'version("trussflow")', b'version("nowhere")')}, "nowhere"),
        ({"item": MISSING_LIBRARY}, "No module named 'library_that_is_not_there'"),
        (
            {"slave": (b"made = '3", b"made = '2")},
            r"compiled for Python 2\.\d+; this is Python 3\.\d+",
        ),
    ],
)
def test_instantiation_names_what_is_missing(
    changes, message, export, tmp_path, caplog
):
    """Another version of trussflow, none, no library of the user's, another version of Python."""
    # Each case has a function of its own, as a process keeps the modules of the FMUs that ran in it.
    fmu, changed = export(python(lambda u: u + len(message))), tmp_path / "changed.fmu"
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(changed, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            change = changes.get(
                name.removeprefix("resources/").replace(".", "_").partition("_")[0]
            )
            if isinstance(change, tuple):
                assert change[0] in content or name.endswith(".txt")
                content = content.replace(*change)
            new.writestr(name, change if isinstance(change, bytes) else content)
    needs = f"{message}; this FMU needs cloudpickle>="
    # The files of the first attempt are deleted before the second; the wrapper logs only if told to.
    for logs in (True, False):
        with (
            pytest.raises(FmuCallError, match=needs),
            LoadedCoSimulation(changed, logging=logs) as one,
        ):
            one.setup()
    # an importer may have switched the FMU's log off
    assert re.search(needs, caplog.text)


def test_requirements_name_the_version_of_trussflow(export):
    with zipfile.ZipFile(export(python(failing))) as archive:
        lines = archive.read("resources/requirements.txt").decode().split()
    assert f"trussflow=={own_version()}" in lines


# -- at export ------------------------------------------------------------------------------------


class Once(Block):
    """A block that cannot be built again from its parts."""

    traced = False
    u, y = Input(), Output()

    def __setstate__(self, state):
        raise OSError("the device is taken")

    def output(self, t, x, u, p):
        return {"y": u.u}


def imports_the_users_module(u):
    from systems import ports

    return ports(u=u)


@pytest.mark.parametrize(
    "make, settings, message",
    [
        (
            lambda: python(failing),
            {"version": "3.0"},
            r"kind 'python' has version 2\.0 of FMI, not '3\.0'",
        ),
        (
            lambda: python(failing),
            {"solver": "magic"},
            "unknown solver for kind='python': 'magic'; choose from",
        ),
        (
            lambda: python(imports_the_users_module),
            {},
            r"'imports_the_users_module' \(test_misuse\.py:\d+\) imports 'systems' inside",
        ),
        (
            lambda: Once().sampled(0.1),
            {},
            r"copy .* does not run: OSError: the device is taken",
        ),
        (
            lambda: Function(lambda u: 1.0 / u, **ports(u=(), y=())),
            {},
            "'y' has no start value",
        ),
    ],
)
def test_exports_that_are_refused(export, make, settings, message):
    with pytest.raises(ExportError, match=message):
        export(make(), **settings)


def test_an_open_file_cannot_be_exported(export, tmp_path):
    with (tmp_path / "open.txt").open("w") as file:

        def write(u):
            file.write(str(u))
            return u

        with pytest.raises(
            ExportError, match=r"attribute '_function' of block 'PythonFunction'"
        ):
            export(python(write))


def test_exports_that_are_possible(export):
    """With an import from the standard library inside a function, and with a start value."""

    def standard(u):
        import math

        return math.sin(u)

    export(python(standard))
    export(Function(lambda u: 1.0 / u, **ports(u=(), y=())), start={"u": 1.0})

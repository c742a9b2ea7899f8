"""Calls that make no sense get the status of the standard and a log text that says why."""

from pathlib import Path

import pytest
from fmpy.fmi1 import FMICallException

from trussflow.fmu.exporting.description.export_interface import ExportInterface

DISCARD, ERROR = 2, 3


@pytest.fixture(params=["2.0", "3.0"])
def path(request, exported, systems):
    return Path(exported(systems.Oscillator(2), request.param, "two"))


@pytest.fixture(scope="module")
def refs(systems):
    return {v.name: v.reference for v in ExportInterface.of(systems.Oscillator(2)).variables}


def refused(log, text, status, call, *arguments):
    with pytest.raises(FMICallException) as refusal:
        call(*arguments)
    assert refusal.value.status == status
    assert text in log[-1]


def test_fixed_parameter_after_initialization(path, refs, tmp_path, fmi):
    log: list[str] = []
    with fmi.opened(path, "cs", tmp_path, log) as fmu:
        fmi.started(fmu)
        before = fmi.read(fmu, refs["initial_position"], 2).tolist()
        refused(
            log,
            "cannot set initial_position (element 1): a fixed parameter",
            ERROR,
            fmi.write,
            fmu,
            refs["initial_position"],
            [3.0, 4.0],
        )
        assert fmi.read(fmu, refs["initial_position"], 2).tolist() == before


def test_tunable_parameter_changes_the_run_between_steps(path, refs, tmp_path, fmi):
    with fmi.opened(path, "cs", tmp_path) as fmu:
        fmi.started(fmu)
        fmu.doStep(0.0, 0.5)
        before = fmi.read(fmu, refs["der(v)"], 2)
        fmi.write(fmu, refs["damping"], [7.0])
        assert (fmi.read(fmu, refs["der(v)"], 2) != before).all()


def test_tunable_parameter_in_continuous_time_mode(path, refs, tmp_path, fmi):
    log: list[str] = []
    with fmi.opened(path, "me", tmp_path, log) as fmu:
        fmi.started(fmu)
        fmi.write(fmu, refs["damping"], [1.0])  # event mode
        fmu.enterContinuousTimeMode()
        text = "cannot set damping (element 1): a tunable parameter can be set between steps"
        refused(log, text, ERROR, fmi.write, fmu, refs["damping"], [2.0])


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_input_that_is_not_finite(value, path, refs, tmp_path, fmi):
    """Nothing is set, not even the elements before it."""
    log: list[str] = []
    with fmi.opened(path, "cs", tmp_path, log) as fmu:
        fmi.started(fmu)
        text = "cannot set force (element 2): the value is not finite"
        refused(log, text, DISCARD, fmi.write, fmu, refs["force"], [1.0, value])
        assert fmi.read(fmu, refs["force"], 2).tolist() == [0.0, 0.0]
        fmu.doStep(0.0, 0.1)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("position", "it is calculated"),
        ("der(q)", "it is calculated"),
        ("time", "it is calculated"),
        ("q", "it is calculated from parameters or inputs; set those"),
        ("v", "a state can be set here only before the end of initialization"),
    ],
)
def test_what_cannot_be_set(name, why, path, refs, tmp_path, fmi):
    log: list[str] = []
    with fmi.opened(path, "cs", tmp_path, log) as fmu:
        fmi.started(fmu)
        values = [1.0] if name == "time" else [1.0, 1.0]
        refused(log, f"cannot set {name} (element 1): {why}", ERROR, fmi.write, fmu, refs[name], values)


def test_a_state_without_parameter_starts_where_it_is_set(path, refs, tmp_path, fmi):
    with fmi.opened(path, "cs", tmp_path) as fmu:
        fmi.started(fmu, {refs["v"]: [2.0, 3.0]})
        assert fmi.read(fmu, refs["v"], 2).tolist() == [2.0, 3.0]
        assert fmi.read(fmu, refs["q"], 2).tolist() == [1.0, 1.0]


def test_unknown_reference(path, tmp_path, fmi):
    log: list[str] = []
    with fmi.opened(path, "cs", tmp_path, log) as fmu:
        fmi.started(fmu)
        refused(log, "no variable with value reference 9999", ERROR, fmi.read, fmu, 9999, 1)


def test_calls_out_of_order(path, refs, tmp_path, fmi):
    log: list[str] = []
    with fmi.opened(path, "cs", tmp_path, log) as fmu:
        refused(log, "cannot be called before initialization", ERROR, fmu.doStep, 0.0, 0.1)
        refused(log, "cannot be called before initialization", ERROR, fmi.read, fmu, 1, 1)
        fmi.started(fmu)
        refused(log, "cannot be called between steps", ERROR, fmu.exitInitializationMode)
        fmu.terminate()
        refused(log, "cannot be called after termination", ERROR, fmu.doStep, 0.0, 0.1)
        fmi.read(fmu, refs["position"], 2)


@pytest.mark.parametrize(
    ("time", "step", "text"),
    [
        (0.0, 0.0, "a step of 0 is not positive"),
        (0.0, -1.0, "a step of -1 is not positive"),
        (0.0, float("nan"), "is not positive and finite"),
        (0.5, 0.1, "the step starts at 0.5, but the last one ended at 0"),
        (0.0, 2.0, "the step ends at 2, after the stop time 1"),
    ],
)
def test_steps_that_make_no_sense(time, step, text, path, tmp_path, fmi):
    log: list[str] = []
    with fmi.opened(path, "cs", tmp_path, log) as fmu:
        fmi.started(fmu, stop=1.0)
        refused(log, text, ERROR, fmu.doStep, time, step)
        fmu.doStep(0.0, 1.0)


def test_a_start_that_is_not_finite(exported, systems, tmp_path, fmi):
    log: list[str] = []
    with fmi.opened(exported(systems.Oscillator(2), "2.0", "two"), "cs", tmp_path, log) as fmu:
        refused(log, "cannot start at nan", ERROR, fmu.setupExperiment, None, float("nan"))


def test_derivatives_of_what_is_no_unknown(refs, exported, systems, tmp_path, fmi):
    log: list[str] = []
    with fmi.opened(exported(systems.Oscillator(2), "2.0", "two"), "cs", tmp_path, log) as fmu:
        fmi.started(fmu)
        call = fmu.getDirectionalDerivative
        refused(log, "is no unknown", ERROR, call, [refs["force"]], [refs["q"]], [1.0])
        refused(log, "is no known", ERROR, call, [refs["der(q)"]], [refs["position"]], [1.0])


def test_arrays_of_the_wrong_size(refs, exported, systems, tmp_path, fmi):
    log: list[str] = []
    with fmi.opened(exported(systems.Oscillator(2), "3.0", "two"), "cs", tmp_path, log) as fmu:
        fmi.started(fmu)
        text = "the variables have 2 elements, but 3 values are given"
        refused(log, text, ERROR, fmi.write, fmu, refs["force"], [1.0, 2.0, 3.0])
        refused(log, "no variable with value reference", ERROR, fmi.read, fmu, refs["force"] + 1, 1)


def test_discards_are_told_only_to_importers_that_listen(path, refs, tmp_path, fmi):
    """A solver that tries large steps is not flooded with messages; errors are always told."""
    log: list[str] = []
    with fmi.opened(path, "cs", tmp_path, log) as fmu:
        fmi.started(fmu)
        quiet = fmu.fmi2SetDebugLogging if hasattr(fmu, "setReal") else fmu.fmi3SetDebugLogging
        quiet(fmu.component, 0, 0, None)
        with pytest.raises(FMICallException):
            fmi.write(fmu, refs["force"], [float("nan"), 0.0])
        assert log == []
        with pytest.raises(FMICallException):
            fmu.doStep(0.0, -1.0)
        assert len(log) == 1

"""Calls that make no sense get the status of the standard and a log text with the reason."""

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from numpy.testing import assert_array_equal

DISCARD, ERROR = 2, 3


@pytest.fixture
def make(exported, systems, instance):
    """Return a function that instantiates the oscillator of two masses."""
    return lambda version, kind="cs": instance(
        exported(systems.Oscillator(2), version, "two"), kind
    )


@pytest.fixture(params=["2.0", "3.0"])
def one(request, make):
    return make(request.param)


def refused(one, text, status, call, *arguments):
    with pytest.raises(FMICallException) as refusal:
        call(*arguments)
    assert refusal.value.status == status
    assert text in one.log[-1][1]


def test_tunable_parameter_changes_the_run_between_steps(one):
    one.start().doStep(0.0, 0.5)
    before = one.get("der(v)")
    one.set({"damping": 7.0})
    assert (one.get("der(v)") != before).all()


def test_tunable_parameter_in_continuous_time_mode(version, make):
    one = make(version, "me").start()
    one.set({"damping": 1.0})  # event mode
    one.enterContinuousTimeMode()
    text = (
        "cannot set damping (element 1): a tunable parameter can be set between steps"
    )
    refused(one, text, ERROR, one.set, {"damping": 2.0})


@pytest.mark.parametrize(
    "name, values, status, why",
    [
        ("force", [1.0, np.nan], DISCARD, "(element 2): the value is not finite"),
        ("force", [1.0, np.inf], DISCARD, "(element 2): the value is not finite"),
        ("initial_position", [3.0, 4.0], ERROR, "(element 1): a fixed parameter"),
        ("position", [1.0, 1.0], ERROR, "(element 1): it is calculated"),
        ("der(q)", [1.0, 1.0], ERROR, "(element 1): it is calculated"),
        ("time", 1.0, ERROR, "(element 1): it is calculated"),
        (
            "q",
            [2.0, 1.0],
            ERROR,
            "(element 1): it is calculated from parameters or inputs; set those",
        ),
        (
            "v",
            [1.0, 1.0],
            ERROR,
            "(element 1): a state can be set here only before the end of initialization",
        ),
    ],
)
def test_a_value_that_is_refused_changes_nothing(name, values, status, why, one):
    one.start()
    before = one.get()
    refused(one, f"cannot set {name} {why}", status, one.set, {name: values})
    assert_array_equal(one.get(), before)
    one.doStep(0.0, 0.1)


def test_a_state_without_parameter_starts_where_it_is_set(one):
    one.start({"v": [2.0, 3.0]})
    assert one.get("v", "q").tolist() == [2.0, 3.0, 1.0, 1.0]


def test_calls_out_of_order(one):
    refused(one, "cannot be called before initialization", ERROR, one.doStep, 0.0, 0.1)
    refused(one, "cannot be called before initialization", ERROR, one.get, "force")
    one.start()
    refused(one, "cannot be called between steps", ERROR, one.exitInitializationMode)
    one.terminate()
    refused(one, "cannot be called after termination", ERROR, one.doStep, 0.0, 0.1)
    one.get("position")


@pytest.mark.parametrize(
    "time, step, text",
    [
        (0.0, 0.0, "a step of 0 is not positive"),
        (0.0, -1.0, "a step of -1 is not positive"),
        (0.0, np.nan, "is not positive and finite"),
        (0.5, 0.1, "the step starts at 0.5, but the last one ended at 0"),
        (0.0, 2.0, "the step ends at 2, after the stop time 1"),
    ],
)
def test_steps_that_make_no_sense(time, step, text, one):
    one.start(stop=1.0)
    refused(one, text, ERROR, one.doStep, time, step)
    one.doStep(0.0, 1.0)


def test_calls_of_fmi_2_that_make_no_sense(make):
    one = make("2.0")
    refused(one, "cannot start at nan", ERROR, one.setupExperiment, None, np.nan)
    one = make("2.0").start()
    call, at = one.getDirectionalDerivative, one.references
    refused(one, "is no unknown", ERROR, call, at["force"][:1], at["q"][:1], [1.0])
    refused(
        one, "is no known", ERROR, call, at["der(q)"][:1], at["position"][:1], [1.0]
    )
    refused(one, "no variable with value reference 9999", ERROR, one.getReal, [9999])


def test_arrays_of_fmi_3_that_do_not_fit(make):
    one = make("3.0").start()
    text = "the variables have 2 elements, but 3 values are given"
    refused(one, text, ERROR, one.set, {"force": [1.0, 2.0, 3.0]})
    (first,) = one.references["force"]
    for reference in (first + 1, 9999):
        text = f"no variable with value reference {reference}"
        refused(one, text, ERROR, one.getFloat64, [reference])


def test_discards_are_logged_only_for_importers_that_listen(one):
    """A solver that tries large steps is not flooded with messages; errors are always logged."""
    one.start()
    quiet = one.fmi2SetDebugLogging if one.scalar else one.fmi3SetDebugLogging
    quiet(one.component, 0, 0, None)
    with pytest.raises(FMICallException):
        one.set({"force": [np.nan, 0.0]})
    assert one.log == []
    with pytest.raises(FMICallException):
        one.doStep(0.0, -1.0)
    assert len(one.log) == 1

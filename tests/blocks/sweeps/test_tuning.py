"""Tuning with and without derivatives: optima that are known, limits that hold, and what is refused."""

import numpy as np
import pytest
from systems import approach

from trussflow.blocks import Simulator, linearize, tune
from trussflow.blocks.errors import DivergenceError, NameLookupError, SimulationError

GAIN_RANGE = {"law.gain": (0.1, 8.0)}
TIME_STEP = 0.01

over_both_ways = pytest.mark.parametrize(
    "way", [{}, {"derivatives": False, "executor": "serial"}], ids=len
)


def missed(run):
    return (run["level.y"][-1] - 0.75) ** 2


def mean_error(run):
    return ((1.0 - run["level.y"]) ** 2).mean()


@over_both_ways
def test_a_requirement_on_poles_holds(way):
    gains = []

    def pole(values):
        gain = values["law.gain"]
        gains.append(gain)
        return (
            np.abs(linearize(approach(gain), "law.u", "level.y").poles()).max() + gain
        )

    found = tune(
        approach(),
        2.0,
        mean_error,
        GAIN_RANGE,
        requirements={"speed": (pole, 4.0)},
        **way,
        step=TIME_STEP,
    )
    if way:
        assert len(gains) == found.runs, "once in each trial"
    assert pole(found.values) == pytest.approx(4.0, rel=1e-5)


@over_both_ways
def test_a_search_comes_back_from_where_runs_diverge(way):
    """With steps of 0.5 s gains above 5.6 are unstable; the slope at first leads there."""
    found = tune(
        approach(),
        400.0,
        lambda run: -run["level.y"][1],
        {"law.gain": (0.1, 1e4)},
        step=0.5,
        iterations=30,
        **way,
    )
    assert found.cost <= found.before
    assert found.values["law.gain"] < 5.6


@over_both_ways
def test_limits_that_cannot_be_met_are_reported(way):
    late = {"late": (lambda run: -run["level.y"][-1], -1.5)}
    found = tune(
        approach(), 2.0, missed, GAIN_RANGE, limits=late, **way, step=TIME_STEP
    )
    assert "limits are not met" in found.message


@over_both_ways
def test_tuning_goes_through_what_values_become(way):
    """From 0, exp(-2 gain) = 1/4 is left after two seconds if the logarithm of the gain is ln ln 2."""
    found = tune(
        approach(),
        2.0,
        missed,
        {"log": ([-2.0], [0.0], [2.0])},
        becoming=lambda log: {"law.gain": np.exp(log)[0]},
        **way,
        step=TIME_STEP,
    )
    assert found.values["log"] == pytest.approx([np.log(np.log(2.0))], abs=1e-4)
    assert found.cost < 1e-8 < found.before
    assert found.message == ""
    assert "log" in repr(found)
    assert found.runs < (100 if way else 20)


@pytest.mark.parametrize(
    "more, match",
    [
        (
            {"vary": {"law.gain": 3.0}},
            r"the range of 'law\.gain' is 3\.0; give \(smallest, initial, largest\), or",
        ),
        ({"vary": {"law.gain": (3.0, 1.0)}}, "the first one less"),
        ({"vary": {"law.gain": ([1.0, 2.0], 3.0)}}, "arrays of the shape"),
        ({"vary": {"law.gain": (1.0, 9.0, 8.0)}}, "in increasing order"),
        (
            {"vary": {"law.gian": (1.0, 8.0)}, "derivatives": False},
            r"no parameter or state 'law\.gian'",
        ),
        ({"vary": {}}, "nothing varies"),
        (
            {"vary": {"k": (1.0, 8.0)}, "becoming": dict},
            r"give \(smallest, initial, largest\)",
        ),
        (
            {"vary": {"k": (1.0, 2.0, 8.0)}, "becoming": lambda k: {"law.gian": k}},
            r"'law\.gian'",
        ),
        (
            {"vary": {"k": (1.0, 2.0, 8.0)}, "becoming": lambda k: k},
            "tuned values must be",
        ),
        ({"cost": lambda run: run["level.y"]}, "must be one number"),
        (
            {"cost": lambda run: run["level.y"], "derivatives": False},
            "must be one number",
        ),
        ({"cost": lambda run: run["level.z"][-1], "derivatives": False}, r"level\.z"),
        ({"limits": {"force": 3.0}}, r"give \(function, most\)"),
        ({"samples": []}, "samples must be"),
        ({"samples": [{"law.gain": 1.0}]}, "none that are tuned"),
        ({"samples": [{"level.integral": 1.0}, {}]}, "the same names"),
        ({"iterations": 0}, "iterations"),
        ({"executor": "serial"}, "are for derivatives=False"),
        (
            {"model": Simulator(approach(), step=TIME_STEP), "derivatives": False},
            "give step to it, not to tune",
        ),
        (
            {
                "model": approach(-400.0),
                "duration": 90.0,
                "vary": {"level.integral": (0.0, 0.5)},
                "derivatives": False,
            },
            "finite",
        ),
    ],
)
def test_bad_input_is_refused(more, match):
    usual = {
        "model": approach(),
        "duration": 1.0,
        "cost": missed,
        "vary": GAIN_RANGE,
        "step": TIME_STEP,
    }
    with pytest.raises(
        (SimulationError, NameLookupError, DivergenceError), match=match
    ):
        tune(**usual | more)

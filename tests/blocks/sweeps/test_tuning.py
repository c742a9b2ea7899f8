"""Tuning: optima that are known, limits that hold, and what is refused."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from trussflow.blocks import Constant, Diagram, Gain, Integrator, SimulationError, linearize, simulate, tune

Run = Mapping[str, Any]
RANGE = {"law.gain": (0.1, 8.0)}
STEP = 0.01


def approach(gain=1.0):
    """Return y' = gain (1 - y), from 0."""
    diagram = Diagram("approach")
    goal, law, level = diagram.add(goal=Constant(1.0), law=Gain(gain), level=Integrator())
    (goal.y - level.y) >> law
    law >> level
    return diagram


def missed(run):
    return (run["level.y"][-1] - 0.75) ** 2


def test_an_optimum_inside_is_found():
    """From 0, exp(-2 gain) = 1/4 is left after two seconds where the gain is ln 2."""
    found = tune(approach(), 2.0, missed, RANGE, step=STEP)
    assert found.values["law.gain"] == pytest.approx(np.log(2.0), rel=1e-4)
    assert found.cost < 1e-8 < found.before
    assert found.message == ""
    assert "law.gain" in repr(found)


def test_a_limit_holds_where_more_would_cost_less():
    """The fastest approach with at most 3 of force is that of gain 3."""
    found = tune(
        approach(),
        2.0,
        lambda run: np.mean((1.0 - run["level.y"]) ** 2),
        RANGE,
        limits={"force": (lambda run: np.max(np.abs(run["law.y"])), 3.0)},
        step=STEP,
    )
    assert found.values["law.gain"] == pytest.approx(3.0, rel=1e-6)
    assert found.limits["force"] == pytest.approx(3.0, rel=1e-6)
    assert found.message == ""


def test_a_requirement_on_poles_holds():
    def pole(values):
        model = linearize(approach(float(values["law.gain"])), "law.u", "level.y")
        return abs(model.poles()).max() + float(values["law.gain"])

    found = tune(
        approach(),
        2.0,
        lambda run: np.mean((1.0 - run["level.y"]) ** 2),
        RANGE,
        requirements={"speed": (pole, 4.0)},
        step=STEP,
    )
    exact = pole({"law.gain": found.values["law.gain"]})
    assert exact == pytest.approx(4.0, rel=1e-5)


def test_the_mean_over_samples_counts():
    """Of 2 and 3 s the best compromise lies between the best for each, and neither starts from it."""
    samples = [{"level.integral": 0.0}, {"level.integral": 0.5}]
    found = tune(approach(), 2.0, missed, RANGE, samples=samples, step=STEP)
    alone = [
        float(tune(approach(), 2.0, missed, RANGE, samples=[one], step=STEP).values["law.gain"])
        for one in samples
    ]
    assert min(alone) < found.values["law.gain"] < max(alone)
    costs = []
    for gain in (found.values["law.gain"] + e for e in (-1e-3, 0.0, 1e-3)):
        runs = [
            simulate(approach(), 2.0, step=STEP, parameters={"law.gain": gain}, initial=s) for s in samples
        ]
        costs.append(np.mean([missed({str(k): v.values for k, v in run.items()}) for run in runs]))
    assert costs[1] == min(costs)
    assert costs[1] == pytest.approx(found.cost, rel=1e-9)


def test_a_search_comes_back_from_where_runs_diverge():
    """With steps of 0.5 s gains above 5.6 are unstable; the slope at first leads there."""
    found = tune(
        approach(), 400.0, lambda run: -run["level.y"][1], {"law.gain": (0.1, 1e4)}, step=0.5, iterations=30
    )
    assert np.isfinite(found.cost)
    assert found.cost <= found.before


def test_limits_that_cannot_be_met_are_told():
    found = tune(
        approach(), 2.0, missed, RANGE, limits={"late": (lambda run: -run["level.y"][-1], -1.5)}, step=STEP
    )
    assert "limits are not met" in found.message


@pytest.mark.parametrize(
    ("more", "match"),
    [
        ({"vary": {"law.gain": 3.0}}, r"'law\.gain' is to be tuned within 3\.0; give \(least, greatest\)"),
        ({"vary": {"law.gain": (3.0, 1.0)}}, "the first one less"),
        ({"vary": {"law.gain": ([1.0, 2.0], 3.0)}}, "arrays of the shape"),
        ({"vary": {}}, "nothing varies"),
        ({"cost": lambda run: run["level.y"]}, "must be one number"),
        ({"limits": {"force": 3.0}}, r"give \(function, most\)"),
        ({"samples": []}, "samples must be"),
        ({"samples": [{"law.gain": 1.0}]}, "none that are tuned"),
        ({"samples": [{"level.integral": 1.0}, {}]}, "the same names"),
        ({"iterations": 0}, "iterations"),
    ],
)
def test_bad_input_is_refused(more, match):
    given: dict[str, Any] = {
        "model": approach(),
        "duration": 1.0,
        "cost": missed,
        "vary": RANGE,
        "step": STEP,
    }
    with pytest.raises(SimulationError, match=match):
        tune(**given | more)

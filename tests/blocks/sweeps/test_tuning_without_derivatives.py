"""Tuning what cannot be differentiated: optima that are known, with any blocks, solvers and functions."""

import numpy as np
import pytest
from systems import approach, ports

from trussflow.blocks import (
    Constant,
    Diagram,
    Gain,
    Integrator,
    PythonFunction,
    Sum,
    simulate,
    tune,
)
from trussflow.blocks.errors import SimulationError, SimulationInterrupted
from trussflow.blocks.simulation.lanes import Lanes
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.sweeps import sweep
from trussflow.blocks.sweeps.samples import Runs
from trussflow.blocks.tracing import compiler

GAIN_RANGE = {"law.gain": (0.1, 8.0)}
TIME_STEP = 0.01
SETTINGS = {"derivatives": False, "executor": "serial", "step": TIME_STEP}


def missed(run):
    return (run["level.y"][-1] - 0.75) ** 2


def mean_error(run):
    return ((1.0 - run["level.y"]) ** 2).mean()


def test_python_blocks_may_run_and_any_function_may_cost():
    """Held for 0.1 s, the error is gone after one sample where the gain is 10, though it is rounded."""
    diagram = Diagram("dead-beat")
    goal, law, level = diagram.add(
        goal=Constant(1.0), law=Gain(6.0), level=Integrator()
    )
    rounded = PythonFunction(lambda u: float(f"{u:.4f}"), 0.1, **ports(u=(), y=()))
    (goal.y - level.y) >> law >> diagram.add(rounded=rounded).u
    rounded.y >> level

    def cost(run):
        return sum(
            (value - 1.0) ** 2 for value in run["level.y"].values[10::10].tolist()
        )

    found = tune(diagram, 1.0, cost, {"law.gain": (1.0, 15.0)}, **SETTINGS)
    assert found.values["law.gain"] == pytest.approx(10.0, abs=0.02)
    assert found.runs < 30


def test_the_optimum_is_that_found_with_derivatives():
    """A double integrator with two gains, its cost as of LQR, its force limited: to 1e-3 of ranges."""
    diagram = Diagram("mass")
    speed, place, stiff, damp = diagram.add(
        speed=Integrator(), place=Integrator(), stiff=Gain(1.0), damp=Gain(1.0)
    )
    force = diagram.add(force=Sum("--"))
    force >> speed >> place >> stiff >> force.u1
    speed >> damp >> force.u2
    exact, found = (
        tune(
            diagram,
            10.0,
            lambda run: (
                (run["place.y"] ** 2).mean() + 0.1 * (run["force.y"] ** 2).mean()
            ),
            {"stiff.gain": (0.0, 5.0), "damp.gain": (0.0, 5.0)},
            limits={"force": (lambda run: abs(run["force.y"]).max(), 4.0)},
            samples=[
                {"place.integral": 1.0, "speed.integral": 0.0},
                {"place.integral": 2.0, "speed.integral": 0.3},
            ],
            **settings,
        )
        for settings in ({"step": TIME_STEP}, SETTINGS)
    )
    for name, value in exact.values.items():
        assert found.values[name] == pytest.approx(value, abs=5e-3)
    assert found.cost == pytest.approx(exact.cost, rel=1e-6)
    assert found.limits["force"] == pytest.approx(4.0, rel=1e-6)


def test_the_mean_of_all_samples_counts_and_limits_hold_in_each():
    """The fastest approach with at most 3 of force in the sample that begins farthest off: gain 2."""
    samples = [{"level.integral": begin} for begin in (-0.5, 0.0, 0.5)]

    def forces(run):
        return np.abs(run["law.y"].values[[0, -1]])

    found = tune(
        approach(), 2.0, mean_error, GAIN_RANGE, limits={"force": (forces, 3.0)}, samples=samples,
        **SETTINGS,
    )  # fmt: skip
    assert found.values["law.gain"] == pytest.approx(2.0, rel=1e-5)
    assert found.limits["force"][0] == pytest.approx(3.0, rel=1e-5)
    costs = [
        mean_error(
            simulate(
                approach(), 2.0, step=TIME_STEP, parameters=found.values, initial=one
            )
        )
        for one in samples
    ]
    assert found.cost == pytest.approx(np.mean(costs), rel=1e-12)


@pytest.mark.parametrize("worth", [1e5, np.inf], ids=["in lanes", "alone"])
def test_no_trial_traces_or_compiles(monkeypatch, tmp_path, worth):
    """Code is compiled once, and once more for lanes, for any number of trials."""
    counts = {"prepared": 0, "compiled": 0, "in lanes": 0}

    def counted(owner, attribute, name):
        own = getattr(owner, attribute)

        def count(*arguments, **keywords):
            counts[name] += 1
            return own(*arguments, **keywords)

        monkeypatch.setattr(owner, attribute, count)

    monkeypatch.setenv("TRUSSFLOW_CACHE", str(tmp_path))
    monkeypatch.setattr(sweep, "MIN_BATCHED_STEPS", worth)
    counted(Prepared, "__init__", "prepared")
    counted(compiler, "_build", "compiled")
    counted(Lanes, "run", "in lanes")
    samples = [{"level.integral": 0.01 * k} for k in range(2 * compiler.lanes())]
    found = tune(
        approach(),
        2.0,
        missed,
        GAIN_RANGE,
        samples=samples,
        derivatives=False,
        step=TIME_STEP,
        workers=2,
    )
    trials = found.runs // len(samples)
    assert trials > 5
    lanes = worth == 1e5
    assert counts.pop("in lanes") >= 2 * trials
    assert counts == {"prepared": 1, "compiled": 1 + lanes}


def test_an_interrupted_search_goes_on(monkeypatch, tmp_path):
    runs = []
    own = Runs.sample

    def counted(self, *sample):
        runs.append(sample)
        return own(self, *sample)

    monkeypatch.setattr(Runs, "sample", counted)
    whole = tune(approach(), 2.0, missed, GAIN_RANGE, **SETTINGS)
    number = len(runs)
    assert whole.runs == number
    first = tune(
        approach(), 2.0, missed, GAIN_RANGE, iterations=4, path=tmp_path, **SETTINGS
    )
    assert "exceeded" in first.message
    again = tune(approach(), 2.0, missed, GAIN_RANGE, path=tmp_path, **SETTINGS)
    assert again.values == whole.values
    assert len(runs) == 2 * number
    with pytest.raises(SimulationError, match="holds another sweep: its keep"):
        tune(approach(), 2.0, mean_error, GAIN_RANGE, path=tmp_path, **SETTINGS)


@pytest.mark.parametrize(
    "most", [8.0, 1.9, -1.0], ids=["free", "limited", "not to be met"]
)
def test_what_is_stopped_by_hand_returns_the_best_until_then(most):
    """Return the best trial, within the limits if any was; the gains are those of the runs."""
    gains = []

    def cost_of(gain):
        return missed(simulate(approach(gain), 2.0, step=TIME_STEP))

    def cost(run):
        gains.append(run["law.y"].values[0])
        if len(gains) == 7:
            raise KeyboardInterrupt
        return missed(run)

    with pytest.raises(
        SimulationInterrupted, match="stopped after 6 trials; the best is"
    ) as stopped:
        tune(
            approach(), 2.0, cost, GAIN_RANGE, requirements={"gain": (lambda v: v["law.gain"], most)},
            **SETTINGS,
        )  # fmt: skip
    best = stopped.value.result
    met = [gain for gain in gains[:6] if gain <= most]
    expected = min(met or gains[:6], key=cost_of if met else abs)
    assert best.values["law.gain"] == pytest.approx(expected)
    assert best.message == ("stopped" if met else "stopped before limits were met")

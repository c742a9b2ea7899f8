"""Sweeps: every sample is a run of its own, with the values that it was given, whoever runs it."""

import re
import sys

import cloudpickle
import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from systems import decay, ports, series

from trussflow.blocks import (
    Constant,
    Noise,
    PythonFunction,
    Simulator,
    rerun,
    simulate,
    sweep,
)
from trussflow.blocks.errors import NameLookupError, SimulationError
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.tracing import compile_cache

# workers cannot import tests
cloudpickle.register_pickle_by_value(sys.modules[__name__])


def noisy():
    return series(
        noise=Noise(1.0, 0.1, seed=0),
        double=PythonFunction(lambda u: 2.0 * u, 0.1, **ports(u=(), y=())),
    )


VARIATION = {
    "back.gain": stats.norm(-1.0, 0.2),
    "x.integral[0]": stats.uniform(1.0, 2.0),
}


def test_each_sample_is_the_run_that_a_user_would_make():
    swept = sweep(
        decay(2), 1.0, vary=VARIATION, samples=5, seed=3, step=0.1, executor="serial"
    )
    for k in range(5):
        parameters = {"back.gain": swept["back.gain"].values[k]}
        initial = {"x.integral": [swept["x.integral[0]"].values[k], 1.0]}
        alone = simulate(
            decay(2), 1.0, parameters=parameters, initial=initial, step=0.1
        )
        assert_array_equal(swept["x.y"][k], alone["x.y"])
        xr.testing.assert_equal(rerun(decay(2), swept, k), alone)
    assert (swept["status"] == "complete").all()


def test_whoever_runs_the_samples_the_dataset_is_the_same_to_the_bit(tmp_path):
    keep = {
        "end": ("double.y", "final"),
        "noise.y": "all",
        "most": lambda run: run["double.y"].max(),
    }
    vary = {"noise.seed": range(7), "noise.standard_deviation": stats.lognorm(0.3)}
    found = [
        sweep(
            noisy(),
            2.0,
            vary=vary,
            samples=3,
            keep=keep,
            step=0.1,
            executor=executor,
            path=path,
        )
        for executor, path in (
            ("serial", None),
            ("serial", tmp_path / "serial"),
            ("threads", None),
            ("processes", tmp_path / "processes"),
        )
    ]
    for other in found[1:]:
        xr.testing.assert_equal(found[0], other)
    assert len(np.unique(found[0]["end"])) == 21


def test_nothing_is_compiled_or_traced_for_a_sample(monkeypatch, tmp_path):
    monkeypatch.setenv("TRUSSFLOW_CACHE", str(tmp_path))
    simulator = Simulator(decay(), step=0.1)
    libraries = [*tmp_path.rglob("*.so")]
    assert libraries
    built = []
    monkeypatch.setattr(Prepared, "__init__", lambda *_: built.append(1))
    monkeypatch.setattr(compile_cache, "_store", lambda *_: built.append(1))
    for executor in ("serial", "threads", "processes"):
        sweep(
            simulator,
            1.0,
            vary={"back.gain": np.linspace(-2, -1, 50)},
            keep=["x.y"],
            executor=executor,
        )
    assert [*tmp_path.rglob("*.so")] == libraries
    assert built == []


def test_arguments_of_a_function_build_other_diagrams():
    vary = {"order": [1, 2, 3], "back.gain": [-1.0, -2.0]}
    keep = {
        "states": lambda run: run["x.y"].shape[1],
        "end": lambda run: run["x.y"][-1].sum(),
    }
    swept = sweep(decay, 1.0, vary=vary, keep=keep, step=0.01, executor="serial")
    assert_array_equal(swept["states"], [1, 1, 2, 2, 3, 3])
    assert_array_equal(swept["order"], [1, 1, 2, 2, 3, 3])
    assert_allclose(
        swept["end"], swept["order"] * np.exp(swept["back.gain"]), rtol=1e-8
    )
    assert rerun(decay, swept, 4)["x.y"].shape[1] == 3


def test_words_say_what_is_made_of_a_signal():
    # The end is exp(-10), the greatest distance from it 1 - exp(-10).
    exact = {
        "max": 1.0,
        "min": np.exp(-10),
        "peak": 1.0,
        "mean": (1 - np.exp(-10)) / 10,
        "rms": np.sqrt((1 - np.exp(-20)) / 20),
        "final": np.exp(-10),
        "settling": -np.log(np.exp(-10) + 0.02 * (1 - np.exp(-10))),
    }
    keep = {word: ("x.y", word) for word in exact}
    swept = sweep(
        decay(),
        10.0,
        vary={"back.gain": [-1.0]},
        keep=keep,
        step=1e-3,
        executor="serial",
    )
    for word, value in exact.items():
        # Of the trapezoidal rule with steps of 1 ms; the last is known to a step.
        assert_allclose(
            swept[word][0], value, rtol=1e-6 if word != "settling" else 3e-4
        )


def test_failed_samples_are_results():
    def keep(run):
        if run.attrs["parameters"].endswith("-2.0]}"):
            raise ValueError("not this one")
        return run["x.y"][-1, 0]

    gains = [-1.0, 1e9, -2.0, -3.0]
    swept = sweep(
        decay(),
        1.0,
        vary={"back.gain": gains},
        keep={"end": keep, "x.y": "all"},
        step=0.1,
        executor="serial",
    )
    assert swept["status"].values.tolist() == [
        "complete",
        "diverged",
        "failed",
        "complete",
    ]
    assert swept["message"].values[2] == "ValueError: not this one"
    assert "stopped being finite" in str(swept["message"].values[1])
    assert_array_equal(np.isfinite(swept["end"]), [True, False, False, True])
    assert_array_equal(swept["back.gain"], gains)
    assert_array_equal(np.isnan(swept["x.y"].values).all((1, 2)), [0, 1, 1, 0])


def test_the_end_is_rerun_from_a_file(tmp_path):
    swept = sweep(
        decay(),
        1.0,
        vary=VARIATION,
        samples=4,
        step=0.1,
        keep={"x.y": "final"},
        path=tmp_path / "s",
    )
    swept.to_netcdf(tmp_path / "swept.nc")
    with xr.open_dataset(tmp_path / "swept.nc") as read:
        worst = int(np.argmax(read["x.y"].values))
        assert (
            rerun(decay(), read, worst)["x.y"].values[-1] == read["x.y"].values[worst]
        )
        with pytest.raises(
            SimulationError, match="'decay' has changed since the sweep"
        ):
            rerun(decay(rate=2.0), read, worst)
        for sample in (7, [1]):
            with pytest.raises(
                SimulationError, match=f"there is no sample {re.escape(str(sample))}"
            ):
                rerun(decay(), read, sample)
    with pytest.raises(
        SimulationError,
        match=r"cannot rerun a sample of 3: give what sweep\(\) returned",
    ):
        rerun(decay(), 3, 0)


WRONG_SETTINGS = {
    "no parameter or initial state 'back.gian'": {"vary": {"back.gian": [1.0]}},
    "no parameter or initial state 'back.input_unit' .*structural": {
        "vary": {"back.input_unit": [1.0]}
    },
    "no parameter or state 'gain': write 'block.gain'": {"vary": {"gain": [1.0]}},
    r"there is no 'x.integral\[1\]': 'x.integral' has shape \(1,\)": {
        "vary": {"x.integral[1]": [1.0]}
    },
    r"'x.integral' has shape \(1,\), its values have \(\); name one element": {
        "vary": {"x.integral": [1.0]}
    },
    r"'back.gain' has shape \(\), its values have \(2,\)": {
        "vary": {"back.gain": [[1.0, 2.0]]}
    },
    "a sweep needs varied values": {"vary": {}},
    "'back.gain' cannot vary over 3.0: give a sequence": {"vary": {"back.gain": 3.0}},
    "'back.gain' cannot vary over": {"vary": {"back.gain": [[1.0], [2.0, 3.0]]}},
    "needs samples=": {"vary": {"back.gain": stats.norm()}},
    "takes no samples": {"samples": 3},
    r"of 'back.gain' has no parameters; give them, as in stats\.norm\(": {
        "vary": {"back.gain": stats.norm},
        "samples": 3,
    },
    "the distribution of 'back.gain' gives": {
        "vary": {"back.gain": stats.norm(1.0, 1e-300)},
        "samples": 3,
    },
    "'back.gain' varies in two ways": {
        "vary": {"back.gain": [1.0], ("back.gain", "x.integral"): [[1, 1]]}
    },
    "vary together: give 2 values": {"vary": {("back.gain", "x.integral[0]"): [1.0]}},
    "cannot keep 'x.z': logged are x.y": {"keep": {"x.z": "max"}, "log": ["x.y"]},
    "cannot keep 'x.y' as 'most': give a function": {"keep": {"x.y": "most"}},
    "cannot keep 3: give 'all'": {"keep": 3},
    "unknown sampling method": {
        "vary": {"back.gain": stats.norm()},
        "samples": 3,
        "method": "grid",
    },
    "executor": {"executor": "cluster"},
}


@pytest.mark.parametrize(
    "distribution",
    [
        stats.rv_histogram(np.histogram([1.0, 2.0, 3.0])),
        stats.rv_discrete(values=([1, 2], [0.5, 0.5])),
    ],
)
def test_distributions_that_are_complete_without_parameters(distribution):
    runs = sweep(
        decay(),
        0.1,
        step=0.1,
        vary={"back.gain": distribution},
        samples=3,
        executor="serial",
    )
    assert np.all((runs["back.gain"] >= 1.0) & (runs["back.gain"] <= 3.0))


def test_more_lists_than_an_array_has_axes():
    values = {f"values.value[{k}]": [float(k)] for k in range(70)}
    diagram = series(values=Constant(np.zeros(70)))
    runs = sweep(
        diagram, 0.1, step=0.1, vary=values, keep=lambda _: 0.0, executor="serial"
    )
    assert float(runs["values.value[69]"][0]) == 69.0


def test_what_is_no_model_is_refused():
    with pytest.raises(SimulationError, match="cannot sweep a dict: give a diagram"):
        sweep({}, 1.0, vary={"x": [1.0]})


@pytest.mark.parametrize("message", WRONG_SETTINGS)
def test_what_makes_no_sense_is_said_before_anything_runs(message):
    with pytest.raises((SimulationError, NameLookupError), match=message):
        sweep(
            decay(),
            1.0,
            step=0.1,
            **{"vary": {"back.gain": [1.0]}} | WRONG_SETTINGS[message],
        )


def test_a_value_that_the_run_does_not_take_over_is_an_error(monkeypatch):
    """Detect values that are drawn and then not used."""
    run = Simulator.run

    def forgets(self, *given, **by_name):
        return run(self, *given, **by_name | {"parameters": {}})

    monkeypatch.setattr(Simulator, "run", forgets)
    settings = {"executor": "serial", "time_limit": 60.0}  # so that it runs alone
    found = sweep(decay(), 1.0, vary={"back.gain": [-3.0]}, step=0.1, **settings)
    assert found["status"] == "failed"
    assert found["message"] == "'back.gain' was to be -3.0, but the run had -1.0"


@pytest.mark.parametrize(
    "keep, name",
    [
        ({"x.integral": "final"}, "x.integral"),
        (["x.integral"], "x.integral"),
        (lambda _: {"status": 1.0}, "status"),
    ],
)
def test_nothing_kept_stands_in_for_what_varied(keep, name):
    """Prevent that `rerun` begins at the end of the sample."""
    settings = {"vary": {"x.integral": [1.0, 2.0]}, "executor": "serial", "step": 0.1}
    with pytest.raises(SimulationError, match=f"'{name}' cannot be kept by that name"):
        sweep(decay(()), 0.2, keep=keep, **settings)
    kept = sweep(decay(()), 0.2, keep={"last": ("x.integral", "final")}, **settings)
    assert_allclose(kept["last"], [np.exp(-0.2), 2 * np.exp(-0.2)], rtol=1e-6, atol=0.0)

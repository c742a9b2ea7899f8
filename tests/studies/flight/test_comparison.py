"""Comparison of the laws: each sample is the run of its seed, and the report counts the successful ones."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from documents import DOCS, TEXTS, heads
from flight import comparison
from flight.comparison import (
    FIRST_SEED,
    SHOWN,
    UNCERTAINTIES,
    all_campaigns,
    correlations,
    errors,
    success_rate,
    with_uncertainties,
)
from flight.loops import LAWS, law_simulator
from flight.metrics import successful
from flight.samples import deviations, sample_parameters


@pytest.mark.usefixtures("plant")
def test_a_sample_is_the_run_of_its_truss(tmp_path):
    campaign = replace(all_campaigns(2)[0], duration=0.1)
    modes = LAWS["published"].truss().dynamics.modes.modes
    found = with_uncertainties(campaign.run(tmp_path, executor="serial"), modes)
    parameters = sample_parameters(LAWS["published"].truss(), FIRST_SEED + 1)
    run = law_simulator("published").run(0.1, parameters=parameters)
    assert {name: float(found[name][1]) for name in errors(run)} == errors(run)
    assert float(found["payload"][1]) == deviations(FIRST_SEED + 1, modes)["payload"]
    assert found["position"][0] != found["position"][1]


def invented(count, diverged=0):
    """Return samples whose position error is proportional to the payload; some diverged."""
    random = np.random.default_rng(3)
    columns = {
        name: random.uniform(0.0, 1e-3, count) for name in (*SHOWN, *UNCERTAINTIES)
    }
    columns["position"] = 1e-3 * columns["payload"]
    columns["position"][:diverged] = np.nan
    status = np.where(np.arange(count) < diverged, "diverged", "complete")
    data = {
        name: ("sample", values)
        for name, values in (columns | {"status": status}).items()
    }
    found = xr.Dataset(data, {"sample": FIRST_SEED + np.arange(count)})
    return found.assign(successful=successful(found))


def test_diverged_samples_and_large_late_errors_fail():
    found = invented(10, diverged=3)
    assert found["successful"].values.tolist() == [False] * 3 + [True] * 7
    found["late position"][5] = 6e-3
    assert int(successful(found).sum()) == 6


def test_success_rates_have_the_interval_of_wilson():
    """For 0 of n it is from 0 to z^2/(n + z^2), z = 1.96."""
    z2 = 1.959963984540054**2
    assert success_rate(np.zeros(100, dtype=bool)) == pytest.approx(
        (0.0, 0.0, z2 / (100 + z2)), abs=1e-12
    )
    low, high = success_rate(np.arange(100) < 50)[1:]
    assert low + high == pytest.approx(1.0, abs=1e-12)


def test_the_uncertainty_that_orders_the_errors_has_correlation_one():
    found = correlations(invented(200).isel(sample=slice(5, None)), "position")
    assert found["payload"] == pytest.approx(1.0, abs=1e-12)
    assert max(abs(found[name]) for name in UNCERTAINTIES if name != "payload") < 0.25
    assert all(np.isnan([*correlations(invented(2), "position").values()]))


def test_the_report_counts_successes_and_names_the_worst_sample(tmp_path, tuned):
    names = [one.name for one in all_campaigns(1)]
    found = {
        name: invented(40, count)
        for name, count in zip(names, (0, 40, 4, 0, 0), strict=True)
    }
    text = comparison.write(found, *tuned, tmp_path, {}).read_text()
    assert heads(text) == heads(TEXTS[DOCS / "sweep/README.md"])
    assert (
        "| mode-neutral, exact | mode-neutral allocation, consistent plant | 36 | 90.0 % |"
        in text
    )
    assert (
        "| published, reference hardware | the paper's law, published plant | 0 | 0 % |"
        in text
    )
    worst = FIRST_SEED + int(np.argmax(found[names[0]]["payload"].values))
    assert f"| published, exact | {worst} |" in text
    numbers = json.loads((tmp_path / "evidence.json").read_text())["numbers"]
    assert numbers["mode-neutral, exact: successful"]["value"] == 36
    assert numbers["tuning: cost"]["value"] == 0.25
    assert (tmp_path / "samples.png").stat().st_size > 3000

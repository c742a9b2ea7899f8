"""Tuning: designs have the values that describe them, and are compared on other seeds."""

import numpy as np
import pytest
import xarray as xr
from flight.loops import flight_simulator
from flight.metrics import GOALS, run_metrics
from flight.samples import run_parameters
from flight.tuning import INITIAL, RANGES, design_of, section, tuned_designs, values_of
from numpy.testing import assert_array_equal
from study_tools.ledger import Ledger

from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.plant.tunable_truss import TunableTruss


def test_a_design_has_the_values_that_describe_it():
    shipped, initial = MeanAxesDesign.shipped(), design_of(INITIAL)
    assert initial.bandwidth.tolist() == [2.0, 0.6, 5.0]
    assert initial.acceleration_noise == pytest.approx([1e-5, 5e-6, 1e-4], rel=1e-12)
    again = design_of(values_of(shipped))
    assert again.bandwidth.tolist() == shipped.bandwidth.tolist()
    assert again.acceleration_noise == pytest.approx(
        shipped.acceleration_noise, rel=1e-12
    )
    for name, value in values_of(shipped).items():
        assert RANGES[name][0] < value < RANGES[name][2]


SHORT = {"seeds": range(1), "others": range(1000, 1002), "trials": 2, "duration": 0.2}


@pytest.mark.campaign
@pytest.mark.usefixtures("plant")
def test_designs_are_compared_on_other_seeds(tmp_path):
    """The shipped design has the metrics of the shipped loop; a second call takes the finished runs."""
    found, compared = tuned_designs(tmp_path, **SHORT)
    truss, seed = TunableTruss.accurate(), SHORT["others"][1]
    parameters = run_parameters(truss, seed)
    run = flight_simulator().run(0.2, parameters=parameters, progress=False)
    shipped, expected = compared["shipped"].sel(sample=seed), run_metrics(run)
    for name in GOALS:
        assert float(shipped[name]) == pytest.approx(
            expected[name], rel=1e-9, abs=1e-12
        ), name
        assert_array_equal(compared["tuned"][name], compared["initial"][name])
    disks = [one.attrs["disk"] for one in compared.values()]
    assert disks == pytest.approx([0.378, 0.334, 0.378], abs=1e-3)
    assert found.runs == 2
    assert "disk" not in found.message
    times = [file.stat().st_mtime_ns for file in sorted(tmp_path.rglob("*.nc"))]
    for name, again in tuned_designs(tmp_path, **SHORT)[1].items():
        xr.testing.assert_equal(again, compared[name])
    assert [file.stat().st_mtime_ns for file in sorted(tmp_path.rglob("*.nc"))] == times


def test_the_section_compares_run_by_run_and_shows_diverged_runs(tuned):
    ledger = Ledger()
    text = section(*tuned, ledger)
    numbers = {name: number["value"] for name, number in ledger.numbers.items()}
    shipped, best = (tuned[1][name] for name in ("shipped", "tuned"))
    gain = sum(
        (shipped[name] - best[name]).values / GOALS[name] / len(GOALS)
        for name in ("position", "late force")
    )
    assert numbers["tuning, shipped: gain"] == pytest.approx(gain.mean(), rel=1e-12)
    assert numbers["tuning, shipped: gain, ±"] == pytest.approx(
        1.96 * gain.std(ddof=1) / 2.0, rel=1e-12
    )
    assert np.isnan(numbers["tuning, initial: gain"])
    for name, expected in (("all goals met", [2, 3, 4]), ("second step", [1, 1, 0])):
        assert [numbers[f"tuning, {design}: {name}"] for design in tuned[1]] == expected
    assert "| initial | not a number | not a number |" in text
    assert "seeds 2000 to 2003" in text

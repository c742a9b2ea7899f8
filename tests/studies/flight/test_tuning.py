"""Tuning: designs have the values that describe them, and are compared on other seeds."""

import numpy as np
import pytest
import xarray as xr
from flight.campaigns import Campaign
from flight.loops import flight_simulator
from flight.metrics import GOALS, run_metrics
from flight.samples import noise_parameters, sample_parameters
from flight.tuning import INITIAL, RANGES, Tuning, design_of, section, values_of
from numpy.testing import assert_array_equal
from study_tools.ledger import Ledger

from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.plant.tunable_truss import TunableTruss

DISKS = {"accurate": [0.236, 0.261, 0.236], "consistent": [0.248, 0.276, 0.248]}


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


TUNING = Tuning(seeds=range(1), others=range(1000, 1002), trials=2, duration=0.2)


def test_designs_are_compared_on_other_seeds(plant):
    """The shipped design is simulated as in any other campaign."""
    found, truss = TUNING.run(), TunableTruss.accurate()
    expected = Campaign(
        section="",
        name="",
        loop=flight_simulator,
        rows=[
            sample_parameters(truss, seed) | noise_parameters(seed)
            for seed in TUNING.others
        ],
        labels=TUNING.others,
        keep=run_metrics,
        duration=TUNING.duration,
    ).run(executor="serial")
    for name in GOALS:
        shipped = found[name].sel(design="shipped").values
        assert shipped == pytest.approx(expected[name].values, rel=1e-9, abs=1e-12), (
            name
        )
        assert_array_equal(
            found[name].sel(design="tuned"), found[name].sel(design="initial")
        )
    assert found["disk"].values == pytest.approx(DISKS[plant], abs=1e-3)
    assert found.attrs["runs"] == 2
    assert "disk" not in found.attrs["message"]


@pytest.mark.campaign
@pytest.mark.usefixtures("plant")
def test_tuning_resumes(tmp_path):
    found = TUNING.run(tmp_path)
    times = [file.stat().st_mtime_ns for file in sorted(tmp_path.rglob("*.nc"))]
    xr.testing.assert_identical(TUNING.run(tmp_path), found)
    assert [file.stat().st_mtime_ns for file in sorted(tmp_path.rglob("*.nc"))] == times


def test_the_section_compares_run_by_run_and_shows_diverged_runs(tuned):
    ledger = Ledger()
    text = section(tuned, ledger)
    numbers = {name: number.value for name, number in ledger.numbers.items()}
    gain = tuned["share"].values[1] - tuned["share"].values[2]
    assert numbers["tuning, shipped: gain"] == pytest.approx(gain.mean(), rel=1e-12)
    assert numbers["tuning, shipped: gain, ±"] == pytest.approx(
        1.96 * gain.std(ddof=1) / 2.0, rel=1e-12
    )
    assert np.isnan(numbers["tuning, initial: gain"])
    assert [numbers[f"tuning, {d}: all goals met"] for d in tuned["design"].values] == [
        2,
        3,
        4,
    ]
    assert [numbers[f"tuning, {d}: second step"] for d in tuned["design"].values] == [
        1,
        0,
        0,
    ]
    assert "| initial | not a number | not a number |" in text
    assert "seeds 2000 to 2003" in text

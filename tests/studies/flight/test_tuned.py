"""The study of a tuned design: designs are what their values say, and flights those of the seeds."""

import numpy as np
import pytest
import xarray as xr
from flight import tuned as tuned_study
from flight.measures import UNITS
from flight.tuned import RANGES, Tuning, design_of, values_of
from flight.tuned_section import section
from numpy.testing import assert_array_equal
from study_tools.ledger import Ledger

from trussflow.models.mean_axes.design import MeanAxesDesign

DISKS = {"accurate": [0.236, 0.261, 0.236], "consistent": [0.248, 0.276, 0.248]}


def test_a_design_is_what_its_values_say_and_begins_as_it_was_chosen_by_hand():
    shipped, by_hand = MeanAxesDesign.shipped(), design_of({k: v[1] for k, v in RANGES.items()})
    assert by_hand.bandwidth.tolist() == [2.0, 0.6, 5.0]
    assert by_hand.acceleration_noise == pytest.approx([1e-5, 5e-6, 1e-4], rel=1e-12)
    again = design_of(values_of(shipped))
    assert again.bandwidth.tolist() == shipped.bandwidth.tolist()
    assert again.acceleration_noise == pytest.approx(shipped.acceleration_noise, rel=1e-12)
    for name, value in values_of(shipped).items():
        assert RANGES[name][0] < value < RANGES[name][2]


STUDY = Tuning(seeds=range(1), others=range(1000, 1002), trials=2, duration=0.2)


def test_designs_are_compared_on_seeds_that_nothing_was_tuned_on(plant):
    """The shipped design is simulated as any other study simulates it."""
    found = STUDY.fly()
    flights = vars(tuned_study)["Flights"](1)  # prepared already
    parameters = [flights.parameters(seed) for seed in STUDY.others]
    expected = flights.measured(parameters, STUDY.others, STUDY.duration)
    for name in UNITS:
        shipped = found[name].sel(design="shipped").values
        assert shipped == pytest.approx(expected[name].values, rel=1e-9, abs=1e-12), name
        assert_array_equal(found[name].sel(design="tuned"), found[name].sel(design="by hand"))
    assert found["disk"].values == pytest.approx(DISKS[plant], abs=1e-3)
    assert found.attrs["runs"] == 2
    assert "disk" not in found.attrs["message"]


@pytest.mark.campaign
@pytest.mark.usefixtures("plant")
def test_a_study_simulates_nothing_twice(tmp_path):
    found = STUDY.fly(tmp_path)
    times = [file.stat().st_mtime_ns for file in sorted(tmp_path.rglob("*.nc"))]
    xr.testing.assert_identical(STUDY.fly(tmp_path), found)
    assert [file.stat().st_mtime_ns for file in sorted(tmp_path.rglob("*.nc"))] == times


def test_the_section_compares_seed_by_seed_and_hides_no_lost_flight(tuned):
    study, found = tuned
    ledger = Ledger()
    text = section(study, found, ledger)
    numbers = {name: number.value for name, number in ledger.numbers.items()}
    gain = found["share"].values[1] - found["share"].values[2]
    assert numbers["tuning, shipped: gain"] == pytest.approx(gain.mean(), rel=1e-12)
    assert numbers["tuning, shipped: gain, ±"] == pytest.approx(1.96 * gain.std(ddof=1) / 2.0, rel=1e-12)
    assert np.isnan(numbers["tuning, by hand: gain"])
    assert [numbers[f"tuning, {d}: all goals met"] for d in found["design"].values] == [2, 3, 4]
    assert [numbers[f"tuning, {d}: second step"] for d in found["design"].values] == [1, 0, 0]
    assert "| by hand | not a number | not a number |" in text
    assert "Seeds 2000 to 2003" in text

"""Samples of what is uncertain: each is the flight that its seed says, and the report counts them."""

import json

import numpy as np
import pytest
import xarray as xr
from documents import DOCS, TEXTS, heads
from flight import samples_report
from flight.draws import Draw, truss_of
from flight.ladder import LAWS
from flight.samples import FIRST, UNCERTAINTIES, UNITS, Study, errors, flies, share, studies, what_matters


@pytest.mark.usefixtures("plant")
def test_a_sample_is_the_flight_of_its_truss(tmp_path):
    study = Study(law="published", flown=False)
    found = study.fly(2, tmp_path, duration=0.3)
    law = LAWS["published"]
    plant, simulator = law.simulator(law.hardware(), ("truss.base_force",))
    modes = plant.dynamics.modes
    truss = plant.truss_parameters(truss_of(FIRST + 1, modes))
    run = simulator.run(0.3, parameters={f"truss.{k}": v for k, v in truss.items()}, progress=False)
    assert {name: float(found[name][1]) for name in UNITS} == errors(run)
    assert float(found["payload"][1]) == Draw.of_seed(FIRST + 1, modes.modes).payload
    assert found["position"][0] != found["position"][1]


def made(count, lost=0):
    """Return samples whose error of position is the payload's, some of them lost."""
    random = np.random.default_rng(3)
    columns = {name: random.uniform(0.0, 1e-3, count) for name in (*UNITS, *UNCERTAINTIES)}
    columns["position"] = 1e-3 * columns["payload"]
    columns["position"][:lost] = np.nan
    status = np.where(np.arange(count) < lost, "diverged", "complete")
    data = {name: ("sample", values) for name, values in (columns | {"status": status}).items()}
    found = xr.Dataset(data, {"sample": np.arange(count)})
    return found.assign(flies=flies(found))


def test_what_is_lost_does_not_fly():
    found = made(10, lost=3)
    assert found["flies"].values.tolist() == [False] * 3 + [True] * 7
    found["late position"][5] = 6e-3
    assert int(flies(found).sum()) == 6


def test_shares_have_the_interval_of_wilson():
    """For 0 of n it is from 0 to z^2/(n + z^2), z = 1.96."""
    z2 = 1.959963984540054**2
    assert share(np.zeros(100, dtype=bool)) == pytest.approx((0.0, 0.0, z2 / (100 + z2)), abs=1e-12)
    low, high = share(np.arange(100) < 50)[1:]
    assert low + high == pytest.approx(1.0, abs=1e-12)


def test_what_matters_is_what_orders_the_errors():
    found = what_matters(made(200, lost=5), "position")
    assert found["payload"] == pytest.approx(1.0, abs=1e-12)
    assert max(abs(found[name]) for name in UNCERTAINTIES if name != "payload") < 0.25
    assert all(np.isnan([*what_matters(made(4, lost=3), "position").values()]))


def test_the_report_tells_how_many_fly_and_names_the_worst(tmp_path, tuned):
    flown = {study: made(40, lost) for study, lost in zip(studies(), (0, 40, 4, 0, 0), strict=True)}
    text = samples_report.write(flown, tuned, tmp_path).read_text()
    assert heads(text) == {head.replace(" 64 ", " 4 ") for head in heads(TEXTS[DOCS / "sweep/README.md"])}
    assert "| mode-neutral, exact | mode-neutral, consistent plant | 36 | 90.0 % |" in text
    assert "| published, hardware of the flight | source's law, published plant | 0 | 0 % |" in text
    worst = FIRST + int(np.argmax(flown[studies()[0]]["payload"].values))
    assert f"| published, exact | {worst} |" in text
    numbers = json.loads((tmp_path / "evidence.json").read_text())["numbers"]
    assert numbers["mode-neutral, exact: flown"]["value"] == 36
    assert numbers["tuning: cost"]["value"] == 0.25
    assert (tmp_path / "samples.png").stat().st_size > 3000

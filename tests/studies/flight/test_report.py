"""The report says what the jobs found, counts what is missed, and knows the code that made it."""

import json

import numpy as np
import pytest
import xarray as xr
from documents import DOCS, TEXTS, heads
from flight.__main__ import main
from flight.campaign import Draws
from flight.edges import Edge
from flight.emergencies import MEASURES, Emergencies
from flight.ladder import Rung
from flight.margins import VARIATIONS
from flight.measures import UNITS
from flight.on_paper import OnPaper
from flight.report import jobs, write
from flight.robustness import Robustness
from flight.sparing import Sparing
from study_tools.cache import perform


def dataset(value, names, **coords):
    """Return columns of one value along the coordinates."""
    shape = [len(each) for each in coords.values()]
    return xr.Dataset({name: (list(coords), np.full(shape, value)) for name in names}, coords)


def invented(job):
    """Return results of a job."""
    if isinstance(job, Draws):
        return dataset(1e-6, UNITS, seed=range(job.first, job.first + job.count))
    if isinstance(job, Emergencies):
        labels = [str(loss) for loss in job.losses()]
        return dataset(0.0, (*MEASURES, "found_after", "false_alarms"), flight=labels)
    if isinstance(job, Robustness):
        each = {"seed": list(job.seeds), "instant": ["at rest", "coast"]}
        return dataset(0.3, ("disk", "delay"), **each).merge(
            dataset(-0.1, ["growth"], **each, variation=list(VARIATIONS))
        )
    if isinstance(job, Edge):
        return dataset(2e-3, UNITS, seed=list(job.seeds))
    if isinstance(job, Sparing):
        used, held = ("base", [0.1, 0.2, 0.3, 0.4]), ("axis", [0.5, 1.5, 2.5])
        return xr.Dataset({"used": used, "held": held, "position": 1e-3})
    if isinstance(job, OnPaper):
        return xr.Dataset({"position": 1e-4, "late attitude": 2e-5})
    return xr.Dataset({"flies": 0.5, "lost": 1.0})


def test_all_is_in_the_report(tmp_path, capsys):
    found = {job.name: invented(job) for job in jobs(3)}
    name = Rung(law="mean axes", imperfection="payload").name
    found[name] = xr.Dataset({"flies": np.nan, "lost": 123.0})
    found["base lost"]["position"][4] = np.nan
    found["case1-draws"]["late position"][1] = 1e-3
    found["case2-draws"]["position"][2] = np.nan
    edge = "edge: arms are heavier than believed by 5%"
    found[edge]["position"][3] = np.nan
    text = write(found, jobs(3), tmp_path).read_text(encoding="utf-8")
    assert heads(text) == heads(TEXTS[DOCS / "flight/README.md"])
    assert "lost at 120" in text
    assert "| base 2 dead at 30 s | lost |" in text
    assert "| coast | −0.10 |" in text
    assert "| mean axes, consistent plant | 1.00×10⁻⁴ m | 2.00×10⁻⁵ rad |" in text
    assert "3 of 3 in Case 1, 2 of 3 in Case 2" in text
    assert "| late position (norm) [mm] | 0.00100 | 1.00 | 0.07 | 1 |" in text
    assert "| position (norm) [mm] | 0.00100 | 0.00100 | 3 | 0 | 0.00100 | 0.00100 | 3 | 1 |" in text
    assert "| arms are heavier than believed by 5% | 3 of 4 | 2.00 |" in text
    assert "| case 1, sparing | 100 | 200 | 300 | 400 | 1000 | 0.500 | 1.50 | 2.50 | 1.00 |" in text
    assert "| base 4 | 0." in text  # along body z: not in time
    assert (tmp_path / "draws.png").stat().st_size > 1000
    evidence = json.loads((tmp_path / "evidence.json").read_text(encoding="utf-8"))
    assert evidence["numbers"]["case 1: late position, greatest"]["value"] == pytest.approx(1.0, rel=1e-9)
    assert main(["--check", "--output", str(tmp_path)]) == 0
    assert main(["--check", "--output", str(tmp_path / "none")]) == 2
    assert "cannot read the evidence" in capsys.readouterr().err


@pytest.mark.usefixtures("plant")
def test_a_batch_is_flown_kept_and_used_again(tmp_path):
    batch = Draws(case=1, first=100, count=2, duration=0.2)
    first = perform(batch, tmp_path)
    with xr.open_dataset(first.file) as data:
        assert np.isfinite([data[name].values for name in UNITS]).all()
        assert data["mass"][0] != data["mass"][1]
        assert 0.0 < data["position"].max() < 1e-3
    assert not first.reused
    assert perform(batch, tmp_path).reused

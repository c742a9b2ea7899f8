"""The report has the results of the campaigns, and its evidence the fingerprints of the diagrams."""

import json
import re

import numpy as np
import pytest
import xarray as xr
from documents import DOCS, TEXTS, heads
from flight.campaigns import all_campaigns
from flight.failures import FAILURE_METRICS
from flight.limits import IMPERFECTIONS, LAWS
from flight.margins import VARIATIONS
from flight.metrics import METRICS
from flight.report import write


def dataset(value, names, **coords):
    """Return columns of one value along the coordinates."""
    shape = [len(each) for each in coords.values()]
    return xr.Dataset(
        {name: (list(coords), np.full(shape, value)) for name in names}, coords
    )


def invented(campaign):
    """Return results of a campaign."""
    runs = {"sample": list(campaign.labels)}
    if campaign.section == "Failures":
        return dataset(0.0, FAILURE_METRICS, **runs)
    if campaign.section == "Propellant and wheel management":
        names = re.findall("position|propellant.*|final.*", "\n".join(METRICS))
        return dataset(1e-3, names, **runs)
    if campaign.section == "Exact loops":
        names = "position", "late position", "late attitude", "grasp 4"
        return dataset(1e-4, (*names, "late vibration of grasp 4"), **runs)
    value = 1e-6 if campaign.section == "Monte Carlo samples" else 2e-3
    return dataset(value, METRICS, **runs).assign(status="complete")


def test_all_results_are_in_the_report(tmp_path):
    campaigns = all_campaigns(3)
    found = {one.name: invented(one) for one in campaigns}
    found["base fails"]["position"][4] = np.nan
    found["case 1"]["late position"][1] = 1e-3
    found["case 2"]["position"][2] = np.nan
    found["arms 5% heavier than nominal"]["position"][3] = np.nan
    bounds = {(name, law): (0.5, 1.0) for name in IMPERFECTIONS for law in LAWS}
    bounds["payload", "mean axes"] = np.nan, 123.0
    each = {"seed": [-1, 100, 101], "instant": ["at rest", "coast"]}
    margins = dataset(0.3, ("disk", "delay"), **each)
    margins = margins.merge(
        dataset(-0.1, ["growth"], **each, variation=list(VARIATIONS))
    )
    text = write(
        campaigns, found, bounds, margins, tmp_path, {"case 1": [1.0]}
    ).read_text(encoding="utf-8")
    assert heads(text) == heads(TEXTS[DOCS / "flight/README.md"])
    assert "| fails at 120 |" in text
    assert "| base 2 fails at 30 s | 0 | not a number |" in text
    assert "| coast | −0.10 |" in text
    assert "| mean axes, consistent plant | 0.100 |" in text
    assert "3 of 3 in Case 1, 2 of 3 in Case 2" in text
    assert "| late position (norm) [mm] | 0.00100 | 1.00 | 0.07 | 1 |" in text
    assert (
        "| position (norm) [mm] | 0.00100 | 0.00100 | 3 | 0 | 0.00100 | 0.00100 | 3 | 1 |"
        in text
    )
    assert "| arms 5% heavier than nominal | 3 of 4 | 2.00 |" in text
    assert (
        "| case 1, with management | 1.00 | 1.00 | 1.00 | 1.00 | 1.00 | 1.00 | 0.00100 |"
        in text
    )
    assert "| base 4 | 0." in text  # along body z: not in time
    assert (tmp_path / "samples.png").stat().st_size > 1000
    evidence = json.loads((tmp_path / "evidence.json").read_text(encoding="utf-8"))
    assert evidence["fingerprints"] == {"case 1": [1.0]}
    numbers = evidence["numbers"]
    assert numbers["case 1: late position, greatest"]["value"] == pytest.approx(
        1.0, rel=1e-9
    )

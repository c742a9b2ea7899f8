"""The report has the results of the campaigns, and its evidence the fingerprints of the diagrams."""

import json
import re

import numpy as np
import pytest
import xarray as xr
from documents import DOCS, TEXTS, heads
from flight.campaigns import all_campaigns
from flight.limits import IMPERFECTIONS, LAWS
from flight.margins import VARIATIONS
from flight.metrics import METRICS
from flight.report import write
from flight.worst_case import BIASES, Proof, truss_of


def dataset(value, names, **coords):
    """Return columns of one value along the coordinates."""
    shape = [len(each) for each in coords.values()]
    return xr.Dataset(
        {name: (list(coords), np.full(shape, value)) for name in names}, coords
    )


def invented(campaign):
    """Return results of a campaign."""
    runs = {"sample": list(campaign.labels)}
    if campaign.section == "Propellant and wheel management":
        names = re.findall("^position|propellant.*|final m.*", "\n".join(METRICS))
        return dataset(1e-3, names, **runs)
    names = "position", "late position", "late attitude", "grasp 4"
    exact = dataset(1e-4, (*names, "late vibration of grasp 4"), **runs)
    if campaign.section == "Exact loops":
        return exact
    if campaign.section == "Damping by thrusters or arms":
        exact["propellant"] = 1e-3 * exact["position"]
        return exact.assign_coords(kind=("sample", list(campaign.kinds)))
    found = dataset(1e-6, [*METRICS][: [*METRICS].index("grasp 4")], **runs)
    found["false alarms"][:] = 0.0
    return found.assign_coords(kind=("sample", list(campaign.kinds))).assign(
        status=("sample", ["complete"] * len(campaign.labels))
    )


def test_all_results_are_in_the_report(tmp_path):
    campaigns = all_campaigns(3)
    found = {one.name: invented(one) for one in campaigns}
    faults = found["Literal arm, Case 1, faults"]
    faults["position"][4] = np.nan
    faults["status"][4] = "diverged"
    faults["isolated after"][:3] = [0.25, 0.5, np.inf]
    samples = found["Literal arm, Case 1, seeds 8000 to 8002"]
    samples["late position"][1] = 1e-3
    samples["false alarms"][2] = 2.0
    bounds = {(name, law): (0.5, 1.0) for name in IMPERFECTIONS for law in LAWS}
    bounds["payload", "mean axes"] = np.nan, 123.0
    each = {"seed": [-1, 100, 101], "instant": ["at rest", "coast"]}
    margins = dataset(0.3, ("disk", "delay"), **each)
    margins = margins.merge(
        dataset(-0.1, ["growth"], **each, variation=list(VARIATIONS))
    )
    samples["attitude"][2] = 2e-3
    search = {**truss_of(-np.ones(BIASES), 38), "biases": np.full(4, 5e-4)}
    worst = {
        name: {"position": 3e-3, "attitude": 4e-3, **search}
        for name in ("position", "attitude")
    }
    recorded = {"case 1": [1.0]}
    proof = Proof(-0.04, -0.02, -0.1, -0.11)
    text = write(
        campaigns, found, bounds, margins, worst, proof, tmp_path, recorded
    ).read_text(encoding="utf-8")
    assert heads(text) == heads(TEXTS[DOCS / "flight/README.md"])
    assert "| fails at 120 |" in text
    assert "| coast, nominal truss | −0.10 |" in text
    assert "| mean axes, consistent plant | 0.100 |" in text
    assert (
        "| healthy samples | 3 | 0 | 0.00100 | 2.00 | 0.00100 | 1.00 | 1.00×10⁻⁶ | 2 |"
        in text
    )
    assert (
        "| base fails | 9 | 1 | ∞ | 0.00100 | 0.00100 | 0.00100 | 1.00×10⁻⁶ | 0 | 8 | 0.50"
        in text
    )
    assert (
        "| case 1, with management | 1.00 | 1.00 | 1.00 | 1.00 | 1.00 | 1.00 | 0.00100 |"
        in text
    )
    assert "| thrusters damp | 0.100 | 0.100 | 0.100 | 1.00×10⁻⁴ |" in text
    assert "| Literal arm, Case 1, base 4 | 0." in text  # along body z: not in time
    assert "| attitude [mrad] | 4.00 | 4.00 |" in text
    assert "| payload [kg] | 0 | 0 |" in text
    assert "are 0.00100 mm and 2.00 mrad" in text
    assert "No growth rate within them exceeds −0.0200 1/s" in text
    page = (tmp_path / "details.md").read_text(encoding="utf-8")
    assert heads(page) == heads(TEXTS[DOCS / "flight/details.md"])
    assert "| base fails (2, 30 s), seed 8001 | yes |  |" in page
    evidence = json.loads((tmp_path / "evidence.json").read_text(encoding="utf-8"))
    assert evidence["fingerprints"] == {"case 1": [1.0]}
    number = evidence["numbers"]["Literal arm, Case 1, healthy samples: late position"]
    assert number["value"] == pytest.approx(1.0, rel=1e-9)

"""The report has the results of the campaigns, and its evidence the fingerprints of the diagrams."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from documents import DOCS, TEXTS, heads
from flight.__main__ import main
from flight.campaigns import all_campaigns
from flight.failures import FAILURE_METRICS
from flight.limits import IMPERFECTIONS, LAWS
from flight.margins import VARIATIONS
from flight.metrics import METRICS
from flight.report import write
from study_tools.fingerprints import fingerprint, outdated, read_evidence

from trussflow.blocks import Constant, Diagram, Integrator, Simulator
from trussflow.models import ModelError


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
        return dataset(0.0, (*FAILURE_METRICS, "found_after", "false_alarms"), **runs)
    if campaign.section == "Propellant and wheel management":
        used, momentum = [[0.1, 0.2, 0.3, 0.4]], [[0.5, 1.5, 2.5]]
        columns = {
            "used": (("sample", "base"), used),
            "momentum": (("sample", "axis"), momentum),
        }
        return xr.Dataset(columns | {"position": ("sample", [1e-3])}, runs)
    if campaign.section == "Exact loops":
        return dataset(
            1e-4,
            ("position", "late position", "late attitude", "grasp 4", "late grasp 4"),
            **runs,
        )
    return dataset(
        1e-6 if campaign.section == "Monte Carlo samples" else 2e-3, METRICS, **runs
    )


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
    assert "| base 2 fails at 30 s | diverged |" in text
    assert "| coast | −0.10 |" in text
    assert "| mean axes, consistent plant | 1.00×10⁻⁴ m |" in text
    assert "3 of 3 in Case 1, 2 of 3 in Case 2" in text
    assert "| late position (norm) [mm] | 0.00100 | 1.00 | 0.07 | 1 |" in text
    assert (
        "| position (norm) [mm] | 0.00100 | 0.00100 | 3 | 0 | 0.00100 | 0.00100 | 3 | 1 |"
        in text
    )
    assert "| arms 5% heavier than nominal | 3 of 4 | 2.00 |" in text
    assert (
        "| case 1, with management | 100 | 200 | 300 | 400 | 1000 | 0.500 | 1.50 | 2.50 | 1.00 |"
        in text
    )
    assert "| base 4 | 0." in text  # along body z: not in time
    assert (tmp_path / "samples.png").stat().st_size > 1000
    numbers = json.loads((tmp_path / "evidence.json").read_text(encoding="utf-8"))[
        "numbers"
    ]
    assert numbers["case 1: late position, greatest"]["value"] == pytest.approx(
        1.0, rel=1e-9
    )


@pytest.mark.campaign
@pytest.mark.usefixtures("plant")
def test_a_campaign_resumes(tmp_path):
    """A second call reads the finished runs; a run equals that of its parameters alone."""
    campaign = replace(all_campaigns(2)[0], duration=0.1)
    first = campaign.run(tmp_path, executor="serial")
    assert np.isfinite([first[name].values for name in METRICS]).all()
    assert 0.0 < first["position"].values.max() < 1e-3
    xr.testing.assert_equal(campaign.run(tmp_path, executor="serial"), first)
    alone = replace(campaign, rows=campaign.rows[1:], labels=[101]).run(
        executor="serial"
    )
    assert alone["position"].values[0] == first["position"].values[1]


def ramp(slope=1.0, gain=None, step=0.1):
    """Return a simulator of an integrated constant, with a gain between the blocks if there is one."""
    diagram = Diagram("ramp")
    source, position = diagram.add(
        slope=Constant([slope]), position=Integrator(shape=1)
    )
    (source if gain is None else source * gain) >> position.u
    return Simulator(diagram, step=step)


def test_a_fingerprint_changes_with_parameters_equations_and_step():
    numbers = fingerprint(ramp())
    assert fingerprint(ramp()) == numbers
    for other in (ramp(slope=1.0001), ramp(step=0.2), ramp(gain=1.0001)):
        found = fingerprint(other)
        assert len(found) != len(numbers) or not np.allclose(
            found, numbers, rtol=1e-7, atol=0.0
        )


def test_the_shipped_report_has_the_present_fingerprints():
    """The sampled equations of the mean-axes loop depend on the signs of modes, so on the processor."""
    exact, stored = all_campaigns(1)[-1], read_evidence(DOCS / "flight")["fingerprints"]
    paper = replace(exact, rows=exact.rows[:2]).fingerprint({})[:-1]
    assert np.allclose(paper, stored[exact.name][: len(paper)], rtol=1e-7, atol=0.0)
    assert outdated(DOCS / "flight", {exact.name: [0.0], "new": [1.0]}) == [
        exact.name,
        "new",
    ]


def test_the_command_names_the_outdated_campaigns(monkeypatch, capsys):
    stored = read_evidence(DOCS / "flight")["fingerprints"]
    words = ["--check", "--draws", "1", "--output", str(DOCS / "flight")]
    for changes, code, message in (
        ({}, 0, "has the equations and parameters of the present code"),
        ({"case 3": [1.0]}, 1, "is outdated: changed are case 3"),
    ):
        present = stored | changes
        monkeypatch.setattr(
            "flight.report.fingerprints", lambda _, present=present: present
        )
        assert main(words) == code
        assert message in capsys.readouterr().out


def test_a_missing_report_has_no_evidence(tmp_path):
    with pytest.raises(ModelError, match="cannot read the evidence of a report"):
        outdated(tmp_path, {})

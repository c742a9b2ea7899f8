"""Report from invented numbers, short runs, and the shipped report."""

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest
from reproduction import report
from reproduction.claims import VERDICTS
from reproduction.figures import draw_paper_figures
from reproduction.instability import DAMPINGS, MODES, stability_measures
from reproduction.runs import RUNS, measure_all, mission, simulator

from trussflow.models import ModelError
from trussflow.models.transport.results import check_run

SHIPPED = Path(__file__).parents[3] / "docs" / "reproduction"
NUMBER = re.compile(r"(?<![\w./×^-])\d+\.\d+(?:×10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?")


def evidence(folder):
    return json.loads((folder / "evidence.json").read_text(encoding="utf-8"))


def uncited(folder):
    """Return decimal numbers of a report that are neither evidence, nor quoted, nor sections."""
    found = evidence(folder)
    text = (folder / "README.md").read_text(encoding="utf-8")
    text = re.sub(r"“[^”]*”|`[^`]*`|Section \d\.\d", "", text)
    known = {n["text"].lstrip("−") for n in found["numbers"].values()}
    known |= {claim["section"] for claim in found["claims"]}
    return set(NUMBER.findall(text)) - known


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Return the measures of two short runs, and the folder of their results."""
    folder = tmp_path_factory.mktemp("runs")
    return measure_all(["case1", "case1-pushed"], 2.0, folder, workers=1), folder


def test_a_repeated_sweep_reuses_its_runs(short, monkeypatch):
    found, folder = short
    assert found["case1-pushed"]["largest V"] > found["case1"]["largest V"]
    monkeypatch.setattr("trussflow.blocks.simulation.simulator.Simulator.run", None)
    again = measure_all(["case1", "case1-pushed"], 2.0, folder, workers=1)
    assert again["case1"]["force ripple"] == found["case1"]["force ripple"]


def test_failed_runs_are_named(tmp_path):
    with pytest.raises(ModelError, match=r"1 of 1 runs failed:\n  case1: .*duration"):
        measure_all(["case1"], 0.0005, tmp_path, workers=1)


def test_a_report_of_invented_numbers_cites_all_of_them(short, tmp_path):
    values = itertools.count(1.0)
    names = short[0]["case1"]
    invented = {run: {name: next(values) / 7 for name in names} for run in RUNS}
    poles = {run: -np.linspace(-1.0, 1.0, 6) + 2j for run in report.OBSERVER_RUNS}
    shape = (len(MODES), 2, 2, len(DAMPINGS))
    maps = {
        observer: np.linspace(1.0, -1.0, np.prod(shape)).reshape(shape)
        for observer in (False, True)
    }
    numbers = (
        report.complete(invented, poles)
        | stability_measures(maps)
        | report.shipped_data(short[1])
    )
    file = report.write(numbers, "", {"case1": [0.5]}, tmp_path)
    text = file.read_text(encoding="utf-8")
    assert uncited(tmp_path) == set()
    assert not re.search(r"\{(table|figures|verdict|[^}]*: )", text)
    found = evidence(tmp_path)
    for name, number in found["numbers"].items():
        assert number["text"] in text, name
        assert set(number["runs"]) <= set(RUNS)
    assert len(found["claims"]) == 33
    for claim in found["claims"]:
        assert set(re.findall(r"`([^`]*)`", claim["runs"])) <= set(RUNS)


def test_paper_figures_of_short_runs(short, tmp_path):
    folder = short[1]
    result = check_run(
        simulator(folder, "case1").run(0.1), mission("case1", folder).truss
    )
    text = draw_paper_figures(lambda _: result, tmp_path)
    assert [int(n) for n in re.findall(r"!\[Figure (\d+)\]", text)] == list(
        range(3, 20)
    )
    assert len(list(tmp_path.glob("figure-*.png"))) == 17


def test_the_shipped_report_is_complete():
    assert uncited(SHIPPED) == set()
    text, found = (SHIPPED / "README.md").read_text(encoding="utf-8"), evidence(SHIPPED)
    for image in re.findall(r"\]\(([^)]+\.png)\)", text):
        assert (SHIPPED / image).exists(), image
    assert {claim["verdict"].strip("*") for claim in found["claims"]} <= set(VERDICTS)
    assert sum(file.stat().st_size for file in SHIPPED.iterdir()) < 3e6

"""The report against the results it cites, on a shortened run; and the one that is kept."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from documents import heads
from reproduction import late_error, sensitivity
from reproduction.__main__ import main
from reproduction.claims import COARSE, DIFFERS, OPEN, REPRODUCED
from study_tools.ledger import pretty

from trussflow.models.reporting.tables import markdown_table

KEPT = Path(__file__).parents[3] / "docs" / "reproduction"
DURATION = 4.0  # s

SINGLE_PRECISION = 1e-5
"""Results are kept in four-byte numbers; what is computed from differences of them loses digits."""

NUMBER = re.compile(r"(?<![\w./×^-])\d+\.\d+(?:×10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return where a shortened report and its runs are."""
    found = tmp_path_factory.mktemp("reproduction")
    assert main(words(found)) == 0
    return found


def words(folder):
    places = ["--output", str(folder / "report"), "--runs", str(folder / "runs")]
    return ["--duration", str(DURATION), "--sections", "theorems", "physics", "--workers", "1", *places]


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


@pytest.mark.parametrize(("run", "bandwidth"), [("case1", 4.0), ("case2", 2.0)])
def test_theorem_numbers_are_those_of_the_cited_runs(folder, run, bandwidth):
    """Recomputed from the run's file, which the evidence names, without the report's code."""
    found = evidence(folder / "report")
    numbers = found["numbers"]
    with xr.open_dataset(folder / "runs" / found["runs"][run]["file"], decode_cf=False) as data:
        time = data["time"].values
        names = ("disturbance", "disturbance_estimate", "sliding_variable")
        d, estimate, s = (data[name].values.astype(float) for name in names)
        assert data.attrs["duration"] == DURATION
    xi = max(np.linalg.norm(np.diff(d, axis=0), axis=1) / np.diff(time))
    error = np.linalg.norm(estimate - d, axis=1)
    expected = {
        "L": bandwidth,
        "xi": xi,
        "xi/L": xi / bandwidth,
        "settled estimation error": error[time > 5 / bandwidth].max(),
        "largest V": ((s**2).sum(axis=1) + error**2).max() / 2,
    }
    for name, value in expected.items():
        number = numbers[f"{run}: {name}"]
        assert number["value"] == pytest.approx(value, rel=SINGLE_PRECISION), name
        assert number["runs"] == [run]
        assert number["text"] == pretty(number["value"])


def test_every_number_of_the_text_is_in_the_evidence(folder):
    assert uncited(folder / "report") == set()
    shipped = heads((KEPT / "README.md").read_text(encoding="utf-8"))
    columns = tuple(heading for heading, *_ in sensitivity.COLUMNS)
    assert heads(markdown_table(("Case 1", *columns, "changed verdicts"), [])) < shipped
    assert heads(markdown_table(late_error.HEADER, [])) < shipped
    text = (folder / "report" / "README.md").read_text(encoding="utf-8")
    found = evidence(folder / "report")
    assert set(found["runs"]) == {"case1", "case2", "case1-pushed", "case2-pushed"}
    for run in found["runs"].values():
        assert f"`{Path(run['file']).stem}`" in text
        assert (folder / "runs" / run["file"]).exists()
    for name, number in found["numbers"].items():
        assert number["text"] in text, name
    images = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)
    assert images == ["theorems.png"]
    assert (folder / "report" / images[0]).stat().st_size > 1000


def test_a_repeated_report_reuses_its_runs(folder, capsys):
    before = (folder / "report" / "README.md").read_bytes()
    assert main(words(folder)) == 0
    assert "4 runs, 4 of them from before" in capsys.readouterr().out
    assert (folder / "report" / "README.md").read_bytes() == before


def test_the_report_knows_the_code_that_made_it(folder, monkeypatch, capsys):
    code = evidence(folder / "report")["code"]
    assert f"digest `{code['digest']}`" in (folder / "report" / "README.md").read_text(encoding="utf-8")
    assert {"casadi", "numpy"} <= set(code["libraries"])
    check = ["--check", "--output", str(folder / "report")]
    assert main(check) == 0
    assert f"was made by this code, digest {code['digest']}" in capsys.readouterr().out
    monkeypatch.setattr("study_tools.evidence.code_digest", lambda: "0123")
    assert main(check) == 1
    assert f"is old: it was made by other code (digest {code['digest']}; of" in capsys.readouterr().out


def test_a_report_that_states_no_code_is_old_and_none_cannot_be_checked(tmp_path, capsys):
    assert main(["--check", "--output", str(tmp_path)]) == 2
    assert "cannot read the evidence of a report in" in capsys.readouterr().err
    (tmp_path / "evidence.json").write_text('{"runs": {}}')
    assert main(["--check", "--output", str(tmp_path)]) == 1
    assert "made by other code (digest not stated;" in capsys.readouterr().out


def test_unknown_section(tmp_path, capsys):
    assert main(["--sections", "poetry", "--output", str(tmp_path)]) == 2
    assert "no section of the report 'poetry'; choose from: claims, figures," in capsys.readouterr().err


def test_a_failed_run_is_named_and_no_report_written(tmp_path, capsys):
    assert main([*words(tmp_path), "--duration", "0.0005"]) == 2
    error = capsys.readouterr().err
    assert "4 of 4 runs failed" in error
    assert "case2-pushed: the duration of" in error
    assert not (tmp_path / "report").exists()


def test_the_kept_report_is_whole_and_every_number_in_it_is_in_its_evidence():
    """Guards against numbers typed by hand; that they are right is tested above."""
    assert uncited(KEPT) == set()
    text, found = (KEPT / "README.md").read_text(encoding="utf-8"), evidence(KEPT)
    for number in range(3, 20):
        assert f"![Figure {number}](figure-{number:02d}.png)" in text
    for image in re.findall(r"\]\(([^)]+\.png)\)", text):
        assert (KEPT / image).exists(), image
    assert {claim["verdict"] for claim in found["claims"]} <= {REPRODUCED, COARSE, DIFFERS, OPEN}
    for claim in found["claims"]:
        assert claim["quote"] in text
    assert sum(file.stat().st_size for file in KEPT.iterdir()) < 3e6

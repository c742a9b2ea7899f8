"""``python -m trussflow.models.modal_analysis``."""

import csv
import json

import pytest
import xarray as xr

from trussflow.models.modal_analysis.__main__ import main

FIGURES = [
    "bode_plant",
    "bode_demand_loops",
    "bode_modal_loops",
    "singular_values",
    "poles",
    "spillover",
    "reduction",
]


@pytest.mark.campaign
def test_quick_command_end_to_end(tmp_path, capsys):
    assert main(["--quick", "--json", "--output", str(tmp_path)]) == 0
    said = capsys.readouterr()
    shown, facts = said.err, json.loads(said.out)
    assert {p.name for p in tmp_path.iterdir()} == {
        *(f"{name}.png" for name in FIGURES),
        "tables.txt",
        "margins.csv",
        "spillover.nc",
    }
    for title in (
        "Natural frequencies",
        "Actuators to modal coordinates",
        "Margins at the demand",
        "Loops at the modal forces",
        "Rightmost oscillating poles",
        "Spillover",
        "Reduced models",
        "Delay and control period",
    ):
        assert title in shown
        assert title in (tmp_path / "tables.txt").read_text(encoding="utf-8")
    with (tmp_path / "margins.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 * 34
    assert [float(row["disk"]) for row in rows] == [row["disk"] for row in facts["margins"]]
    assert all(float(row["disk"]) > 0 for row in rows)
    with xr.open_dataset(tmp_path / "spillover.nc") as grid:
        assert grid["growth_rate"].notnull().all()


def test_nonsense_is_one_clear_line(tmp_path, capsys):
    assert main(["--amplitude", "0", "--output", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "error = 0.0 must be a positive and finite number" in error
    assert "Traceback" not in error
    (tmp_path / "file").write_text("in the way")
    assert main(["--output", str(tmp_path / "file" / "results")]) == 2
    assert "cannot write to the output folder" in capsys.readouterr().err

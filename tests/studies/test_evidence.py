"""Fingerprints of loops, and the command that compares them with those of a report."""

import json
from importlib import import_module

import numpy as np
import pytest
import scipy.linalg
from flight.loops import flight_simulator
from study_tools.evidence import FINGERPRINT_TOLERANCE, fingerprint, outdated

from trussflow.blocks import Constant, Diagram, Integrator, Simulator
from trussflow.models.plant.tunable_truss import TunableTruss


def ramp(slope=1.0, gain=None, step=0.1, start=0.0, name="slope"):
    """Return the fingerprint of an integrated constant, with a gain between the blocks if there is one."""
    diagram = Diagram("ramp")
    source = diagram.add(**{name: Constant([slope])})
    position = diagram.add(position=Integrator([start]))
    (source if gain is None else source * gain) >> position.u
    return fingerprint(Simulator(diagram, step=step, backend="numpy"))


def equal(found, numbers):
    return len(found) == len(numbers) and np.allclose(
        found, numbers, rtol=FINGERPRINT_TOLERANCE, atol=0.0
    )


@pytest.mark.parametrize(
    "change",
    [{"slope": 1.0001}, {"step": 0.2}, {"gain": 1.0001}, {"start": 1e-3}],
    ids=str,
)
def test_a_fingerprint_changes_with_parameters_equations_step_and_start(change):
    assert ramp() == ramp(name="renamed")
    assert not equal(ramp(**change), ramp())


def test_a_fingerprint_does_not_depend_on_the_signs_of_modes(monkeypatch):
    """The eigensolver of another processor may return the opposite eigenvectors."""
    monkeypatch.setattr(TunableTruss, "accurate", TunableTruss.consistent)
    numbers, solve = fingerprint(flight_simulator(backend="numpy")), scipy.linalg.eigh

    def opposite(*matrices):
        squares, shapes = solve(*matrices)
        return squares, -shapes

    monkeypatch.setattr(scipy.linalg, "eigh", opposite)
    assert equal(fingerprint(flight_simulator(backend="numpy")), numbers)


@pytest.mark.parametrize(
    "study, words, computed, target",
    [
        ("reproduction", [], "reproduction.__main__.fingerprints", "reproduce"),
        ("flight", [], "flight.report.fingerprints", "flight"),
        ("flight", ["--samples", "9"], "flight.comparison.fingerprints", "sweep"),
    ],
)
def test_check_names_what_changed(
    study, words, computed, target, tmp_path, monkeypatch, capsys
):
    main = import_module(f"{study}.__main__").main
    words = ["--check", "--output", str(tmp_path), *words]
    monkeypatch.setattr(computed, lambda *_: {"case 1": [1.0], "case 2": [2.0, 3.0]})
    assert main(words) == 2
    assert "cannot read the evidence of a report in" in capsys.readouterr().err
    for recorded, code, message in (
        (
            {"case 1": [1.0 + 1e-9], "case 2": [2.0, 3.0]},
            0,
            "has the equations and parameters of the present code",
        ),
        (
            {"case 1": [1.0], "case 2": [2.0, 3.1], "case 3": [4.0]},
            1,
            f"is old: changed are case 2, case 3; run 'make {target}'",
        ),
    ):
        (tmp_path / "evidence.json").write_text(json.dumps({"fingerprints": recorded}))
        assert main(words) == code
        assert message in capsys.readouterr().out


def test_fingerprints_of_any_kind_of_processor_count(tmp_path):
    kinds = {"fingerprints": {"a": [1.0]}, "fingerprints with AVX2": {"a": [2.0]}}
    (tmp_path / "evidence.json").write_text(json.dumps(kinds))
    assert outdated(tmp_path, {"a": [2.0]}) == []
    assert outdated(tmp_path, {"a": [3.0]}) == ["a"]

"""Evidence of a report: its numbers, and fingerprints of the simulated diagrams."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from study_tools.ledger import Ledger
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.support.files import reading, replaced
from trussflow.models.errors import ModelError

EVIDENCE = "evidence.json"

FINGERPRINT_TOLERANCE = 1e-7
"""Relative tolerance of fingerprints: rounding on another processor changes at most 1e-8 [-].

States in modal coordinates are an exception: the signs of modes may differ on another processor.
"""

MAGNITUDE_SCALE = 1e-6
"""Values above count by their logarithm, so that each contributes to a projection [-]."""


def write_evidence(
    folder: Path,
    ledger: Ledger,
    fingerprints: Mapping[str, Sequence[float]],
    **facts: Any,
) -> None:
    """Write the evidence of a report.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the report.
    ledger : Ledger
        Numbers of the report.
    fingerprints : mapping
        Numbers by `fingerprint` for each group of runs.
    **facts
        Further facts, such as the number of samples.
    """
    evidence = {
        "libraries": {name: version(name) for name in ("casadi", "numpy", "scipy")},
        **facts,
        "fingerprints": fingerprints,
        "numbers": {name: asdict(number) for name, number in ledger.numbers.items()},
    }
    with replaced(folder / EVIDENCE) as partial:
        partial.write_text(json.dumps(evidence, indent=1) + "\n", encoding="utf-8")


def read_evidence(folder: Path) -> dict[str, Any]:
    """Return the evidence of the report in a folder.

    Raises
    ------
    ModelError
        If there is no report.
    """
    with reading(
        folder / EVIDENCE, ModelError, "cannot read the evidence of a report in"
    ) as file:
        return dict(json.loads(file.read_text(encoding="utf-8")))


def outdated(folder: Path, fingerprints: Mapping[str, Sequence[float]]) -> list[str]:
    """Return the groups of runs in the report in `folder` that have other `fingerprints` now.

    Raises
    ------
    ModelError
        If there is no report.
    """
    stored = read_evidence(folder).get("fingerprints", {})
    return [
        name
        for name, numbers in fingerprints.items()
        if len(numbers) != len(stored.get(name, ()))
        or not np.allclose(numbers, stored[name], rtol=FINGERPRINT_TOLERANCE, atol=0.0)
    ]


def fingerprint(simulator: Simulator | Session) -> list[float]:
    """Return numbers that change if the equations, parameters or step of a simulator change.

    They are the projections of all equations at a state near the initial one, of the parameters, and of the
    step. Hashes of the code would differ between processors, whose linear algebra rounds differently.
    """
    prepared = simulator.prepared
    p = prepared.plan.parameters({})
    x, d = (
        state + _pattern(state.size) / 1024.0
        for state in prepared.plan.initial(p, None)
    )
    with contextlib.closing(prepared.open(p)) as executor:
        values = [
            executor.call(program.name, 0.0, x, d, p).copy()
            for program in prepared.programs
        ]
    return [
        projection([value])
        for value in (*values, p, np.array(float(prepared.step or 0.0)))
    ]


def projection(values: Iterable[npt.ArrayLike]) -> float:
    """Return one number that changes with each element of the values [any], by its relative change."""
    flat = np.concatenate(
        [np.ravel(np.asarray(value, dtype=float)) for value in values]
    )
    magnitudes = np.arcsinh(np.nan_to_num(flat) / MAGNITUDE_SCALE)
    return float(magnitudes @ (1.0 + _pattern(flat.size) / 16.0))


def _pattern(size: int) -> npt.NDArray[np.float64]:
    """Return small integers without symmetry, exact in floating point."""
    return np.asarray(np.arange(size) * 7 % 11 - 5, dtype=float)

"""Files of a report: its text, the evidence of its numbers, and fingerprints of the simulated loops."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Mapping, Sequence
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
"""Relative tolerance of fingerprints: rounding changes at most 5e-8 [-]."""

MAGNITUDE_SCALE = 1e-6
"""Values above count by their logarithm, so that each contributes to a projection [-]."""


def write_report(
    folder: Path,
    text: str,
    ledger: Ledger,
    fingerprints: Mapping[str, Sequence[float]],
    **facts: Any,
) -> Path:
    """Write the text and the evidence of a report, and return the file of the text.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the report.
    text : str
        Text in Markdown.
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
        "numbers": ledger.numbers,
    }
    report = folder / "README.md"
    for file, content in (
        (report, text),
        (folder / EVIDENCE, json.dumps(evidence, indent=1) + "\n"),
    ):
        with replaced(file) as partial:
            partial.write_text(content, encoding="utf-8")
    return report


def outdated(folder: Path, fingerprints: Mapping[str, Sequence[float]]) -> list[str]:
    """Return the groups of runs whose fingerprints differ from those in the report in `folder`.

    A report may have fingerprints of several kinds of processors, ``fingerprints`` and ``fingerprints ...``:
    the signs of modes, and so the equations of the accurate truss, depend on the vector instructions.

    Raises
    ------
    ModelError
        If there is no report.
    """
    with reading(
        folder / EVIDENCE, ModelError, "cannot read the evidence of a report in"
    ) as file:
        evidence = json.loads(file.read_text(encoding="utf-8"))
    changed = [
        _changed(stored, fingerprints)
        for key, stored in evidence.items()
        if key.startswith("fingerprints")
    ]
    return min(changed, key=len)


def _changed(
    stored: Mapping[str, Sequence[float]], present: Mapping[str, Sequence[float]]
) -> list[str]:
    """Return the groups of runs whose `stored` and `present` fingerprints differ."""
    return sorted(
        name
        for name in {*stored, *present}
        if len(stored.get(name, ())) != len(present.get(name, ()))
        or not np.allclose(
            present[name], stored[name], rtol=FINGERPRINT_TOLERANCE, atol=0.0
        )
    )


def fingerprint(simulator: Simulator | Session) -> list[float]:
    """Return numbers that change if the equations, parameters, initial states or step of a loop change.

    They are the projections of all equations near the initial state, after two samples of the controller, of
    the parameters, of the initial state, and of the step. Names do not count. Hashes of the code would
    differ between processors, whose linear algebra rounds differently.
    """
    prepared = simulator.prepared
    p = prepared.plan.parameters({})
    start, d = prepared.plan.initial(p, None)
    x = start + _pattern(start.size) / 1024.0
    values = [np.concatenate([start, d]), p, np.array(float(prepared.step or 0.0))]
    with contextlib.closing(prepared.open(p)) as executor:
        # The second sample shows the equations of states that are zero before the first.
        for _ in range(2):
            for number, clocks in enumerate(prepared.schedule.sets):
                d = executor.instant(number, 0.0, x, d, p).copy() if clocks else d
        values += [
            executor.call(quantity.name, 0.0, x, d, p).copy()
            for quantity in prepared.quantities
        ]
    return [projection([value]) for value in values]


def projection(values: Iterable[npt.ArrayLike]) -> float:
    """Return one number that changes with the magnitude of each value [any], by its relative change.

    Signs do not count: those of modes are arbitrary, and may differ on another processor.
    """
    flat = np.concatenate(
        [np.ravel(np.asarray(value, dtype=float)) for value in values]
    )
    magnitudes = np.arcsinh(np.abs(np.nan_to_num(flat)) / MAGNITUDE_SCALE)
    return float(magnitudes @ (1.0 + _pattern(flat.size) / 16.0))


def _pattern(size: int) -> npt.NDArray[np.float64]:
    """Return small integers without symmetry, exact in floating point."""
    return np.asarray(np.arange(size) * 7 % 11 - 5, dtype=float)

"""Robustness limits of three control laws, by bisection over one imperfection at a time.

All else is exact. For each law and imperfection, the result is the largest imperfection with which
Case 1 succeeds on the nonlinear plant, and the smallest tried one with which it fails.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from study_tools.data_files import data_beside

from flight.loops import LAWS, simulator_of
from flight.metrics import successful, tracking
from flight.samples import tip
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.sweeps.sweep import sweep
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.truss.variations import loaded, scaled

MAX_BRACKET_RATIO = 1.2
"""Bisection ends when the ratio of the bounds is below this value, or when they are neighbours [-]."""

TRIAL_DURATION = 80.0
"""Simulated time of a trial: 60 s of motion and 20 s at rest [s]."""

Trial = tuple[str, str, float]
"""Law, imperfection, and value of the imperfection [its unit]."""


class Imperfection(NamedTuple):
    """Deviation of hardware or truss from the exact loop.

    Attributes
    ----------
    label, unit : str
        Name and unit in the table.
    mild, severe : float
        Initial bounds of the bisection [unit].
    """

    label: str
    unit: str
    mild: float
    severe: float


IMPERFECTIONS = {
    name: Imperfection(**values)
    for name, values in data_beside(__file__, "limits.toml").items()
}
"""Imperfections by name: those of `TRUSSES`, and arguments of `Law.hardware`."""


def _heavier(truss: TrussModes, percent: float) -> TrussModes:
    return scaled(truss, mass=1.0 + percent / 100.0)


def _with_payload(truss: TrussModes, mass: float) -> TrussModes:
    return loaded(truss.damped(0.0), tip(truss), mass).damped(truss.damping_ratios[0])


TRUSSES = {"mass": _heavier, "payload": _with_payload}
"""Functions of the nominal truss and a value that return the truss of the plant."""


def trial_simulator(
    law: str, imperfection: str, value: float, backend: str = "auto"
) -> Simulator:
    """Return the simulator of a `Trial`."""
    chosen = LAWS[law]
    truss = chosen.truss()
    nominal = truss.dynamics
    errors = {imperfection: value}
    if imperfection in TRUSSES:
        modes = TRUSSES[imperfection](nominal.modes, errors.pop(imperfection))
        truss = TunableTruss(
            replace(nominal, modes=modes), modal_actuation=truss.modal_actuation
        )
    return simulator_of(
        chosen, truss, chosen.hardware(**errors), nominal=nominal, backend=backend
    )


def simulated(
    trials: Sequence[Trial],
    path: Path | None = None,
    *,
    duration: float = TRIAL_DURATION,
    **options: Any,
) -> list[bool]:
    """Simulate trials, and return which of them succeed.

    Parameters
    ----------
    trials : sequence of Trial
        Laws with the values of one imperfection.
    path : pathlib.Path, optional
        Folder for finished trials.
    duration : float
        Simulated time [s].
    **options
        Further arguments of `sweep`.
    """
    vary = {("law", "imperfection", "value"): list(trials)}
    found = sweep(
        trial_simulator, duration, vary=vary, keep=tracking, path=path, **options
    )
    succeeded: list[bool] = successful(found).values.tolist()
    return succeeded


def robustness_limits(
    simulate: Callable[[Sequence[Trial], int], Sequence[bool]],
) -> dict[tuple[str, str], tuple[float, float]]:
    """Return the largest imperfection that succeeds and the smallest that fails.

    All laws and imperfections are bisected together, so that the trials of a round run in parallel.

    Parameters
    ----------
    simulate : callable
        Function of trials and the number of the round that returns which trials succeed.

    Returns
    -------
    dict
        By imperfection and law; NaN if no value succeeds, or none fails [unit of the imperfection].
    """
    pairs = list(product(IMPERFECTIONS, LAWS))
    bounds = dict.fromkeys(pairs, (np.nan, np.nan))
    trials = [
        (law, name, end)
        for name, law in pairs
        for end in (IMPERFECTIONS[name].mild, IMPERFECTIONS[name].severe)
    ]
    for number in count():
        results = dict(zip(trials, simulate(trials, number), strict=True))
        # The first failure in the order of severity and the last success bound the limit.
        for (law, name, value), success in results.items():
            best, worst = bounds[name, law]
            if success:
                bounds[name, law] = value, worst
            elif number or np.isnan(worst):
                bounds[name, law] = best, value
        trials = [
            (law, name, middle)
            for (name, law), (best, worst) in bounds.items()
            if (middle := next_value(best, worst, _resolution(name, law))) is not None
        ]
        if not trials:
            break
    return bounds


def next_value(best: float, worst: float, resolution: float) -> float | None:
    """Return the next value of the bisection, or None if the bounds are close or one is NaN.

    Parameters
    ----------
    best, worst : float
        Value that succeeds, zero or positive, and value that fails, positive [any].
    resolution : float
        If positive, values are its multiples [any].
    """
    if np.isnan(best * worst) or (
        best and max(best / worst, worst / best) < MAX_BRACKET_RATIO
    ):
        return None
    middle = float(np.sqrt(best * worst)) if best else worst / 4.0
    if resolution:
        if worst - best < 1.5 * resolution:
            return None
        steps = np.clip(
            round(middle / resolution), best // resolution + 1, worst // resolution - 1
        )
        middle = float(steps * resolution)
    return middle


def _resolution(imperfection: str, law: str) -> float:
    """Return the resolution of a varied time [s]; 0 for other imperfections."""
    return LAWS[law].step if IMPERFECTIONS[imperfection].unit == "s" else 0.0

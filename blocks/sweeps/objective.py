"""Objective functions of the runs of all samples, with exact derivatives or by sweeps."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from trussflow.blocks.errors import DivergenceError, SimulationError
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.support.types import Array
from trussflow.blocks.sweeps.gradients import DifferentiatedRun, explained
from trussflow.blocks.sweeps.sweep import sweep
from trussflow.blocks.tracing.kernels import column_of, shapes_of, symbol, written_out

Becoming = Callable[..., Mapping[str, Any]]
"""Takes values by name as keywords, and returns parameters and initial states by ``"block.name"``."""


class Trial(NamedTuple):
    """Results of one trial: all samples simulated with one candidate parameter vector.

    Attributes
    ----------
    found : dict of array
        Results of each function, with samples along the first axis [as it returns].
    slopes : dict of array
        Derivatives, with axes for samples, elements of the result, and elements of all values.
    """

    found: dict[str, Array]
    slopes: dict[str, Array]


Trials = Callable[[Mapping[str, Array]], Trial]
"""Objective for values by name [as declared]; it raises DivergenceError if a result is not finite."""


def differentiated(
    simulator: Simulator,
    duration: float,
    functions: Mapping[str, Callable[..., Any]],
    becoming: Becoming,
    start: Mapping[str, Array],
    samples: Sequence[Mapping[str, Any]],
) -> Trials:
    """Return the objective with exact derivatives, which runs one sample after another.

    Parameters
    ----------
    simulator : Simulator
        Simulator of the diagram.
    duration : float
        Duration of each run [s].
    functions : mapping of callable
        Functions of a traced run by name.
    becoming : callable
        Function from values to parameters and initial states; it must trace.
    start : mapping of array
        Initial values [as declared].
    samples : sequence of mapping
        Other parameters and initial states of each run.

    Raises
    ------
    SimulationError
        If a value becomes one of another shape, or the run cannot be differentiated.
    """
    traced = {name: symbol(name, np.shape(value)) for name, value in start.items()}
    with explained("becoming()"), written_out():
        made = becoming(**traced)
        shapes = shapes_of(made)
        column = column_of(made.values())
    values = column_of(traced.values())
    jacobian = ca.densify(ca.jacobian(column, values))
    slope_of = ca.Function("slope", [values], [jacobian])
    # All samples share one compiled function: their values are inputs, too.
    run = DifferentiatedRun(simulator, duration, functions, [*made, *samples[0]])
    for e, (name, shape) in zip(run.values, shapes.items(), strict=False):
        if shape != e.shape:
            raise SimulationError(
                f"'{name}' becomes {shape}, and has the shape {e.shape}"
            )

    def trial(values: Mapping[str, Array]) -> Trial:
        made = becoming(**values)
        each = [run({**made, **sample}) for sample in samples]
        slope = slope_of(np.concatenate([*map(np.ravel, values.values())])).full()
        found, slopes = dict[str, Array](), dict[str, Array]()
        for name in functions:
            found[name] = np.stack([one[name] for one, _ in each])
            slopes[name] = np.stack(
                # The chain rule; columns of the samples' own values, which do
                # not vary, are left out.
                [by[name][:, : len(slope)] @ slope for _, by in each]
            )
        return Trial(found, slopes)

    return trial


def swept(
    simulator: Simulator,
    duration: float,
    functions: Mapping[str, Callable[..., Any]],
    becoming: Becoming,
    samples: Sequence[Mapping[str, Any]],
    path: str | Path | None,
    **how: Any,
) -> Trials:
    """Return the objective without derivatives: each trial is a sweep with the same compiled code.

    Parameters
    ----------
    simulator : Simulator
        Simulator of the diagram.
    duration : float
        Duration of each run [s].
    functions : mapping of callable
        Functions of a result by name.
    becoming : callable
        Function from values to parameters and initial states.
    samples : sequence of mapping
        Other parameters and initial states of each run.
    path : path or None
        Folder for the runs of each trial.
    **how
        As for `sweep`: executor, workers and repeats.
    """

    def trial(values: Mapping[str, Array]) -> Trial:
        made, folder = becoming(**values), None
        if path is not None:
            flat = np.concatenate([*map(np.ravel, made.values())])
            # Named by the values: the same call finds the runs of each trial again.
            folder = Path(path) / hashlib.sha256(flat.tobytes()).hexdigest()[:16]
        names = (*made, *samples[0])
        # One row for each sample: the names vary together, not in a grid.
        rows = [[{**made, **sample}[name] for name in names] for sample in samples]
        runs = sweep(
            simulator,
            duration,
            vary={names: rows},
            keep=functions,
            path=folder,
            progress=False,
            **how,
        )
        outcomes = zip(runs["status"].values, runs["message"].values, strict=True)
        for status, message in outcomes:
            if status != "complete":
                # A search survives divergence, but ends at any other failure.
                error = DivergenceError if status == "diverged" else SimulationError
                raise error(str(message))
        found = {name: runs[name].values for name in functions}
        for name, result in found.items():
            if not np.isfinite(result).all():
                raise DivergenceError(f"{name} is not finite")
        return Trial(found, {})

    return trial

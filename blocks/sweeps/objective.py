"""Objective functions of the runs of all samples, with exact derivatives or by sweeps."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import casadi as ca
import numpy as np

from trussflow.blocks.errors import DivergenceError, SimulationError
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.support.types import Array
from trussflow.blocks.sweeps.gradients import DifferentiatedRun, explained
from trussflow.blocks.sweeps.sweep import sweep
from trussflow.blocks.tracing.kernels import (
    shape_of,
    symbol,
    to_expression,
    written_out,
)

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


class Trials(Protocol):
    """Interface of objectives, evaluated for values by name [as declared]."""

    def __call__(self, values: Mapping[str, Array]) -> Trial:
        """Return the trial; raise DivergenceError if a run or a result is not finite."""


class DifferentiatedTrials:
    """Objective with exact derivatives, which runs one sample after another; see `DifferentiatedRun`.

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
    """

    def __init__(
        self,
        simulator: Simulator,
        duration: float,
        functions: Mapping[str, Callable[..., Any]],
        becoming: Becoming,
        start: Mapping[str, Array],
        samples: Sequence[Mapping[str, Any]],
    ) -> None:
        self._becoming, self._samples = becoming, samples
        traced = {name: symbol(name, np.shape(value)) for name, value in start.items()}
        with explained("what the values become"), written_out():
            made = becoming(**traced)
            shapes = {name: shape_of(value) for name, value in made.items()}
            column = ca.vertcat(*(to_expression(value) for value in made.values()))
        values = ca.vertcat(*(to_expression(value) for value in traced.values()))
        self._slope = ca.Function(
            "slope", [values], [ca.densify(ca.jacobian(column, values))]
        )
        self._run = DifferentiatedRun(
            simulator, duration, functions, [*made, *samples[0]]
        )
        for name, shape in shapes.items():
            if shape != self._run.shapes[name]:
                raise SimulationError(
                    f"'{name}' becomes {shape}, and has the shape {self._run.shapes[name]}"
                )

    def __call__(self, values: Mapping[str, Array]) -> Trial:
        """Return what came of `values` [as declared]."""
        made = self._becoming(**values)
        each = [self._run({**made, **sample}) for sample in self._samples]
        slope = self._slope(
            np.concatenate([np.ravel(value) for value in values.values()])
        ).full()
        found, slopes = dict[str, Array](), dict[str, Array]()
        for name, shape in self._run.results.items():
            rows = [
                np.hstack([by[name][one].reshape(prod(shape), -1) for one in made])
                @ slope
                for _, by in each
            ]
            found[name], slopes[name] = (
                np.stack([one[name] for one, _ in each]),
                np.stack(rows),
            )
        return Trial(found, slopes)


@dataclass(frozen=True, slots=True)
class SweptTrials:
    """Objective without derivatives: each trial is a sweep with the same compiled code.

    Attributes
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
    how : mapping
        As for `sweep`: executor, workers and repeats.
    """

    simulator: Simulator
    duration: float
    functions: Mapping[str, Callable[..., Any]]
    becoming: Becoming
    samples: Sequence[Mapping[str, Any]]
    path: str | Path | None
    how: Mapping[str, Any]

    def __call__(self, values: Mapping[str, Array]) -> Trial:
        """Return what came of `values` [as declared]."""
        made, path = self.becoming(**values), None
        if self.path is not None:
            flat = np.concatenate([np.ravel(value) for value in made.values()])
            path = Path(self.path) / hashlib.sha256(flat.tobytes()).hexdigest()[:16]
        names = (*made, *self.samples[0])
        rows = [[{**made, **sample}[name] for name in names] for sample in self.samples]
        swept = sweep(
            self.simulator,
            self.duration,
            vary={names: rows},
            keep=self.functions,
            path=path,
            progress=False,
            **self.how,
        )
        for status, message in zip(
            swept["status"].values, swept["message"].values, strict=True
        ):
            if status != "complete":
                raise (DivergenceError if status == "diverged" else SimulationError)(
                    str(message)
                )
        found = {name: swept[name].values for name in self.functions}
        for name, result in found.items():
            if not np.isfinite(result).all():
                raise DivergenceError(f"{name} is not finite")
        return Trial(found, {})

"""Where the published loop is unstable once the actuators work on the modes.

Poles of the linear model, and beside them the growth rate of the nonlinear simulation, which
starts along the eigenvector of the rightmost oscillating pole.
"""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from study_tools.cache import Work, inputs_of

from reproduction.trusses import truss_modes
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import layout_labels
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.transport.mission import CASES, Mission
from trussflow.models.transport.wiring import transport_diagram

DAMPINGS = (0.0, 0.005, 0.01, 0.02, 0.03, 0.05)
MODES = (6, 8, 10, 12, 14, 20)

OSCILLATING = 1.0
"""Poles with a smaller imaginary part are those of the tracking errors [rad/s]."""

FOLDS, PERIODS, LONGEST = 4.0, 12.0, 20.0
"""A run lasts for this many e-folds, at least so many periods, at most so many seconds."""

START = 1e-9
"""Largest modal rate at the start, deep in the linear range [kg^½·m/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StabilityJob:
    """Poles and growth rates for one number of modes, with or without the observer.

    Attributes
    ----------
    modes : int
        Number of flexible modes [-].
    observer : bool
        Whether there is a disturbance observer.
    dampings : tuple of float
        Fractions of critical damping [-].
    """

    modes: int
    observer: bool
    dampings: tuple[float, ...] = DAMPINGS

    @property
    def name(self) -> str:
        """Its name in the report."""
        return f"stability-{self.modes}-modes{'' if self.observer else '-no-observer'}"

    def diagram(self, folder: Path) -> Diagram:
        """Return the loop that holds the truss, with linear laws (beta = 1, eta = 0).

        Parameters
        ----------
        folder : pathlib.Path
            Where computed modes are kept.
        """
        modes = truss_modes("reconstructed", self.modes, folder)
        dynamics = replace(SpaceTruss.published().dynamics, modes=modes)
        mission = replace(Mission.of_case(1), position=np.zeros(3), exponent=1.0, switching_gain=0.0)
        truss = SpaceTruss(dynamics, modal_actuation=True)
        return transport_diagram(mission, truss, observer=self.observer, allocation="published")

    def parameters(self, case: int, damping: float) -> dict[str, Any]:
        """Return the parameters of one point of the map.

        Parameters
        ----------
        case : int
            Whose gains.
        damping : float
            Fraction of critical damping of every mode [-].
        """
        mission = Mission.of_case(case)
        found: dict[str, Any] = {
            "truss.damping_ratio": np.full(self.modes, damping),
            "controller.sigma": mission.reaching_gain,
        }
        if self.observer:
            found["observer.gain"] = mission.observer_bandwidth
        return found

    def work(self, folder: Path) -> Work:
        """Make the job ready.

        Parameters
        ----------
        folder : pathlib.Path
            Where computed modes are kept.
        """
        diagram = self.diagram(folder)
        simulator = Simulator(diagram, step=1e-3, log=["truss.modal_rate"])
        grid = [self.parameters(case, damping) for case in CASES for damping in self.dampings]
        listed = json.dumps([{k: np.asarray(v).tolist() for k, v in p.items()} for p in grid])
        method = inspect.getsource(sys.modules[__name__])
        inputs = (*inputs_of(simulator, LONGEST, {}), listed, method)
        return Work(inputs, lambda: self.compute(diagram, simulator))

    def compute(self, diagram: Diagram, simulator: Simulator) -> xr.Dataset:
        """Return poles and growth rates over cases and damping.

        Parameters
        ----------
        diagram : Diagram
            From `diagram`.
        simulator : Simulator
            The same, ready to run.
        """
        linearizer = Linearizer(diagram, ["truss.actuation"], ["truss.modal_rate"])
        found = np.zeros((3, len(CASES), len(self.dampings)))
        for i, case in enumerate(CASES):
            for j, damping in enumerate(self.dampings):
                parameters = self.parameters(case, damping)
                model = linearizer.at(OperatingPoint(parameters=parameters))
                pole, shape = rightmost(model.A)
                states = dict(zip(model.state_labels, shape, strict=True))
                rate = simulated_rate(simulator, parameters, pole, states)
                found[:, i, j] = pole.real, pole.imag, rate
        dims = ("case", "damping")
        names = ("pole_real", "pole_imaginary", "fitted_rate")
        return xr.Dataset(
            {name: (dims, values) for name, values in zip(names, found, strict=True)},
            {"case": list(CASES), "damping": list(self.dampings)},
        )


def rightmost(A: Vector) -> tuple[complex, Vector]:
    """Return the rightmost oscillating pole of dx/dt = A x, and its eigenvector.

    Parameters
    ----------
    A : array, shape (n, n)
        [1/s].
    """
    poles, vectors = np.linalg.eig(A)
    parts = np.where(poles.imag > OSCILLATING, poles.real, -np.inf)
    first = int(parts.argmax())
    return complex(poles[first]), vectors[:, first]


def simulated_rate(
    simulator: Simulator, parameters: Mapping[str, Any], pole: complex, shape: Mapping[str, complex]
) -> float:
    """Return the growth rate of the modal rates in the nonlinear simulation [1/s].

    Parameters
    ----------
    simulator : Simulator
        Logs ``truss.modal_rate`` at every step.
    parameters : mapping
        Of the point of the map.
    pole : complex
        Its period is the window that amplitudes are taken over [1/s].
    shape : mapping
        State to start from, by the labels of the linear model; its scale does not matter.
    """
    layout = simulator.prepared.plan.x
    vector = np.array([shape[label] for label in layout_labels(layout)]).real
    modes = parameters["truss.damping_ratio"].size
    vector *= START / np.abs(layout.named(vector)["truss.v"][-modes:]).max()
    period = 2 * np.pi / pole.imag
    folds = FOLDS / max(abs(pole.real), 1e-9)
    duration = round(min(max(folds, PERIODS * period), LONGEST), 3)
    result = simulator.run(duration, parameters=parameters, initial=layout.named(vector), progress=False)
    return fitted_rate(result["time"].values, result["truss.modal_rate"].values, period)


def fitted_rate(time: Vector, values: Vector, period: float) -> float:
    """Return the rate at which an oscillation grows, from its mean square over one period.

    Parameters
    ----------
    time : array, shape (n,)
        Evenly spaced [s].
    values : array, shape (n, m)
        The oscillation [any].
    period : float
        Its period [s].
    """
    window = max(2, round(period / (time[1] - time[0])))
    # The mean square over a whole period does not oscillate itself, whatever the phase.
    square = np.convolve(np.sum(values**2, axis=1), np.ones(window) / window, mode="valid")
    return float(np.polyfit(time[: len(square)], np.log(square) / 2, 1)[0])


def jobs() -> Sequence[StabilityJob]:
    """Return all jobs of the map, the largest first."""
    return [StabilityJob(modes=m, observer=o) for m in reversed(MODES) for o in (True, False)]

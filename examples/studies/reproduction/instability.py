"""Stability of the published loop with actuator work on the modes.

Poles of the linear model are compared with the growth rate of the nonlinear simulation, which starts
along the eigenvector of the rightmost oscillating pole.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from study_tools.stability import draw_growth, rightmost, stable_damping

from reproduction.trusses import truss_modes
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import layout_labels
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.support.types import Vector
from trussflow.blocks.sweeps.executors import Processes
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.figures import blank, save
from trussflow.models.transport.mission import CASES, Mission
from trussflow.models.transport.wiring import transport_diagram

DAMPINGS = (0.0, 0.005, 0.01, 0.02, 0.03, 0.05)
MODES = (6, 8, 10, 12, 14, 20)

MIN_FREQUENCY = 1.0
"""Least imaginary part of an oscillating pole [rad/s]; slower poles are those of the tracking errors."""

E_FOLDS, MIN_PERIODS, MAX_DURATION = 4.0, 12.0, 20.0
"""Duration of a run: e-folds [-], but at least these periods [-] and at most this time [s]."""

INITIAL_RATE = 1e-9
"""Largest modal rate at the start, deep in the linear range [kg^½·m/s]."""

CLEAR_DISTANCE = 0.1
"""Least distance of a pole from the imaginary axis at which relative differences are taken [1/s]."""


def holding_loop(folder: Path, modes: int, observer: bool) -> Diagram:
    """Return the loop that holds the truss, with linear laws (beta = 1, eta = 0).

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the computed modes.
    modes : int
        Number of flexible modes [-].
    observer : bool
        Whether there is a disturbance observer.
    """
    dynamics = replace(
        SpaceTruss.published().dynamics, modes=truss_modes(modes, folder)
    )
    held = replace(
        Mission.of_case(1), position=np.zeros(3), exponent=1.0, switching_gain=0.0
    )
    truss = SpaceTruss(dynamics, modal_actuation=True)
    return transport_diagram(held, truss, observer=observer, allocation="published")


def growth_rates(folder: Path, modes: int, observer: bool) -> Vector:
    """Return real part of the pole and simulated growth rate, shape (2, cases, dampings) [1/s].

    Parameters
    ----------
    folder, modes, observer
        As for `holding_loop`.
    """
    diagram = holding_loop(folder, modes, observer)
    simulator = Simulator(diagram, step=1e-3, log=["truss.modal_rate"])
    linearizer = Linearizer(diagram, ["truss.actuation"], ["truss.modal_rate"])
    found = np.zeros((2, len(CASES), len(DAMPINGS)))
    for (i, case), (j, damping) in product(enumerate(CASES), enumerate(DAMPINGS)):
        gains = Mission.of_case(case)
        parameters: dict[str, Any] = {
            "truss.damping_ratio": np.full(modes, damping),
            "controller.sigma": gains.reaching_gain,
        }
        if observer:
            parameters["observer.gain"] = gains.observer_bandwidth
        model = linearizer.at(OperatingPoint(parameters=parameters))
        pole, shape = rightmost(model.A, MIN_FREQUENCY)
        states = dict(zip(model.state_labels, shape, strict=True))
        found[:, i, j] = pole.real, simulated_rate(simulator, parameters, pole, states)
    return found


def stability_map(folder: Path, *, workers: int) -> dict[bool, Vector]:
    """Return the growth rates without and with observer, shape (modes, 2, cases, dampings) [1/s].

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the computed modes.
    workers : int
        Number of processes [-].
    """
    points = list(product((True, False), reversed(MODES)))  # the longest first
    with Processes(workers) as pool:
        jobs = {(o, m): pool.submit(growth_rates, folder, m, o) for o, m in points}
        return {
            o: np.array([jobs[o, m].result() for m in MODES]) for o in (False, True)
        }


def simulated_rate(
    simulator: Simulator,
    parameters: Mapping[str, Any],
    pole: complex,
    shape: Mapping[str, complex],
) -> float:
    """Return the growth rate of the modal rates in the nonlinear simulation [1/s].

    Parameters
    ----------
    simulator : Simulator
        Simulator that logs ``truss.modal_rate`` at every step.
    parameters : mapping
        Parameters of the point of the map.
    pole : complex
        Pole, whose period is the window for amplitudes [1/s].
    shape : mapping
        Initial state, keyed by the labels of the linear model; its scale does not matter.
    """
    layout = simulator.prepared.plan.x
    vector = np.array([shape[label] for label in layout_labels(layout)]).real
    modes = parameters["truss.damping_ratio"].size
    vector *= INITIAL_RATE / np.abs(layout.named(vector)["truss.v"][-modes:]).max()
    period = 2 * np.pi / pole.imag
    folds = E_FOLDS / max(abs(pole.real), 1e-9)
    duration = round(min(max(folds, MIN_PERIODS * period), MAX_DURATION), 3)
    result = simulator.run(
        duration, parameters=parameters, initial=layout.named(vector), progress=False
    )
    return fitted_rate(result["time"].values, result["truss.modal_rate"].values, period)


def fitted_rate(time: Vector, values: Vector, period: float) -> float:
    """Return the growth rate of an oscillation, from its mean square over one period [1/s].

    Parameters
    ----------
    time : array, shape (n,)
        Evenly spaced instants [s].
    values : array, shape (n, m)
        Oscillation [any].
    period : float
        Period of the oscillation [s].
    """
    window = max(2, round(period / (time[1] - time[0])))
    # The mean square over a whole period does not oscillate itself, whatever the phase.
    square = np.convolve(
        np.sum(values**2, axis=1), np.ones(window) / window, mode="valid"
    )
    return float(np.polyfit(time[: len(square)], np.log(square) / 2, 1)[0])


def stability_measures(maps: Mapping[bool, Vector]) -> dict[str, dict[str, float]]:
    """Return the numbers of the map: of each case with and without observer, and of all points.

    Parameters
    ----------
    maps : mapping
        Result of `stability_map`.
    """
    poles, rates = np.stack([maps[False], maps[True]], axis=-1).swapaxes(0, 1)
    clear = np.abs(poles) >= CLEAR_DISTANCE
    found = {
        "stability": {
            "largest relative difference": np.abs(rates / poles - 1)[clear].max(),
            "points compared": clear.sum(),
            "least distance from the axis": CLEAR_DISTANCE,
            "largest difference near the axis": np.abs(rates - poles)[~clear].max(
                initial=0.0
            ),
        }
    }
    for (i, case), observer in product(enumerate(CASES), (False, True)):
        pole, rate = maps[observer][:, :, i].swapaxes(0, 1)
        found[
            f"stability of case {case} {'with' if observer else 'without'} observer"
        ] = {
            "pole": pole[0, 0],
            "simulated": rate[0, 0],
            "stable damping": stable_damping(pole[0], DAMPINGS),
            "stable damping for all mode counts": stable_damping(
                pole.max(axis=0), DAMPINGS
            ),
        }
    return found


def draw_stability(maps: Mapping[bool, Vector], file: Path) -> None:
    """Draw the real parts of the poles over damping ratio and number of modes.

    Parameters
    ----------
    maps : mapping
        Result of `stability_map`.
    file : pathlib.Path
        Figure to write.
    """
    figure, cells = blank(2, 2)
    for ((i, case), observer), cell in zip(
        product(enumerate(CASES), maps), cells, strict=True
    ):
        draw_growth(
            cell,
            maps[observer][:, 0, i],
            [f"{100 * damping:g}" for damping in DAMPINGS],
            [str(modes) for modes in MODES],
            title=f"Case {case}, {'with' if observer else 'without'} observer",
            xlabel="damping [%]",
            ylabel="modes",
        )
    save(figure, file, small=True)

"""The whole modal analysis, table by table, its figures beside them."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from trussflow.blocks.framework.files import replaced
from trussflow.blocks.framework.telling import counted
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.simulation.results import save
from trussflow.models.modal_analysis import figures, tables
from trussflow.models.modal_analysis.convergence import (
    NUMBERS_OF_MODES,
    convergence,
    convergence_text,
    summary_text,
)
from trussflow.models.modal_analysis.linear_laws import Amplitude
from trussflow.models.modal_analysis.linear_loop import HeldTruss, OpenLoop
from trussflow.models.modal_analysis.margins import frequencies
from trussflow.models.modal_analysis.reduction import (
    balanced_truncation,
    elastic_part,
    modal_truncation,
    peak_gain,
)
from trussflow.models.modal_analysis.sampling import TIMINGS, timing, timing_rows
from trussflow.models.modal_analysis.spillover import QUICK, Grid, dynamics_with_modes, spillover_map
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.tables import text_table

FULL_MODES = 20
"""Modes of the model that is reduced."""

MODAL_DAMPING = 0.1
"""Damping with which Eq. 64 keeps the six-mode truss stable, for margins at the modes [-]."""

LAST_ROBOT = slice(18, 21)
"""Base force of Robot 4 among the actuators."""

Part = tuple[str, str]


@dataclass(frozen=True, kw_only=True)
class Study:
    """What the command computes.

    Attributes
    ----------
    folder : pathlib.Path
        Where figures and data are written.
    case : int
        Mission whose gains are taken [-].
    quick : bool
        Whether to look at less.
    amplitude, omega : float
        Amplitude [m, rad] and frequency [rad/s] of the errors, for describing functions.
    margins : list of dict
        What was found at the demand, loop by loop and channel by channel, once `tables` has come there.
    """

    folder: Path
    case: int = 1
    quick: bool = False
    amplitude: float = 1e-3
    omega: float = 1.0
    margins: list[dict[str, Any]] = field(default_factory=list, init=False)

    def tables(self) -> Iterator[Part]:
        """Yield title and text of each table, and write its figures and data."""
        _ = self._amplitude  # refuses nonsense before anything runs
        yield from self._modes()
        yield self._plant()
        yield from self._margins()
        yield from self._modal_loops()
        yield self._poles()
        yield self._spillover()
        yield self._reduction()
        yield self._timing()

    # -- what several tables need ---------------------------------------------------------------

    @cached_property
    def _published(self) -> HeldTruss:
        return HeldTruss(SpaceTruss.published(), case=self.case)

    @cached_property
    def _consistent(self) -> HeldTruss:
        return HeldTruss(SpaceTruss.consistent(), case=self.case)

    @cached_property
    def _observers(self) -> dict[str, float | None]:
        """Bandwidths of the observer: none, and the mission's."""
        bandwidth = self._published.mission.observer_bandwidth
        return {"no observer": None, f"L = {bandwidth:g}": bandwidth}

    @cached_property
    def _amplitude(self) -> Amplitude:
        return Amplitude(error=self.amplitude, omega=self.omega)

    @cached_property
    def _flown(self) -> dict[str, OpenLoop]:
        """The loops as they are flown."""
        return {
            f"{plant}, {name}": held.loop(bandwidth=bandwidth, amplitude=self._amplitude)
            for plant, held in (("published", self._published), ("consistent", self._consistent))
            for name, bandwidth in self._observers.items()
        }

    @cached_property
    def _natural(self) -> Vector:
        """Frequencies of the plant's elastic modes [rad/s]."""
        return np.sort(np.abs(np.linalg.eigvals(elastic_part(SpaceTruss.consistent()).A))[::2])

    # -- the tables -----------------------------------------------------------------------------

    def _modes(self) -> Iterator[Part]:
        numbers = (6, 14) if self.quick else NUMBERS_OF_MODES
        found = convergence(numbers_of_modes=numbers)
        title = "Natural frequencies, arms locked: modal model against all finite elements"
        yield (
            title,
            f"{summary_text(found)}\n\nMore modes remove only part of the error. 'all modes' is what stays: "
            "no mode of\nthe truss alone bends the rods at a grasp point as a robot's torque does. "
            "Attachment shapes\ndo: the last rows of the tables below, and the plant SpaceTruss.accurate.",
        )
        yield "Error of each natural frequency", convergence_text(found)

    def _plant(self) -> Part:
        truss = SpaceTruss.consistent()
        model = Linearizer(truss, ["actuation"], ["modal_coordinate", "grasp_displacement"]).at()
        groups = {f"base force, Robot {i + 1}": model[:, 6 * i : 6 * i + 3] for i in range(truss.robots)}
        start = 6 * truss.robots + (truss.joints // truss.robots) * (truss.robots - 1)
        groups["joint torques, Robot 4"] = model[:, start:]
        figures.draw_plant(groups, truss.modes, self._natural, self.folder)
        omega = np.unique(np.concatenate([w * (1 + np.linspace(-0.02, 0.02, 41)) for w in self._natural]))
        rows = []
        for name, group in groups.items():
            gains = np.moveaxis(group(1j * omega, squeeze=False), 2, 0)
            peaks = [np.linalg.norm(gains[:, k], axis=1).max() for k in range(truss.modes)]
            rows.append((name, *(f"{p:.2g}" for p in peaks)))
        header = ("largest gain [kg^½·m/N, kg^½/N]", *(f"mode {k + 1}" for k in range(truss.modes)))
        return "Actuators to modal coordinates, consistent plant", text_table(header, rows)

    def _margins(self) -> Iterator[Part]:
        for name, loop in self._flown.items():
            omega = frequencies(loop, points=300 if self.quick else 600)
            table, found = tables.demand_table(loop, omega)
            self.margins.extend({"loop": name, **asdict(m)} for m in found)
            disks = tables.disk_table(loop, omega, quick=self.quick)
            yield f"Margins at the demand, others closed: {name}", f"{table}\n\n{disks}"
        with (
            replaced(self.folder / "margins.csv") as partial,
            partial.open("w", newline="", encoding="utf-8") as file,
        ):
            writer = csv.DictWriter(file, self.margins[0])
            writer.writeheader()
            writer.writerows(self.margins)
        figures.draw_demand_loops(self._flown, self._natural, self.folder)
        figures.draw_singular_values(self._flown, self._natural, self.folder)

    def _modal_loops(self) -> Iterator[Part]:
        held = self._with_modal_work
        loops = {
            f"Eq. 64, {100 * damping:g} %, {name}": held.loop(
                bandwidth=bandwidth, amplitude=self._amplitude, damping=damping
            )
            for damping in (0.005, MODAL_DAMPING)
            for name, bandwidth in self._observers.items()
        }
        neutral, with_observer = list(self._flown.items())[-1]
        for name, loop in {**loops, neutral: with_observer}.items():
            table = tables.modal_table(loop)
            yield f"Loops at the modal forces: {name}", table
        figures.draw_modal_loops(loops, self._natural, self.folder)

    @cached_property
    def _with_modal_work(self) -> HeldTruss:
        """The consistent plant under the published allocation."""
        return HeldTruss(SpaceTruss.consistent(), allocation="published", case=self.case)

    def _poles(self) -> Part:
        eq64 = self._with_modal_work
        loops = {
            f"Eq. 64 with modal work, undamped, {name}": eq64.loop(bandwidth=bandwidth, damping=0.0)
            for name, bandwidth in (("no observer", None), ("L = 2", 2.0), ("L = 4", 4.0))
        }
        loops["published (no modal work), L = 4"] = self._published.loop(bandwidth=4.0)
        loops["consistent (mode-neutral), L = 4"] = self._consistent.loop(bandwidth=4.0)
        figures.draw_poles(loops, self._natural, self.folder)
        return "Rightmost oscillating poles, linear law", tables.pole_table(loops, 3 if self.quick else 5)

    def _spillover(self) -> Part:
        grid = spillover_map(QUICK if self.quick else Grid())
        save(grid, self.folder / "spillover.nc")
        figures.draw_spillover(grid, self.folder)
        title = "Spillover: least damping on the map from which on the loop is stable, linear law"
        return title, (
            tables.spillover_table(grid)
            + "\n\npublished: actuators do no work on the modes. Eq. 64: they do. consistent: they "
            "do, and\nthe feedback is allocated so that it does none on the first six."
        )

    def _reduction(self) -> Part:
        modes = 10 if self.quick else FULL_MODES
        full = elastic_part(SpaceTruss(dynamics_with_modes(modes, damping=0.005)), LAST_ROBOT)
        orders = (4, 8, 12) if self.quick else (4, 8, 16, 24, 32)
        found = [
            reduce(full, order) for order in orders for reduce in (modal_truncation, balanced_truncation)
        ]
        figures.draw_reductions(full, found[2:6], self.folder)
        title = f"Reduced models of {full.nstates} elastic states: force of Robot 4 to all grasps"
        return title, tables.reduction_table(found, peak_gain(full))

    def _timing(self) -> Part:
        loops = {
            **self._flown,
            "published, smc": self._published.loop("smc", amplitude=self._amplitude),
            "published, pd": self._published.loop("pd"),
            "consistent, smc": self._consistent.loop("smc", amplitude=self._amplitude),
            "consistent, pd": self._with_modal_work.loop("pd"),
        }
        timings = []
        for name, loop in counted("timing loops", loops.items()):
            fastest = float(np.abs(np.linalg.eigvals(loop.closed_matrix)).max())
            omega = frequencies(loop, high=10 * fastest, points=200 if self.quick else 500)
            timings.append(timing(name, loop, omega=omega, points=25 if self.quick else 50))
        title = "Delay and control period that the loop stands (all channels alike)"
        return title, text_table(list(TIMINGS), timing_rows(timings))

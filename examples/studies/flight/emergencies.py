"""Flights with losses, in batches that are kept: along body z, and in the attitude that survives each."""

from __future__ import annotations

import inspect
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from study_tools.cache import Work, inputs_of

from flight import failures, flights
from flight.failures import Loss, fly, losses
from flight.flights import Flights
from trussflow.blocks.framework.errors import DivergenceError
from trussflow.models.feasibility import best_attitude
from trussflow.models.hardware.hardware import Hardware
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.reporting import metrics
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.wiring import path_of

DURATION = 80.0
"""The motion takes 60 s [s]."""

SURVIVED = {1: (1, 2, 3), 2: (1, 2)}
"""Robots of which a part can be lost along the path of each case, as `survey` tells."""

MEASURES = {
    "position": "m",
    "attitude": "rad",
    "joints": "rad",
    "late_position": "m",
    "base_torque": "N*m",
    "joint_torque": "N*m",
}
"""Of each flight, as `Outcome` names them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Emergencies:
    """Flights with one loss each.

    Attributes
    ----------
    case : int
        1 or 2.
    part : str
        ``"base"`` or ``"robot"``.
    turned : bool
        Whether the truss flies in the attitude that `best_attitude` finds, turned about body x; base 4 may
        die then, too.
    brakes : bool
        Whether the joints of a dead robot are held.
    duration : float
        Of each flight [s].
    """

    case: int = 1
    part: str
    turned: bool = False
    brakes: bool = False
    duration: float = DURATION

    @property
    def name(self) -> str:
        """Its name in the report."""
        told = {", Case 2": self.case == 2, ", turned": self.turned, ", with brakes": self.brakes}
        return f"{self.part} lost" + "".join(what for what, so in told.items() if so)

    def losses(self) -> tuple[Loss, ...]:
        """Return what dies, flight by flight."""
        robots = (1, 2, 3, 4) if self.turned else SURVIVED[self.case]
        return losses((self.part,), robots)

    def work(self, folder: Path) -> Work:
        """Make the batch ready.

        Parameters
        ----------
        folder : pathlib.Path
            Not used: nothing is shared.
        """
        plant = TunableTruss.accurate()
        if self.turned:
            path = path_of(Mission.of_case(self.case), plant)
            limits = Hardware.flight().limits(plant)
            plant = plant.turned(best_attitude(plant.dynamics, path, limits, normal=(1, 0, 0)).attitude)
        simulator = Flights(self.case, plant=plant, losses=True, brakes=self.brakes).simulator

        def compute() -> xr.Dataset:
            rows = []
            for loss in self.losses():
                try:
                    found = fly(simulator, plant.dynamics, loss, duration=self.duration)
                except DivergenceError:
                    rows.append((*[np.nan] * len(MEASURES), np.inf, 1.0))
                    continue
                rows.append(
                    (
                        *(getattr(found, name) for name in MEASURES),
                        max(found.delays.values()),
                        len(found.false_alarms),
                    )
                )
            names = (*MEASURES, "found_after", "false_alarms")
            columns = zip(names, zip(*rows, strict=True), strict=True)
            told = {name: ("flight", list(column)) for name, column in columns}
            return xr.Dataset(told, {"flight": [str(loss) for loss in self.losses()]})

        modules = (sys.modules[__name__], failures, flights, metrics)
        methods = [inspect.getsource(module) for module in modules]
        return Work((*inputs_of(simulator, self.duration, {}), self.name, *methods), compute)


def emergencies() -> list[Emergencies]:
    """Return all batches."""
    return [
        Emergencies(part="base"),
        Emergencies(part="robot", brakes=True),
        Emergencies(part="robot"),
        Emergencies(part="base", turned=True),
        Emergencies(part="base", case=2),
    ]

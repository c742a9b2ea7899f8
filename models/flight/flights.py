"""Flights of one mission by its mean axes: traced once, then flown with any truss, noise and design."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from trussflow.blocks.framework.errors import DivergenceError
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.models.flight.draws import Draw
from trussflow.models.hardware.hardware import SENSORS, Hardware
from trussflow.models.hardware.measurement import derived_seed
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.transport.mean_axes_wiring import mean_axes_transport
from trussflow.models.transport.mission import Mission

STEP = 2e-3
"""Of RK4, a tenth of the sample time; the highest of the condensed modes takes no more [s]."""

DURATION = 100.0
"""The motion takes 60 s [s]."""

LOG = (
    "trajectory.position",
    "truss.task_position",
    "truss.base_force",
    "truss.base_torque",
    "truss.joint_torque",
    "truss.grasp_displacement",
    "actuators.used.y",
    "controller.monitor.evidence",
    "controller.monitor.effectiveness",
)


def flown_hardware(case: int) -> Hardware:
    """Return the hardware of a case: `Hardware.flight`, with 1 N·m and larger wheels in Case 2.

    Parameters
    ----------
    case : int
        1 or 2.
    """
    return Hardware.flight(torque=None if case == 1 else 1.0)


def noise_of(seed: int) -> dict[str, int]:
    """Return the seeds of all sensors, as parameters of a run.

    Parameters
    ----------
    seed : int
        Which noise, at least 0.
    """
    return {
        f"sensors.{name}.noise.seed": derived_seed(derived_seed(seed, k), 0) for k, name in enumerate(SENSORS)
    }


class Flights:
    """A mission on the accurate plant behind its hardware.

    Parameters
    ----------
    case : int
        1 or 2.
    """

    def __init__(self, case: int) -> None:
        self.plant = TunableTruss.accurate()
        diagram = mean_axes_transport(Mission.of_case(case), self.plant, hardware=flown_hardware(case))
        self.simulator = Simulator(diagram, step=STEP, log=list(LOG), log_step=0.02)

    def parameters(self, seed: int, draw: Draw) -> dict[str, Any]:
        """Return the parameters of a flight.

        Parameters
        ----------
        seed : int
            Of the noise.
        draw : Draw
            The truss.
        """
        truss = self.plant.truss_parameters(draw.truss(self.plant.dynamics.modes))
        return {f"truss.{name}": value for name, value in truss.items()} | noise_of(seed)

    def fly(self, parameters: Mapping[str, Any], duration: float = DURATION) -> xr.Dataset | None:
        """Return what was logged, or None if the flight was lost: a state stopped being finite.

        Parameters
        ----------
        parameters : mapping
            Of the run.
        duration : float
            [s].
        """
        try:
            return self.simulator.run(duration, parameters=parameters, progress=False, not_finite="ignore")
        except DivergenceError:
            return None

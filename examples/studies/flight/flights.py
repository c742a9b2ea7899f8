"""Flights of one mission by its mean axes: traced once, then flown with any truss, noise and design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from flight.draws import parameters_of, truss_of
from flight.failures import with_loss
from flight.measures import UNITS, measured
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.sweeps.sweep import sweep
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.hardware.hardware import SENSOR_UNITS, Hardware
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
        f"sensors.{name}.noise.seed": derived_seed(derived_seed(seed, k), 0)
        for k, name in enumerate(SENSOR_UNITS)
    }


class Flights:
    """A mission by its mean axes on the accurate plant, behind its hardware.

    Parameters
    ----------
    case : int
        1 or 2.
    plant : TunableTruss, optional
        By default the accurate one.
    believed : TrussDynamics, optional
        What the controller believes; by default the plant with its nominal truss.
    losses : bool
        Whether actuators may be lost, or be of another gain, by the block that `with_loss` adds.
    brakes : bool
        Whether joints whose drives are lost are held.
    more : sequence of str
        What is logged besides `LOG`.
    """

    def __init__(
        self,
        case: int,
        *,
        plant: TunableTruss | None = None,
        believed: TrussDynamics | None = None,
        losses: bool = False,
        brakes: bool = False,
        more: Sequence[str] = (),
    ) -> None:
        self.plant = plant or TunableTruss.accurate()
        diagram = mean_axes_transport(
            Mission.of_case(case), self.plant, believed=believed, hardware=flown_hardware(case)
        )
        if losses:
            with_loss(diagram, self.plant.dynamics, brakes=brakes)
        self.simulator = Simulator(diagram, step=STEP, log=[*LOG, *more], log_step=0.02)

    def parameters(self, seed: int) -> dict[str, Any]:
        """Return the parameters of a flight: its truss and its noise.

        Parameters
        ----------
        seed : int
            Of both, or `NOMINAL`.
        """
        return parameters_of(self.plant, truss_of(seed, self.plant.dynamics.modes)) | noise_of(max(seed, 0))

    def measured(
        self,
        each: Sequence[Mapping[str, Any]],
        seeds: Sequence[int],
        duration: float = DURATION,
        path: Path | None = None,
    ) -> xr.Dataset:
        """Return what is measured of several flights, along ``seed``: NaN of those that were lost.

        Parameters
        ----------
        each : sequence of mapping
            Parameters of each flight, equally named.
        seeds : sequence of int
            What to call them.
        duration : float
            [s].
        path : pathlib.Path, optional
            Where those that are finished are kept, until all are.
        """
        found = sweep(
            self.simulator,
            duration,
            vary={tuple(each[0]): [tuple(one.values()) for one in each]},
            keep=measured,
            path=path,
            executor="serial",
            progress=False,
            not_finite="ignore",
        )
        columns = {name: ("seed", found[name].values, {"units": unit}) for name, unit in UNITS.items()}
        return xr.Dataset(columns, {"seed": [*seeds]})

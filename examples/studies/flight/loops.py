"""Closed loops of the study: plant, hardware and control law of one simulator."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flight.faults import add_faults
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.feasibility.reach import shares_left
from trussflow.models.hardware.hardware import Hardware
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.transport.mean_axes_wiring import mean_axes_transport
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.wiring import path_of, transport_diagram

LOG = (
    "trajectory.position",
    "truss.task_position",
    "truss.base_force",
    "truss.grasp_displacement",
)
"""Logged signals of all loops."""

FLIGHT_LOG = (
    *LOG,
    "truss.base_torque",
    "truss.joint_torque",
    "actuators.used.y",
    "actuators.stored.y",
    "controller.monitor.effectiveness",
    "faults.base_effect",
    "faults.valves",
)
"""Logged signals of the mean-axes controller with the reference hardware."""

SERVO_STEP = 1e-3
"""Largest step of the solver with a servo of this sample time [s]."""


@dataclass(frozen=True, slots=True)
class Law:
    """Control law with its plant.

    Attributes
    ----------
    label : str
        Name in the tables.
    plant : str
        Name of the constructor of the plant.
    hold, delay : float
        Smallest sample time and computing delay: the step of the paper, or the design of the mean-axes
        controller [s].
    step : float
        Step of the solver, and resolution of varied times [s].
    """

    label: str
    plant: str
    hold: float = 1e-3
    delay: float = 0.0
    step: float = 1e-3

    def truss(self) -> TunableTruss:
        """Return the plant."""
        truss: TunableTruss = getattr(TunableTruss, self.plant)()
        return truss

    def hardware(
        self, *, hold: float = 0.0, delay: float = 0.0, **errors: float
    ) -> Hardware:
        """Return exact hardware except for a longer `hold`, a further `delay` [s] and other `errors`.

        The mean-axes controller needs one more sample time for its computation.
        """
        hold = max(hold, self.hold)
        return Hardware.exact(hold, delay + (hold if self.delay else 0.0), **errors)


LAWS = {
    "published": Law("the paper's law, published plant", "published"),
    "mode-neutral": Law("mode-neutral allocation, consistent plant", "consistent"),
    "mean axes": Law(
        "mean axes, accurate plant", "accurate", hold=0.02, delay=0.02, step=2e-3
    ),
}

PAPER_LAWS = LAWS | {
    "mean axes": Law("mean axes, consistent plant", "consistent", delay=1e-3)
}
"""Laws at the sample time of the paper, 1 ms."""


def simulator_of(
    law: Law,
    truss: TunableTruss,
    hardware: Hardware,
    *,
    case: int = 1,
    nominal: TrussDynamics | None = None,
    faults: bool = False,
    log: tuple[str, ...] = LOG,
    backend: str = "auto",
) -> Simulator:
    """Return the simulator of a closed loop.

    Parameters
    ----------
    law : Law
        Control law.
    truss : TunableTruss
        Plant, with the reflected inertia of the drives.
    hardware : Hardware
        Hardware between controller and plant.
    case : int
        Case 1 or 2 of the paper.
    nominal : TrussDynamics, optional
        Nominal dynamics of the controller, by default those of the plant.
    faults : bool
        Whether the loop has `Faults`, and isolates only bases without which the mission is feasible.
    log : tuple of str
        Logged signals.
    backend : str
        As for `Simulator`.
    """
    mission = Mission.of_case(case)
    if law.delay:
        design = replace(MeanAxesDesign.shipped(), sample_time=hardware.sample_time)
        diagram = mean_axes_transport(
            mission, truss, design=design, believed=nominal, hardware=hardware
        )
    else:
        diagram = transport_diagram(mission, truss, believed=nominal, hardware=hardware)
    if faults:
        add_faults(diagram, truss, hardware.sample_time)
        path, limits = path_of(mission, truss), hardware.limits(truss)
        shares = shares_left(truss.dynamics, path, limits)
        monitor = diagram.blocks["controller"].blocks["monitor"]
        monitor.parameters["dispensable"] = np.floor(shares)
    step = min(law.step, SERVO_STEP) if hardware.servo else law.step
    return Simulator(diagram, step=step, log=log, log_step=0.02, backend=backend)


def law_simulator(
    law: str,
    *,
    of_paper: bool = False,
    reference_hardware: bool = False,
    backend: str = "auto",
) -> Simulator:
    """Return the loop of Case 1 of a control law.

    Parameters
    ----------
    law : str
        Name in `LAWS`.
    of_paper : bool
        Whether the law is that of `PAPER_LAWS`.
    reference_hardware : bool
        Whether to use the reference hardware instead of exact hardware.
    backend : str
        As for `Simulator`.
    """
    chosen = (PAPER_LAWS if of_paper else LAWS)[law]
    hardware = flight_hardware(1) if reference_hardware else chosen.hardware()
    truss = hardware.mounted(chosen.truss())
    return simulator_of(chosen, truss, hardware, backend=backend)


def flight_simulator(
    case: int = 1,
    *,
    arm: str = "literal",
    nominal_arms: float = 1.0,
    backend: str = "auto",
) -> Simulator:
    """Return the mean-axes loop of the accurate plant with the reference hardware and `Faults`.

    Parameters
    ----------
    case : int
        Case 1 or 2 of the paper.
    arm : str
        Arm of the robots, as for `TunableTruss.accurate`.
    nominal_arms : float
        Masses and lengths of the arms in the nominal dynamics, relative to the plant [-].
    backend : str
        As for `Simulator`.
    """
    hardware = flight_hardware(case)
    truss = hardware.mounted(TunableTruss.accurate(arm=arm))
    return simulator_of(
        LAWS["mean axes"],
        truss,
        hardware,
        case=case,
        nominal=with_arms(truss.dynamics, nominal_arms),
        faults=True,
        log=FLIGHT_LOG,
        backend=backend,
    )


def flight_hardware(case: int) -> Hardware:
    """Return `Hardware.flight`, with wheels of 1 N·m in Case 2."""
    return Hardware.flight(torque=None if case == 1 else 1.0)


def with_arms(dynamics: TrussDynamics, factor: float) -> TrussDynamics:
    """Return dynamics with scaled masses and lengths of the arms; the bases are unchanged.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots.
    factor : float
        Positive factor of masses and lengths [-].
    """
    arms = [
        replace(
            arm,
            masses=factor * arm.masses,
            static_moments=factor**2 * arm.static_moments,
            inertias=factor**3 * arm.inertias,
            joint_origins=factor * arm.joint_origins,
            base_origin=factor * arm.base_origin,
        )
        for arm in dynamics.arms
    ]
    return replace(dynamics, arms=tuple(arms))

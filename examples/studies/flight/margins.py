"""Stability margins of the mean-axes loop along its path, linearized under thrust.

At rest, a linearization does not show the effect of the thrust, under which arms buckle without a servo. So a run
without noise and quantization is stopped at an instant, and plant and controller are linearized there with
held commands. The excitation is off: a torque that changes its sign every second sample has no steady state.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import takewhile
from typing import Any

import numpy as np
import xarray as xr

from flight.loops import LAWS
from flight.sampled_loop import SampledLoop, spectral_radius
from flight.samples import sample_parameters
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.library.algebra import Function
from trussflow.blocks.linear_analysis.margins import channel_disks, frequencies_about
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.support.types import Array
from trussflow.models.hardware.hardware import Hardware
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.transport.mean_axes_wiring import mean_axes_transport
from trussflow.models.transport.mission import Mission

INSTANTS = {"at rest": 0.0, "peak acceleration": 0.2113, "peak braking": 0.7887}
"""Instants, relative to the duration of the path [-]; a quintic accelerates most at 1/2 ± 1/sqrt(12)."""

VARIATIONS = {"nominal": 1.0, "base gain 0.5": 0.5, "base gain 2": 2.0}
"""Gains of all bases [-].

Gains apply to the feedback at constant thrust. In a simulation, the loop also corrects a lack of thrust.
"""

MAX_LATE_SAMPLES = 10
"""Largest number of samples by which commands are late [-]."""

_STATES = [
    f"controller.estimator.{name}"
    for name in ("y", "nu", "eta", "eta_rate", "w", "posture")
]


def loop_session(
    mission: Mission | None = None,
    truss: TunableTruss | None = None,
    backend: str = "auto",
) -> Session:
    """Return a session of the mean-axes loop with drives and servo, without other hardware.

    The servo is continuous: of its sample time and delay, 1.5 ms in total, nothing remains.

    Parameters
    ----------
    mission : Mission, optional
        Mission with constant joint references, by default Case 1.
    truss : TunableTruss, optional
        Plant without drives, by default the accurate one.
    backend : str
        As for `Session`.
    """
    hardware = Hardware.flight()
    truss = hardware.mounted(truss or TunableTruss.accurate())
    diagram = mean_axes_transport(mission or Mission.of_case(1), truss)
    limits = hardware.limits(truss)
    for name in ("allocation", "economy"):
        diagram.blocks["controller"].blocks[name].parameters["limits"] = limits
    gains = hardware.servo
    assert gains is not None

    def torques(reference: Array, angles: Array, rates: Array) -> Array:
        stiffness, damping = gains.proportional_gain, gains.derivative_gain
        return stiffness * (reference - angles) - damping * rates

    inputs = {name: Input(truss.joints) for name in ("reference", "angles", "rates")}
    servo = Function(torques, inputs, {"torques": Output(truss.joints)})
    diagram.add(servo=servo)
    controller = diagram.blocks["controller"]
    diagram.blocks["trajectory"].port("position")[6:] >> servo.port("reference")
    truss.task_position[6:] >> servo.port("angles")
    truss.rigid_speeds[6:] >> servo.port("rates")
    command, bases = controller.port("command"), 6 * truss.robots
    for target in truss.actuation, controller.port("actuation"):
        diagram.disconnect(target)
        command[:bases] >> target[:bases]
        command[bases:] + servo.port("torques") >> target[bases:]
    servo.port("torques") >> controller.port("servo_torque")
    return Session(diagram, outputs=[], step=LAWS["mean axes"].step, backend=backend)


def loops_along(
    session: Session,
    duration: float,
    parameters: Mapping[str, Any] | None = None,
    instants: Mapping[str, float] = INSTANTS,
) -> Iterator[tuple[str, SampledLoop]]:
    """Simulate, and yield the linearized loop at each instant.

    Parameters
    ----------
    session : Session
        Session by `loop_session`, or of `mean_axes_transport` without hardware and with a `TunableTruss`.
    duration : float
        Duration of the path [s].
    parameters : mapping, optional
        Parameters of the run, by ``"block.parameter"``, such as ``"truss.mass"`` [as declared].
    instants : mapping
        Increasing instants by name, relative to the duration [-].

    Raises
    ------
    DivergenceError
        If the run diverges before an instant.
    """
    session.start(parameters={**(parameters or {}), "controller.probe.strength": 0.0})
    tick = session.prepared.plan.system.clocks[0].period
    rigid = session.prepared.plan.memory.entries["controller.estimator", "y"].shape[0]
    measured = [f"truss.{name}[0:{rigid}]" for name in ("q", "v")]
    for name, part in instants.items():
        session.advance(float(round(part * duration / tick) * tick))
        yield (
            name,
            SampledLoop.of(session, "controller.hold.command", _STATES, measured),
        )


def margins_of(loop: SampledLoop, bases: int) -> dict[str, Any]:
    """Return the margins of a loop.

    Parameters
    ----------
    loop : SampledLoop
        Loop of bases and joints.
    bases : int
        Number of the commands of bases, the first ones [-].

    Returns
    -------
    dict
        ``growth``: growth rate under each of `VARIATIONS`, negative if stable [1/s]. ``disk``: smallest disk
        margin of an actuator or sensor with all other loops closed, 0 if unstable [-]. ``delay``: largest
        delay of all commands in whole samples up to which the loop is stable, NaN if there is none [s].
    """

    def stable(late: int) -> bool:
        return spectral_radius(loop.closed(late=late)) < 1.0

    of_base = np.arange(loop.plant.ninputs) < bases
    radii = [
        spectral_radius(loop.closed(actuators=np.where(of_base, gain, 1.0)))
        for gain in VARIATIONS.values()
    ]
    return {
        "growth": np.log(radii) / loop.controller.dt,
        "disk": min_disk(loop) if radii[0] < 1.0 else 0.0,
        "delay": max(takewhile(stable, range(MAX_LATE_SAMPLES + 1)), default=np.nan)
        * loop.controller.dt,
    }


def min_disk(loop: SampledLoop) -> float:
    """Return the smallest disk margin of the actuators and sensors of a stable loop [-]."""
    omega = frequencies_about(loop.continuous_poles(), 0.02, np.pi / loop.controller.dt)
    places = "actuators", "sensors"
    return min(
        float(channel_disks(loop.loop_gain(place), omega)[0].min()) for place in places
    )


def margins_along(seeds: list[int]) -> xr.Dataset:
    """Return the margins at all `INSTANTS` for the truss of each seed."""
    session, plant = loop_session(), TunableTruss.accurate()
    duration = Mission.of_case(1).duration
    found = []
    for seed in seeds:
        loops = loops_along(session, duration, sample_parameters(plant, seed))
        found.append([margins_of(loop, 6 * plant.robots) for _, loop in loops])
    along = "seed", "instant"
    dims = {"growth": (*along, "variation"), "disk": along, "delay": along}
    return xr.Dataset(
        {
            name: (dim, [[one[name] for one in row] for row in found])
            for name, dim in dims.items()
        },
        {"seed": seeds, "instant": list(INSTANTS), "variation": list(VARIATIONS)},
    )

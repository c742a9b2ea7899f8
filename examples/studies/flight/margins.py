"""Stability margins of the mean-axes loop along its path, linearized under thrust.

At rest, a linearization does not show the effect of the thrust, which makes the arms buckle. So a run
without noise and quantization is stopped at an instant, and plant and controller are linearized there with
held commands. The excitation is off: a torque that changes its sign every second sample has no steady state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr

from flight.loops import LAWS
from flight.sampled_loop import SampledLoop, spectral_radius
from flight.samples import sample_parameters
from trussflow.blocks.linear_analysis.margins import channel_disks, frequencies_about
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.support.types import Vector
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.transport.mean_axes_wiring import mean_axes_transport
from trussflow.models.transport.mission import Mission

INSTANTS = {
    "at rest": 0.0,
    "peak acceleration": 0.2113,
    "coast": 0.5,
    "peak braking": 0.7887,
    "end": 1.05,
}
"""Instants, relative to the duration of the path [-]; a quintic accelerates most at 1/2 ± 1/sqrt(12)."""

VARIATIONS: dict[str, dict[str, float]] = {
    "nominal": {},
    "gain 0.5": {"actuators": 0.5},
    "gain 0.7": {"actuators": 0.7},
    "gain 1.4": {"actuators": 1.4},
    "gain 2": {"actuators": 2.0},
    "+20 ms": {"delay": 0.02},
}
"""Variations of the loop, as arguments of `SampledLoop.closed`.

Gains apply to the feedback at constant thrust. In a simulation, the loop also corrects a lack of thrust.
"""

DELAYS = np.arange(0.0, 0.21, 0.01)
"""Delays of the search for the delay margin [s]."""

BUCKLING_RATE = 21.2
"""Unstable pole of an arm at peak thrust [1/s]."""

_STATES = [
    f"controller.estimator.{name}"
    for name in ("y", "nu", "eta", "eta_rate", "w", "posture")
]


def loop_session(backend: str = "auto") -> Session:
    """Return a session of the mean-axes loop of Case 1 without hardware, with a backend of `Session`."""
    diagram = mean_axes_transport(Mission.of_case(1), TunableTruss.accurate())
    step = LAWS["mean axes"].step
    return Session(diagram, outputs=[], step=step, backend=backend)


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
        Session of `mean_axes_transport` without hardware. For samples the truss must be a `TunableTruss`.
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


def margins_of(loop: SampledLoop) -> dict[str, Any]:
    """Return the margins of a loop.

    Returns
    -------
    dict
        ``growth``: growth rate under each of `VARIATIONS`, negative if stable [1/s]. ``disk``: smallest disk
        margin of an actuator or sensor with all other loops closed, 0 if unstable [-]. ``delay``: smallest
        delay of all commands that makes the loop unstable, infinite above `DELAYS` [s].
    """
    radii = [spectral_radius(loop.closed(**change)) for change in VARIATIONS.values()]
    return {
        "growth": np.log(radii) / loop.controller.dt,
        "disk": min_disk(loop) if radii[0] < 1.0 else 0.0,
        "delay": first_unstable(
            lambda t: spectral_radius(loop.closed(delay=t)), DELAYS
        ),
    }


def min_disk(loop: SampledLoop) -> float:
    """Return the smallest disk margin of the actuators and sensors of a stable loop [-]."""
    omega = frequencies_about(loop.continuous_poles(), 0.02, np.pi / loop.controller.dt)
    places = "actuators", "sensors"
    return min(
        float(channel_disks(loop.loop_gain(place), omega)[0].min()) for place in places
    )


def first_unstable(radius: Callable[[float], float], values: Vector) -> float:
    """Return the first value above which a loop is unstable, within 1 % of the steps; otherwise infinity.

    Parameters
    ----------
    radius : callable
        Spectral radius as function of the value [-].
    values : Vector
        Values of the search in their order [any].
    """
    if radius(values[0]) >= 1.0:
        return float(values[0])
    for stable, unstable in pairwise(values):
        if radius(unstable) < 1.0:
            continue
        while abs(unstable - stable) > 0.01 * abs(values[1] - values[0]):
            middle = (stable + unstable) / 2
            stable, unstable = (
                (middle, unstable) if radius(middle) < 1.0 else (stable, middle)
            )
        return float(stable)
    return np.inf


def margins_along(seeds: list[int]) -> xr.Dataset:
    """Return the margins at all `INSTANTS` for the truss of each seed."""
    session, plant = loop_session(), TunableTruss.accurate()
    duration = Mission.of_case(1).duration
    found = []
    for seed in seeds:
        loops = loops_along(session, duration, sample_parameters(plant, seed))
        found.append([margins_of(loop) for _, loop in loops])
    along = "seed", "instant"
    dims = {"growth": (*along, "variation"), "disk": along, "delay": along}
    return xr.Dataset(
        {
            name: (dim, [[one[name] for one in row] for row in found])
            for name, dim in dims.items()
        },
        {"seed": seeds, "instant": list(INSTANTS), "variation": list(VARIATIONS)},
    )


def max_gain_ratio(growth: float, dead_time: float) -> float:
    r"""Return the largest ratio of loop gains that one linear controller can stabilize [-].

    With actuator gains k from :math:`k_1` to :math:`k_2`, the loop is stable if the complementary
    sensitivity T has no eigenvalue :math:`1 / (1 - k)` in the right half-plane. A conformal map takes the
    rest of the plane to the unit disk, and 0 to 0. T has the eigenvalue 1 at the unstable pole p, and the
    factor :math:`e^{-\tau s}` of the dead time. By the maximum principle, for every controller,

    .. math:: \frac{k_2}{k_1} < \left(\frac{e^{p\tau} + 1}{e^{p\tau} - 1}\right)^2

    Parameters
    ----------
    growth : float
        Unstable pole p of the plant, positive [1/s].
    dead_time : float
        :math:`\tau`, from a measurement to the first measured response to it; with sampling a number of
        whole sample times, one of them for the hold [s].

    References
    ----------
    Khargonekar, Tannenbaum (1985), *Non-Euclidian metrics and the robust stabilization of systems with
    parameter uncertainty*, IEEE Transactions on Automatic Control 30 (10).
    """
    late = np.exp(growth * dead_time)
    return float(((late + 1.0) / (late - 1.0)) ** 2)

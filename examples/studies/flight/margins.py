"""Margins of the loop of the mean axes with the thrust on, at instants of its flight, for any draw.

At rest no linearization shows what the thrust does: the arms buckle under it. So a flight without noise
and rounding is stopped at an instant, and plant and controller are linearized there, commands held. Nor are
the actuators probed: a torque that turns its sign every second sample is no state to linearize at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np

from flight.sampled_loop import SampledLoop, spectral_radius
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.margins import channel_disks, frequencies_about
from trussflow.blocks.simulation.session import Session
from trussflow.models.dynamics.dynamics import TrussDynamics

INSTANTS: Mapping[str, float] = MappingProxyType(
    {"at rest": 0.0, "peak acceleration": 0.2113, "coast": 0.5, "peak braking": 0.7887, "end": 1.05}
)
"""Parts of a flight's duration [-]; a quintic's acceleration is largest at 1/2 ± 1/sqrt(12)."""

VARIATIONS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "nominal": {},
        "gain 0.5": {"actuators": 0.5},
        "gain 0.7": {"actuators": 0.7},
        "gain 1.4": {"actuators": 1.4},
        "gain 2": {"actuators": 2.0},
        "+20 ms": {"delay": 0.02},
    }
)
"""What is to be survived, as arguments of `SampledLoop.closed`: of what comes back around the loop. With the
thrust on that is harder than actuators of another gain: what thrust they lack the loop makes up in flight."""

DELAYS = np.arange(0.0, 0.21, 0.01)
"""Delays at which a limit is looked for, on the way up [s]."""

BUCKLING = 21.2
"""How fast an arm leaves under the peak of thrust [1/s]."""

_STATES = [f"controller.estimator.{name}" for name in ("y", "nu", "eta", "eta_rate", "w", "posture")]


def loops_along(
    session: Session,
    duration: float,
    parameters: Mapping[str, Any] | None = None,
    instants: Mapping[str, float] = INSTANTS,
) -> Iterator[tuple[str, SampledLoop]]:
    """Fly, and yield the loop at each instant on the way: draws by parameters need no new compilation.

    Parameters
    ----------
    session : Session
        Of `mean_axes_transport` without hardware; for draws its truss is a `TunableTruss`.
    duration : float
        Of the path [s].
    parameters : mapping, optional
        Of this flight, by ``"block.parameter"``, such as ``"truss.mass"`` [units as declared].
    instants : mapping
        Names, and parts of the duration, rising [-].

    Raises
    ------
    DivergenceError
        If the flight does not come so far.
    """
    session.start(parameters={**(parameters or {}), "controller.probe.strength": 0.0})
    tick = session.prepared.plan.system.clocks[0].period
    for name, part in instants.items():
        session.advance(float(round(part * duration / tick) * tick))
        yield name, flown_loop(session)


def flown_loop(session: Session) -> SampledLoop:
    """Return plant and controller of the loop of the mean axes, linearized where a session stands.

    Parameters
    ----------
    session : Session
        Of `mean_axes_transport` without hardware, started.
    """
    rigid = session.prepared.plan.memory.entries["controller.estimator", "y"].shape[0]
    measured = [f"truss.{name}[0:{rigid}]" for name in ("q", "v")]
    return SampledLoop.of(session, "controller.allocation.command", _STATES, measured)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopMargins:
    """Margins of one loop.

    Attributes
    ----------
    radii : dict
        Spectral radius under each variation, below 1 if that is survived [1].
    disk : float
        Least disk margin of a single actuator or sensor, all others closed [1]; 0 if the loop is unstable.
    weakest : str
        Which that is.
    frequency : float
        Where it is least [rad/s].
    delay : float
        First delay of all commands that is not survived, infinite if none of `DELAYS` is not [s].
    """

    radii: dict[str, float]
    disk: float
    weakest: str
    frequency: float
    delay: float

    @classmethod
    def of(cls, loop: SampledLoop) -> LoopMargins:
        """Return the margins of a loop.

        Parameters
        ----------
        loop : SampledLoop
            From `loops_along`, say.
        """
        radii = {name: spectral_radius(loop.closed(**change)) for name, change in VARIATIONS.items()}
        if radii["nominal"] >= 1.0:
            return cls(radii=radii, disk=0.0, weakest="all", frequency=np.nan, delay=0.0)
        least = min(
            (float(disk), f"{where[:-1]} {k}", float(at))
            for where, each in disks(loop).items()
            for k, (disk, at) in enumerate(each)
        )
        delay = first_limit(lambda t: spectral_radius(loop.closed(delay=t)), DELAYS)
        return cls(radii=radii, disk=least[0], weakest=least[1], frequency=least[2], delay=delay)


def disks(loop: SampledLoop) -> dict[str, Vector]:
    """Return disk margin and frequency [1, rad/s] of each of the actuators, and of the sensors.

    Parameters
    ----------
    loop : SampledLoop
        Stable.
    """
    omega = frequencies_about(loop.continuous_poles(), 0.02, np.pi / loop.controller.dt)
    return {
        where: np.stack(channel_disks(loop.loop_gain(where), omega), axis=-1)
        for where in ("actuators", "sensors")
    }


def first_limit(radius: Callable[[float], float], values: Vector) -> float:
    """Return the first value beyond which a loop is not stable, to 1 % of the way; infinite without.

    Parameters
    ----------
    radius : callable
        Spectral radius by the value [1].
    values : Vector
        Where to look, one after the other, up or down [any].
    """
    if radius(values[0]) >= 1.0:
        return float(values[0])
    for stable, unstable in pairwise(values):
        if radius(unstable) < 1.0:
            continue
        while abs(unstable - stable) > 0.01 * abs(values[1] - values[0]):
            middle = (stable + unstable) / 2
            stable, unstable = (middle, unstable) if radius(middle) < 1.0 else (stable, middle)
        return float(stable)
    return np.inf


def greatest_gain_ratio(growth: float, dead_time: float) -> float:
    r"""Return how far apart gains can be, at most, that one linear controller stands [1].

    With k times what all actuators do, k from :math:`k_1` to :math:`k_2`, the loop is stable if the
    complementary sensitivity T has nowhere on the right an eigenvalue :math:`1 / (1 - k)`. A conformal map
    takes what is left of the plane to the unit disk, and 0 to 0. T has the eigenvalue 1 at the unstable pole
    p and the factor :math:`e^{-\tau s}`, as nothing comes back before. So, by the maximum principle,

    .. math:: \frac{k_2}{k_1} < \left(\frac{e^{p\tau} + 1}{e^{p\tau} - 1}\right)^2

    whatever the controller, and however little else it does.

    Parameters
    ----------
    growth : float
        p, of an unstable motion of the plant, above 0 [1/s].
    dead_time : float
        :math:`\tau`, from a measurement until what moves because of it is measured: with sampling whole
        sample times, one of them for the hold [s].

    References
    ----------
    Khargonekar, Tannenbaum (1985), *Non-Euclidian metrics and the robust stabilization of systems with
    parameter uncertainty*, IEEE Transactions on Automatic Control 30 (10).
    """
    late = np.exp(growth * dead_time)
    return float(((late + 1.0) / (late - 1.0)) ** 2)


def worst(found: Sequence[LoopMargins]) -> LoopMargins:
    """Return the worst of each number of several loops.

    Parameters
    ----------
    found : sequence of LoopMargins
        At least one.
    """
    least = min(found, key=lambda each: each.disk)
    radii = {name: max(each.radii[name] for each in found) for name in VARIATIONS}
    return replace(least, radii=radii, delay=min(each.delay for each in found))


def with_arms(dynamics: TrussDynamics, *, mass: float = 1.0, length: float = 1.0) -> TrussDynamics:
    """Return dynamics with other arms, to be believed: hands and links, bases as they are.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots.
    mass, length : float
        Factors, above 0 [-].
    """
    arms = (
        replace(
            arm,
            masses=mass * arm.masses,
            static_moments=mass * length * arm.static_moments,
            inertias=mass * length**2 * arm.inertias,
            joint_origins=length * arm.joint_origins,
            base_origin=length * arm.base_origin,
        )
        for arm in dynamics.arms
    )
    return replace(dynamics, arms=tuple(arms))

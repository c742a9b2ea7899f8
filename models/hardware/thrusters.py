"""Thrusters of a base, throttled or pulsed."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.clock import exact
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.library.algebra import Function, MatrixGain, Sum
from trussflow.blocks.library.continuous import Integrator
from trussflow.blocks.library.discrete import UnitDelay
from trussflow.blocks.library.nonlinear import Quantizer, Saturation
from trussflow.blocks.support.types import Array, Vector
from trussflow.models.errors import ModelError
from trussflow.models.validation import check_number, frozen_array, unit_vectors

STANDARD_GRAVITY = 9.80665
"""g_0 of the specific impulse in seconds [m/s^2]."""

WRENCH_UNITS = ("N",) * 3 + ("N*m",) * 3
WRENCH_PARTS = (
    "force along x",
    "force along y",
    "force along z",
    *(f"torque about {a}" for a in "xyz"),
)

# Tolerance of wrenches and thrusts, relative: round-off of a 6 x m pseudo-inverse.
_ROUND_OFF = 1e-9


class ThrusterSet(Diagram):
    r"""Thrusters of a base: from the commanded wrench to the thrusts and their wrench.

    With B = [directions; positions × directions] the wrench of thrusts f ≥ 0 is B f. Each unit
    wrench and its opposite have one non-negative solution of least norm. A commanded wrench w is
    the combination of these, which is exact. Opposed thrusters at one place then subtract their
    common thrust:

    .. math:: f' = S^+ \max(w, 0) + S^- \max(-w, 0), \qquad f_i = f'_i - \min(f'_i, f'_{i'})

    Each thrust is limited and rounded to the quantum once a period. The wrench error of rounding and
    minimum impulse is added in the next period (sigma-delta modulation), so that the impulse follows
    the command. Saturation loses impulse. With a `tick` the thrusters are on or off, and the thrust
    of a period becomes one pulse of whole ticks (pulse-width modulation).

    Parameters
    ----------
    positions, directions : array_like, shape (m, 3)
        Positions of the thrusters from the centroid [m], and directions of their force on the base [-], in
        base axes.
    maximum : float
        Thrust of each fully open thruster [N].
    period : float
        Period of the modulation [s].
    quantum : float, optional
        Step of the thrust [N]; for pulsed thrusters it is ``maximum * tick / period`` and must be omitted.
    minimum_impulse : float
        Minimum impulse in a period, below which there is none [N·s].
    tick : float, optional
        Time resolution of pulses [s]; by default thrusters are throttled and hold their thrust.
    on_delay, off_delay : float
        Opening and closing delay of the valves, whole numbers of ticks [s].
    specific_impulse : float
        Specific impulse of the propellant [s].
    torques : bool
        Whether the thrusters make torques besides forces; if not, a commanded torque is ignored.

    Raises
    ------
    ModelError
        If a direction is not a unit vector, a limit or time is out of range, or no thrusts f ≥ 0 make some
        force or torque alone.

    Notes
    -----
    Ports: `demand`, the commanded wrench; `effectiveness`, the health from 0 (failed) to 1 (default);
    `thrust`; `wrench`; `ordered`, the wrench of healthy thrusters; and the `propellant` that these would
    use, with :math:`\dot m = \sum f / (I_{sp} g_0)`: a spacecraft counts what it orders, as tanks have no
    gauge in weightlessness. The modulation does not depend on the health.

    Thrusters in opposed pairs use the least possible propellant. Others use more, because each component
    of the wrench is made separately: 2.5 times as much for 16 scattered ones (median over wrenches).

    Attributes
    ----------
    reach : Vector, shape (6,)
        Largest force and torque along each axis in either direction, alone [N, N·m]; infinite for
        ignored torques.

    References
    ----------
    Sidi (1997), *Spacecraft Dynamics and Control*, chapter 9 (thrusters, pulse-width modulation);
    Lawson, Hanson (1974), *Solving Least Squares Problems*, chapter 23 (non-negative solutions).
    """

    def __init__(
        self,
        positions: npt.ArrayLike,
        directions: npt.ArrayLike,
        *,
        maximum: float,
        period: float,
        specific_impulse: float,
        quantum: float | None = None,
        minimum_impulse: float = 0.0,
        tick: float | None = None,
        on_delay: float = 0.0,
        off_delay: float = 0.0,
        torques: bool = True,
    ) -> None:
        check_number(
            "thrusters",
            maximum=maximum,
            period=period,
            specific_impulse=specific_impulse,
        )
        check_number("thrusters", zero=True, minimum_impulse=minimum_impulse)
        valves = {"on_delay": on_delay, "off_delay": off_delay}
        self.matrix = wrench_matrix(positions, directions)
        self.count = self.matrix.shape[1]
        self.shares = _shares(self.matrix, 6 if torques else 3)
        # Partner of each thruster in an opposed pair at one place; each has at most one.
        opposed = (
            np.abs(self.matrix.T[:, None] + self.matrix.T).max(axis=2) < _ROUND_OFF
        )
        self.partner = opposed.argmax(axis=1)
        self.paired = opposed.any(axis=1) & (
            self.partner[self.partner] == np.arange(self.count)
        )
        self.exhaust_speed = specific_impulse * STANDARD_GRAVITY
        if (tick is None) == (quantum is None) or (
            tick is None and (on_delay or off_delay)
        ):
            raise ModelError(
                "thrusters need a quantum (throttled), or a tick (pulsed, with delays)"
            )
        pulses = (
            None
            if tick is None
            else Pulses(self.count, maximum, period, tick, **valves)
        )
        step: Any = maximum / pulses.ticks if pulses else quantum
        check_number("thrusters", quantum=step)
        # rounding must not go beyond the limit
        full = step * np.floor(maximum / step + _ROUND_OFF)
        if not full:
            raise ModelError(
                f"thrusters: quantum is {step:g} N; it must be at most maximum, {maximum:g} N"
            )
        with np.errstate(divide="ignore"):
            # Six positive, then six negative unit wrenches: the weaker direction
            # counts.
            self.reach = (full / self.shares.max(axis=0)).reshape(2, 6).min(axis=0)
        super().__init__("thrusters")
        thrust = {"thrust": Output(self.count, unit="N")}
        total, share, limit, steps, fire, tank = self.add(
            total=Sum("++"),
            share=Function(
                self.thrusts, {"wrench": Input(6, unit=WRENCH_UNITS)}, thrust
            ),
            limit=Saturation(np.zeros(self.count), np.full(self.count, full)),
            steps=Quantizer(step, period, smallest=minimum_impulse / period),
            fire=Function(
                self._fired,
                {
                    "valves": Input(self.count, unit="N"),
                    "effectiveness": Input(default=1.0),
                },
                {
                    **thrust,
                    "wrench": Output(6, unit=WRENCH_UNITS),
                    "ordered": Output(6, unit=WRENCH_UNITS),
                    "flow": Output(unit="kg/s"),
                },
            ),
            tank=Integrator(unit="kg"),
        )
        back, residue = self.add(
            back=MatrixGain(self.matrix, input_unit="N", output_unit=WRENCH_UNITS),
            residue=UnitDelay(period, shape=6),
        )
        limit.y - steps.y >> back >> residue >> total.u2
        total >> share.wrench
        share.thrust >> limit >> steps
        (steps >> self.add(pulses=pulses) if pulses else steps).y >> fire.valves
        fire.flow >> tank
        self.expose(demand=total.u1, effectiveness=fire.effectiveness)
        self.expose(
            thrust=fire.thrust,
            wrench=fire.wrench,
            ordered=fire.ordered,
            propellant=tank.y,
        )

    @classmethod
    def axial(cls, **settings: Any) -> Self:
        """Return six thrusters through the centroid, which make any force and no torque.

        Parameters
        ----------
        **settings
            Arguments of `ThrusterSet`.
        """
        return cls(
            np.zeros((6, 3)),
            np.concatenate([np.eye(3), -np.eye(3)]),
            torques=False,
            **settings,
        )

    @classmethod
    def pairs(cls, lever: float, **settings: Any) -> Self:
        """Return twelve thrusters in opposed pairs, which make any force and torque.

        Two pairs act along each axis, at both ends of a lever along the next axis.

        Parameters
        ----------
        lever : float
            Distance of each thruster from the centroid [m].
        **settings
            Arguments of `ThrusterSet`.
        """
        check_number("thrusters", lever=lever)
        axes = np.eye(3)
        positions = np.kron(
            np.roll(axes, 1, axis=1), lever * np.array([[1], [1], [-1], [-1]])
        )
        directions = np.kron(axes, [[1], [-1], [1], [-1]])
        return cls(positions, directions, **settings)

    def thrusts(self, wrench: Array) -> Array:
        """Return the thrusts for a wrench, before limits and rounding [N].

        Parameters
        ----------
        wrench : array, shape (6,)
            Force and torque about the centroid, base axes [N, N·m].
        """
        shared = self.shares @ np.concatenate(
            [np.maximum(wrench, 0.0), np.maximum(-wrench, 0.0)]
        )
        common = np.minimum(shared, shared[self.partner])
        return shared - np.where(self.paired, common, 0.0)

    def _fired(
        self, valves: Array, effectiveness: Array
    ) -> tuple[Array, Array, Array, Array]:
        thrust = effectiveness * valves
        return (
            thrust,
            self.matrix @ thrust,
            self.matrix @ valves,
            np.sum(valves) / self.exhaust_speed,
        )


class Pulses(Block):
    r"""Pulse-width modulation of thrusts, with delays of the valves.

    In period j a thruster is fully open for the first :math:`n f_j / f_{max}` of n ticks. A valve
    opens `on_delay` after its command and closes `off_delay` after it.

    Parameters
    ----------
    size : int
        Number of thrusters [-].
    maximum : float
        Thrust of an open thruster [N].
    period, tick : float
        Period of the pulses, and their time resolution [s].
    on_delay, off_delay : float
        Opening and closing delay of the valves, whole numbers of ticks [s].

    Raises
    ------
    ModelError
        If a time is negative or not a whole number of ticks.

    Notes
    -----
    A pulse grows by `off_delay` minus `on_delay`. A pulse shorter than `on_delay` minus `off_delay` is lost.
    """

    thrust = Input("size", unit="N", meaning="average thrust over a period")
    y = Output("size", unit="N", meaning="current thrust")
    past = State(
        ("memory", "size"),
        unit="N",
        meaning="previous commands of the valves, latest first",
    )
    maximum = Parameter(unit="N", above=0.0, meaning="thrust of an open thruster")

    def __init__(
        self,
        size: int,
        maximum: float,
        period: float,
        tick: float,
        *,
        on_delay: float = 0.0,
        off_delay: float = 0.0,
    ) -> None:
        check_number("pulses", maximum=maximum, period=period, tick=tick)
        check_number("pulses", zero=True, on_delay=on_delay, off_delay=off_delay)
        counted = []
        for name, time in (
            ("period", period),
            ("on_delay", on_delay),
            ("off_delay", off_delay),
        ):
            ticks = exact(time) / exact(tick)
            if ticks.denominator != 1:
                raise ModelError(
                    f"pulses: {name} is {time:g} s; it must be a whole number of ticks of {tick:g} s"
                )
            counted.append(int(ticks))
        self.ticks, self.opening, self.closing = counted
        self.memory, self.size = max(self.opening, self.closing, 1), size
        super().__init__(maximum=maximum)
        self.sampled(tick)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the current thrusts."""
        # If the closing delay is the longer one, any open command between both delays ago keeps a valve
        # open; otherwise any closed one keeps it closed.
        first, last = sorted((self.opening, self.closing))
        between = self._commands(t, x, u, p)[first : last + 1]
        return {
            "y": (np.max if self.closing >= self.opening else np.min)(between, axis=0)
        }

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Store the commands of the valves."""
        return {"past": self._commands(t, x, u, p)[:-1]}

    def _commands(self, t: Array, x: Signals, u: Signals, p: Signals) -> Array:
        """Return current and previous commands of the valves, latest first."""
        tick = np.mod(np.rint(t / self.sample_time), self.ticks)
        now = np.where(
            tick < np.rint(u.thrust / p.maximum * self.ticks), p.maximum, 0.0
        )
        return np.concatenate([np.reshape(now, (1, self.size)), x.past])


def wrench_matrix(positions: npt.ArrayLike, directions: npt.ArrayLike) -> Vector:
    r"""Return B, whose columns are the wrenches of unit thrusts.

    .. math:: B = [d_j;\; r_j \times d_j]

    Parameters
    ----------
    positions, directions : array_like, shape (m, 3)
        Positions of the thrusters from the centroid [m], and directions of their force on the base [-], in
        base axes.

    Returns
    -------
    array, shape (6, m)
        Matrix B [1; m].

    Raises
    ------
    ModelError
        If there are no thrusters, the shapes differ, or a direction is not a unit vector.
    """
    ways = unit_vectors("thrusters: direction", directions)
    places = frozen_array("thrusters: positions", positions, (len(ways), 3))
    return np.concatenate([ways, np.cross(places, ways)], axis=1).T


def _shares(matrix: Vector, parts: int) -> Vector:
    """Return the non-negative thrusts of least norm for each unit wrench, then for each negative one.

    Bounded least squares with a large weight of the equations gives the active thrusters; their
    pseudo-inverse is then exact. (SciPy's `nnls` is wrong for two equal thrusters.)
    """
    from scipy.optimize import lsq_linear

    count, weight = matrix.shape[1], 1e5 / np.abs(matrix).max()
    weighted, columns = np.concatenate([weight * matrix, np.eye(count)]), []
    for sign in (1.0, -1.0):
        for k in range(6):
            wanted = sign * np.eye(6)[k] * (k < parts)
            aim = np.append(weight * wanted, np.zeros(count))
            found = lsq_linear(weighted, aim, (0.0, np.inf), method="bvls", tol=1e-14).x
            active = found > 1e-6 * found.max(initial=0.0)
            thrusts = np.where(active, np.linalg.pinv(matrix * active) @ wanted, 0.0)
            if (
                np.abs(matrix @ thrusts - wanted).max() > _ROUND_OFF
                or thrusts.min() < -_ROUND_OFF
            ):
                way = "positive" if sign > 0 else "negative"
                raise ModelError(
                    f"these thrusters make no {way} {WRENCH_PARTS[k]} alone, since thrusts are not negative; "
                    "add thrusters, or use torques=False for forces only"
                )
            columns.append(np.maximum(thrusts, 0.0))
    return np.stack(columns, axis=1)

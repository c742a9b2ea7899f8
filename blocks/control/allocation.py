"""Allocation of commands to redundant actuators."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.control.bounded_least_squares import bounded_least_squares
from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.piecewise import limited
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import finite_array, is_whole, shown
from trussflow.blocks.tracing.linear_algebra import (
    solve_positive_definite,
    weighted_gramian,
)


class Allocation(Block):
    """Base of blocks that share a demand between actuators.

    Parameters
    ----------
    demands : int
        Number of components of the demand.
    weights : array_like, shape (n,)
        Cost of each actuator, above 0 [any].
    demand_unit, command_unit : str, tuple of str or None
        Units of demand and command, or one per element; None leaves them unchecked.
    **parameters : array_like
        Further parameters of the block.

    Raises
    ------
    BlockError
        If there is no demand, or weights are no vector.
    """

    demand = Input(
        "demands", unit=Attribute("demand_unit"), meaning="what is to be achieved"
    )
    effectiveness = Input(
        ("demands", "actuators"),
        meaning="what each actuator contributes to each demand",
    )
    command = Output(
        "actuators", unit=Attribute("command_unit"), meaning="actuator commands"
    )
    weights = Parameter(shape="actuators", above=0.0, meaning="cost of each actuator")

    def __init__(
        self,
        demands: int,
        weights: npt.ArrayLike,
        *,
        demand_unit: Unit = None,
        command_unit: Unit = None,
        **parameters: npt.ArrayLike,
    ) -> None:
        owner = type(self).__name__
        shape = finite_array(f"parameter 'weights' of {owner}", weights).shape
        if len(shape) != 1 or shape == (0,):
            raise BlockError(
                f"{owner} needs one weight per actuator; got weights of shape {shape}"
            )
        if not is_whole(demands) or demands < 1:
            raise BlockError(
                f"{owner} cannot meet {shown(demands)} demands: there must be at least one"
            )
        self.demands, (self.actuators,) = demands, shape
        self.demand_unit, self.command_unit = demand_unit, command_unit
        super().__init__(weights=weights, **parameters)


class WeightedAllocation(Allocation):
    r"""Share a demand between redundant actuators with the least weighted effort.

    .. math:: Q = W^{-1} P^T (P W^{-1} P^T)^{-1} u

    minimizes :math:`Q^T W Q` subject to :math:`P Q = u`. P must have full row rank at all times.

    Parameters
    ----------
    demands : int
        Number of components of the demand u, here m.
    weights : array_like, shape (n,)
        Diagonal of W, all above 0 [any]; n is the number of actuators. A larger weight makes
        an actuator do less.
    demand_unit, command_unit : str, tuple of str or None
        Units of u and Q, or one per element; None leaves them unchecked.

    Raises
    ------
    BlockError
        If there are fewer actuators than demands.
    ParameterError
        If a weight is not above 0.

    References
    ----------
    Li, Wei, Chen (2026), *Anti-Disturbance Trajectory Tracking Control of Large Space
    Flexible Truss by Four Space Robots*, eq. (64).
    """

    _symbol = Symbol("min Q^(T)W Q\nP Q = u")

    def __init__(
        self,
        demands: int,
        weights: npt.ArrayLike,
        *,
        demand_unit: Unit = None,
        command_unit: Unit = None,
    ) -> None:
        super().__init__(
            demands, weights, demand_unit=demand_unit, command_unit=command_unit
        )
        if demands > self.actuators:
            raise BlockError(
                f"WeightedAllocation cannot meet {demands} demands with {self.actuators} actuators: "
                "there must be as many"
            )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the commands."""
        # The multipliers solve (P W^-1 P^T) λ = u, and Q = W^-1 P^T λ. W is diagonal,
        # so that its inverse is a division, and `λ @ P` is P^T λ.
        gramian = weighted_gramian(u.effectiveness, 1.0 / p.weights)
        multipliers = solve_positive_definite(gramian, u.demand)
        return {"command": (multipliers @ u.effectiveness) / p.weights}


class BoundedAllocation(Allocation):
    r"""Share a demand between actuators with limits, with least weighted error and effort.

    .. math::
        \min_{l \le Q \le h} \; (P Q - u)^T G^{-1} (P Q - u) + \sum_k w_k^2 (Q_k - Q_{0k})^2

    With very small weights w, a feasible demand is met, and an infeasible demand is met with the least error
    in the norm of :math:`G^{-1}`. If G is the mass matrix and u the mass matrix times the commanded
    acceleration, this error is the kinetic energy of the missing motion. If squared weights differ by more
    than :math:`10^{10}`, digits are lost when a demand cannot be met. A secondary objective is one more row
    of u and P, with a larger diagonal element of G.

    Limits are inputs. Both limits of a failed actuator are zero, both limits of a jammed actuator are its
    output. The command never exceeds the limits, and exists for any number of active limits. It is NaN if a
    lower limit exceeds its upper limit, a diagonal element of G is not above 0, or an input is NaN. Derivatives
    hold the active limits active. An estimator that reads the command instead of the demand does not wind up.

    Parameters
    ----------
    demands : int
        Number of components of the demand u.
    weights : array_like, shape (n,)
        w, all above 0 [any]; n is the number of actuators.
    demand_unit, command_unit : str, tuple of str or None
        Units of u and Q, or one per element; None leaves them unchecked.

    Raises
    ------
    BlockError
        If there is no demand, or weights are no vector.
    ParameterError
        If a weight is not above 0.

    References
    ----------
    Härkegård (2002), *Efficient active set algorithms for solving constrained least squares problems
    in aircraft control allocation*, 41st IEEE Conference on Decision and Control, for the cost.
    Bodson (2002), *Evaluation of optimization methods for control allocation*, Journal of Guidance,
    Control, and Dynamics 25 (4), 703-711. The algorithm is that of `bounded_least_squares`.
    """

    _symbol = Symbol("min ‖P Q − u‖\nl ≤ Q ≤ h")
    spread = Input(("demands", "demands"), meaning="G: errors count by its inverse")
    preferred = Input(
        "actuators",
        unit=Attribute("command_unit"),
        default=0.0,
        meaning="command of no cost",
    )
    lower = Input("actuators", unit=Attribute("command_unit"), meaning="lower limits")
    upper = Input("actuators", unit=Attribute("command_unit"), meaning="upper limits")
    missed = Output(
        "demands", unit=Attribute("demand_unit"), meaning="demand less what is achieved"
    )
    saturated = Output(
        "actuators", unit="1", meaning="1 where a command is at a limit, 0 elsewhere"
    )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the commands, the missed part of the demand, and the active limits."""
        lower, upper = self._limits(x, u, p)
        command, missed = bounded_least_squares(
            u.effectiveness, u.spread, u.demand, p.weights, u.preferred, lower, upper
        )
        # The solver clips its result, so that a command at a limit equals it exactly.
        at_limit = np.logical_or(command <= lower, command >= upper)
        saturated = np.where(at_limit, 1.0, 0.0)
        return {"command": command, "missed": missed, "saturated": saturated}

    def _limits(self, x: Signals, u: Signals, p: Signals) -> tuple[Array, Array]:
        """Return the limits of the commands at this instant."""
        return u.lower, u.upper


class RateBoundedAllocation(BoundedAllocation):
    r"""`BoundedAllocation` with rate limits of the commands between samples.

    .. math:: \mathrm{clip}(Q_{k-1} - r T_s, l, h) \le Q_k \le \mathrm{clip}(Q_{k-1} + r T_s, l, h)

    Limits take precedence over rates: a command follows a limit that jumps immediately.

    Parameters
    ----------
    demands : int
        Number of components of the demand u.
    weights : array_like, shape (n,)
        w, all above 0 [any]; n is the number of actuators.
    rates : array_like, shape (n,)
        r, all at least 0 [unit of the command/s].
    sample_time : float
        T_s > 0 [s].
    **others
        As for `BoundedAllocation`.

    Raises
    ------
    BlockError
        As for `BoundedAllocation`, or if the sample time is not above 0.
    ParameterError
        If a weight is not above 0, or a rate below 0.
    """

    rates = Parameter(
        shape="actuators",
        minimum=0.0,
        meaning="largest change of each command per second",
    )
    previous = State("actuators", meaning="commands of the sample before")

    def __init__(
        self,
        demands: int,
        weights: npt.ArrayLike,
        rates: npt.ArrayLike,
        sample_time: float,
        **others: Any,
    ) -> None:
        super().__init__(demands, weights, rates=rates, **others)
        self.sampled(sample_time)

    def _limits(self, x: Signals, u: Signals, p: Signals) -> tuple[Array, Array]:
        # If the previous command lies beyond a limit that has jumped, both ends are
        # clipped to this limit.
        reach = p.rates * self.sample_time
        lower, upper = (
            limited(x.previous + r, u.lower, u.upper) for r in (-reach, reach)
        )
        return lower, upper

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Store the commands."""
        return {"previous": self.output(t, x, u, p)["command"]}

"""Allocation of commands to redundant actuators."""

from __future__ import annotations

import numpy.typing as npt

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals
from trussflow.blocks.framework.errors import BlockError
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.framework.validation import finite_array, is_whole, shown
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite, weighted_gramian


class WeightedAllocation(Block):
    r"""Share a demand between more actuators than it has components, at least weighted effort.

    .. math:: Q = W^{-1} P^T (P W^{-1} P^T)^{-1} u

    is the Q with the least :math:`Q^T W Q` of all with :math:`P Q = u`. P must have full
    row rank at all times.

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

    demand = Input("demands", unit=Attribute("demand_unit"), meaning="what is to be achieved")
    effectiveness = Input(("demands", "actuators"), meaning="what each actuator contributes to each demand")
    command = Output("actuators", unit=Attribute("command_unit"), meaning="actuator commands")
    weights = Parameter(shape="actuators", above=0.0, meaning="cost of each actuator")

    def __init__(
        self, demands: int, weights: npt.ArrayLike, *, demand_unit: Unit = None, command_unit: Unit = None
    ) -> None:
        shape = finite_array("parameter 'weights' of WeightedAllocation", weights).shape
        if len(shape) != 1:
            raise BlockError(
                f"WeightedAllocation needs one weight per actuator; got weights of shape {shape}"
            )
        if not is_whole(demands) or not 1 <= demands <= shape[0]:
            raise BlockError(
                f"WeightedAllocation cannot meet {shown(demands)} demands with {shape[0]} actuators: "
                "there must be at least one demand, and as many actuators"
            )
        self.demands, self.actuators = demands, shape[0]
        self.demand_unit, self.command_unit = demand_unit, command_unit
        super().__init__(weights=weights)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the commands."""
        gramian = weighted_gramian(u.effectiveness, 1.0 / p.weights)
        multipliers = solve_positive_definite(gramian, u.demand)
        return {"command": (multipliers @ u.effectiveness) / p.weights}

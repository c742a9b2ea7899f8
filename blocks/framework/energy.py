"""Energy balance of a block: ports of supplied and delivered power, stored and dissipated energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from trussflow.blocks.errors import BlockError
from trussflow.blocks.support.validation import shown

if TYPE_CHECKING:
    from trussflow.blocks.framework.port import Port

PowerPair = tuple["Port | str", "Port | str"]
"""Two ports whose product is a power: force and velocity, torque and rate, voltage and current."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EnergyAccount:
    r"""Declare the energy balance of a block (as a class attribute named ``energy_account``).

    .. math:: \int \sum_{supplied} e^T f - \sum_{delivered} e^T f \; dt = \Delta E + \int D \; dt

    Names of ports are those in the block, such as ``"force"``. In an account that is an argument of
    `energy_audit`, they are those in the diagram, such as ``"plant.force"``, or ports.

    Attributes
    ----------
    supplied, delivered : sequence of pairs of ports
        Port pairs whose power enters or leaves the block. The ports of a pair have the same number of
        elements, and the unit of their product is W, if units are declared.
    stored : port, optional
        Energy stored in the block [J].
    dissipated : port, optional
        Dissipated power [W], or dissipated energy [J] if the unit of the port is an energy.

    Raises
    ------
    BlockError
        If `supplied` or `delivered` is not a sequence of pairs.
    """

    supplied: Sequence[PowerPair] = ()
    delivered: Sequence[PowerPair] = ()
    stored: Port | str | None = None
    dissipated: Port | str | None = None

    def __post_init__(self) -> None:
        given: tuple[object, ...] = (*self.supplied, *self.delivered)
        for pair in given:
            if not (isinstance(pair, tuple) and len(pair) == 2):
                raise BlockError(
                    f"{shown(pair)} is no pair of ports; give tuples: [('force', 'velocity')]"
                )

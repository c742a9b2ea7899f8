"""What a block says of its energy: through which pairs of ports power comes and goes, and where it stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from trussflow.blocks.framework.errors import BlockError
from trussflow.blocks.framework.units import mismatch
from trussflow.blocks.framework.validation import shown

if TYPE_CHECKING:
    from trussflow.blocks.framework.block import Block
    from trussflow.blocks.framework.port import Port

PowerPair = tuple["Port | str", "Port | str"]
"""Two ports whose product is a power: force and velocity, torque and rate, voltage and current."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EnergyAccount:
    r"""Declare what should hold of the energy of a block (as a class attribute named ``energy_account``).

    .. math:: \int \sum_{supplied} e^T f - \sum_{delivered} e^T f \; dt = \Delta E + \int D \; dt

    Ports are named as in the block, ``"force"``; where an account is given to `energy_audit`, as in the
    diagram, ``"plant.force"``, or as ports.

    Attributes
    ----------
    supplied, delivered : sequence of pairs of ports
        Pairs through which power comes in, and goes out. They have equally many elements, and the unit of
        the product is W, as far as units are declared.
    stored : port, optional
        The energy in the block [J].
    dissipated : port, optional
        What is lost: a power [W], or, where its unit says so, the energy lost so far [J].

    Raises
    ------
    BlockError
        If what is supplied or delivered is no sequence of pairs.
    """

    supplied: Sequence[PowerPair] = ()
    delivered: Sequence[PowerPair] = ()
    stored: Port | str | None = None
    dissipated: Port | str | None = None

    def __post_init__(self) -> None:
        given: tuple[object, ...] = (*self.supplied, *self.delivered)
        for pair in given:
            if not (isinstance(pair, tuple) and len(pair) == 2):
                raise BlockError(f"{shown(pair)} is no pair of ports; give tuples: [('force', 'velocity')]")

    def of(self, block: Block) -> EnergyAccount:
        """Return the account with ports of a `block` in the place of their names."""
        return EnergyAccount(
            supplied=[(block.port(str(e)), block.port(str(f))) for e, f in self.supplied],
            delivered=[(block.port(str(e)), block.port(str(f))) for e, f in self.delivered],
            stored=self.stored and block.port(str(self.stored)),
            dissipated=self.dissipated and block.port(str(self.dissipated)),
        )


def check_pair(effort: Port, flow: Port) -> None:
    """Refuse two ports whose product is no power in W, as far as their units are known.

    Parameters
    ----------
    effort, flow : Port
        The ports.

    Raises
    ------
    BlockError
        If so.
    """
    cannot = f"{effort.describe()} and {flow.describe()} are no power pair:"
    units = effort.element_units(), flow.element_units()
    if len(units[0]) != len(units[1]):
        raise BlockError(f"{cannot} they have {len(units[0])} and {len(units[1])} elements")
    for first, second in zip(*units, strict=True):
        product = f"({first or 1})*({second or 1})"
        if first is not None and second is not None and (fault := mismatch(product, "W")):
            raise BlockError(f"{cannot} of their product, {fault}")

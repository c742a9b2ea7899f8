"""What wires make of a block: it stands for its only port."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from trussflow.blocks.framework.errors import NameLookupError
from trussflow.blocks.framework.port import Input, Output, Port
from trussflow.blocks.framework.wired import Wired

if TYPE_CHECKING:
    from trussflow.blocks.framework.block import Block


class PortOwner(Wired):
    """Base of blocks: its ports, and wires to and from the only one.

    Attributes
    ----------
    ports : dict of str to Port
        All ports, in order of declaration.
    path : str
        Name in messages.
    """

    ports: dict[str, Port]

    @property
    def path(self) -> str:
        """Name in messages."""
        raise NotImplementedError

    def inputs(self) -> list[Port]:
        """Return the input ports in order of declaration."""
        return [p for p in self.ports.values() if isinstance(p.declaration, Input)]

    def outputs(self) -> list[Port]:
        """Return the output ports in order of declaration."""
        return [p for p in self.ports.values() if isinstance(p.declaration, Output)]

    def only_input(self) -> Port:
        """Return the input of a block that has exactly one."""
        return self._only(self.inputs(), "input")

    def only_output(self) -> Port:
        """Return the output of a block that has exactly one."""
        return self._only(self.outputs(), "output")

    def _only(self, ports: list[Port], kind: str) -> Port:
        if len(ports) != 1:
            raise NameLookupError(
                f"'{self.path}' has {len(ports)} {kind}s "
                f"({', '.join(p.name for p in ports) or 'none'}); name the one to wire"
            )
        return ports[0]

    def __rshift__(self, other: Port | Block) -> Block:
        """Wire the only output of this block; see `Port`."""
        return self.only_output() >> other

    def __rrshift__(self, other: Any) -> Block:
        """Refuse to wire what is no port; see `Port`."""
        block: Block = other >> self.only_input()
        return block

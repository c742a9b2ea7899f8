"""Ports and declarations of a block, and connections to its only input or output."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar, final

from trussflow.blocks.errors import NameLookupError
from trussflow.blocks.framework.declarations import Event, State
from trussflow.blocks.framework.port import Input, Output, Port
from trussflow.blocks.framework.signal_operators import Wired

if TYPE_CHECKING:
    from trussflow.blocks.framework.block import Block
    from trussflow.blocks.framework.diagram import Diagram


_Kind = TypeVar("_Kind", bound=State | Event)


class PortOwner(Wired):
    """Base of blocks: declarations, ports, and connections of the only input or output.

    Attributes
    ----------
    ports : dict of str to Port
        All ports, in order of declaration.
    path : str
        Name in messages.
    """

    _declared: Mapping[str, Any] = MappingProxyType({})
    """Declarations by name: those of the class, or of the instance if they depend on its arguments."""

    ports: dict[str, Port]

    @property
    def path(self) -> str:
        """Name in messages."""
        raise NotImplementedError

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.__dict__.get("ports", ())]

    @final
    def declared(self, kind: type[_Kind]) -> dict[str, _Kind]:
        """Return the declarations of a `kind`, such as `Mode` or `Event`, by name."""
        return {n: d for n, d in self._declared.items() if isinstance(d, kind)}

    def port(self, name: str) -> Port:
        """Return the port of that name.

        Raises
        ------
        NameLookupError
            If there is none; the message lists the ports.
        """
        try:
            port: Port = self.ports[name]
        except KeyError:
            inputs = (
                ", ".join(p.name for p in self.ports.values() if p.is_input) or "none"
            )
            outputs = (
                ", ".join(p.name for p in self.ports.values() if not p.is_input)
                or "none"
            )
            hint = f", it is a state: log it as '{self.path}.{name}'; to connect it, add an output"
            hint = hint if name in self.declared(State) else ""
            raise NameLookupError(
                f"block '{self.path}' ({type(self).__name__}) has no port '{name}'{hint}; "
                f"inputs: {inputs}; outputs: {outputs}"
            ) from None
        return port

    @final
    def inputs(self) -> list[Port]:
        """Return the input ports in order of declaration."""
        return [p for p in self.ports.values() if isinstance(p.declaration, Input)]

    @final
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
                f"({', '.join(p.name for p in ports) or 'none'}); name the one to connect"
            )
        return ports[0]

    def wiring_diagram(self) -> Diagram:
        """Return the diagram in which the block can be connected."""
        return self.only_output().wiring_diagram()

    def __getitem__(self, index: Any) -> Port:
        """Return a slice of the only output."""
        return self.only_output()[index]

    def __rshift__(self, other: Port | Block) -> Block:
        """Connect the only output of this block; see `Port`."""
        return self.only_output() >> other

    def __rrshift__(self, other: Any) -> Block:
        """Raise `WiringError`, as the left operand is not a port; see `Port`."""
        block: Block = other >> self.only_input()
        return block

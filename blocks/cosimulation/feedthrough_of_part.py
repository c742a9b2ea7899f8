"""Which inputs from outside reach which ports of a part of a diagram within one instant."""

from __future__ import annotations

from dataclasses import dataclass

from trussflow.blocks.framework.external import External
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import System
from trussflow.blocks.tracing.evaluation import Feedthrough


@dataclass(frozen=True, slots=True, eq=False)
class FeedthroughOfPart:
    """The direct feedthrough of a part of a diagram.

    Sampled blocks pass their inputs on at their instants, so they count. Python blocks show what
    they computed at their last instant, so they do not.

    Attributes
    ----------
    system : System
        The part.
    feedthrough : dict
        What each output of each block depends on.
    """

    system: System
    feedthrough: Feedthrough

    def sources(self, port: Port) -> list[tuple[Port, str, str]]:
        """Return the outputs that a port depends on at once, by which input, wired where."""
        path, block = port.block.path, port.block
        if port.is_input:
            names: list[str] = [port.name]
        elif isinstance(block, External) or not (block.traced or block.continuous):
            names = []
        else:
            needed = self.feedthrough[path][port.name]
            names = [p.name for p in block.inputs() if p.name in needed]
        return [
            (driver.source.block.port(driver.source.name), f"{path}.{name}", driver.where)
            for name in names
            for driver in self.system.drivers[path, name]
            if driver.source is not None
        ]

    def back_from(self, port: Port) -> dict[str, list[str]]:
        """Return the inputs from outside that a port depends on, and the hops from each to it."""
        found: dict[str, list[str]] = {}
        routes: dict[tuple[str, str], list[str]] = {(port.block.path, port.name): []}
        waiting = [port]
        while waiting:
            at = waiting.pop(0)
            route = routes[at.block.path, at.name]
            if isinstance(at.block, External):
                found[at.block.name] = route
                continue
            for source, through, where in self.sources(at):
                key = (source.block.path, source.name)
                if key not in routes:
                    origin = source.block.name if isinstance(source.block, External) else source.path
                    hop = f"{origin} --wire--> {through}"
                    if not at.is_input:
                        hop += f" ==feedthrough==> {at.path}"
                    routes[key] = [f"{hop}   [{where}]", *route]
                    waiting.append(source)
        return found

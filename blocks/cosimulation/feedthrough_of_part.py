"""Which inputs from outside reach which ports of a part of a diagram within one instant."""

from __future__ import annotations

from trussflow.blocks.framework.external import External
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import System
from trussflow.blocks.tracing.loops import Feedthrough


def inputs_behind(system: System, feedthrough: Feedthrough, port: Port) -> dict[str, list[str]]:
    """Return the inputs from outside that a port depends on, and the hops from each to it.

    Sampled blocks pass their inputs on at their instants, so they count.

    Parameters
    ----------
    system : System
        The part.
    feedthrough : dict
        What each output of each block depends on.
    port : Port
        A port of the part, whole.
    """
    found: dict[str, list[str]] = {}
    routes: dict[Port, list[str]] = {port: []}
    waiting = [port]
    while waiting:
        at = waiting.pop(0)
        if isinstance(at.block, External):
            found[at.block.name] = routes[at]
            continue
        for source, through, where in _sources(system, feedthrough, at):
            if source not in routes:
                origin = source.block.name if isinstance(source.block, External) else source.path
                hop = f"{origin} --wire--> {through}"
                if not at.is_input:
                    hop += f" ==feedthrough==> {at.path}"
                routes[source] = [f"{hop}   [{where}]", *routes[at]]
                waiting.append(source)
    return found


def _sources(system: System, feedthrough: Feedthrough, port: Port) -> list[tuple[Port, str, str]]:
    """Return the outputs that a port depends on at once, by which input, wired where."""
    path, block = port.block.path, port.block
    if port.is_input:
        names: list[str] = [port.name]
    else:
        needed = feedthrough[path][port.name]
        names = [p.name for p in block.inputs() if p.name in needed]
    return [
        (driver.source.block.port(driver.source.name), f"{path}.{name}", driver.where)
        for name in names
        for driver in system.drivers[path, name]
        if driver.source is not None
    ]

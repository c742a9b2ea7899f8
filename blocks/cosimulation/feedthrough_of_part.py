"""Direct feedthrough from external inputs to ports of a part of a diagram."""

from __future__ import annotations

from trussflow.blocks.framework.external import External
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import System
from trussflow.blocks.tracing.sorted_order import Feedthrough


def inputs_behind(system: System, feedthrough: Feedthrough, port: Port) -> dict[str, list[str]]:
    """Return the external inputs with direct feedthrough to a port, and the path from each to the port.

    Sampled blocks have direct feedthrough at their instants, so paths through them are included.

    Parameters
    ----------
    system : System
        The part.
    feedthrough : dict
        Inputs with direct feedthrough to each output of each block.
    port : Port
        A whole port of the part.
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
    """Return the outputs on which a port depends directly, each with the input and the line of the wire."""
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

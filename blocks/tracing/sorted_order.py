"""Sorted order and cycles of graphs, and the sorted order of the outputs of a system.

A graph maps each node to the nodes on which it depends. Algebraic loops are the strongly connected
components of the graph of outputs. In each component, a small set of outputs that opens all cycles is
**torn**: these outputs are the unknowns, and all others follow from them one after another. The torn outputs
are the same at all instants. So each has one place in d for its last solution, which is the initial guess of
the next one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import (
    Callable,
    Collection,
    Container,
    Hashable,
    Iterable,
    Iterator,
    Mapping,
)
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from typing import NamedTuple, TypeVar

import casadi as ca

from trussflow.blocks.errors import AlgebraicLoopError
from trussflow.blocks.framework.clock import Clock
from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import System
from trussflow.blocks.support.types import Array

T = TypeVar("T", bound=Hashable)

Feedthrough = dict[str, dict[str, frozenset[str]]]
"""Inputs with direct feedthrough, by block path and output."""

Active = frozenset[Clock]
"""The clocks that tick at one instant."""


Graph = dict[Port, dict[Port, str]]
"""Outputs on which each output depends, each with a description of the path for messages."""


class Stage(NamedTuple):
    """Outputs that are computed together: one, or those of an algebraic loop.

    Attributes
    ----------
    ports : tuple of Port
        The outputs in sorted order; in a loop, dependence on torn outputs is ignored.
    torn : tuple of Port
        The outputs of a loop that are the unknowns.
    cycle : str
        Description of a cycle in the loop.
    """

    ports: tuple[Port, ...]
    torn: tuple[Port, ...] = ()
    cycle: str = ""


def laid_out(ports: Iterable[Port], start: int = 0) -> Layout:
    """Return the layout of whole `ports` in a vector from index `start` [-] on."""
    arrays = [(port.block.path, port.name, port.whole_shape or ()) for port in ports]
    return Layout(arrays, start)


def by_port(
    ports: Collection[Port], flat: Array, make: Callable[..., Array]
) -> dict[Port, Array]:
    """Return the values of whole `ports` in the vector `flat`; `make` converts a slice to a shape."""
    arrays = laid_out(ports).unpack(flat, make)
    return {port: arrays[port.block.path][port.name] for port in ports}


def in_order(graph: Mapping[T, Iterable[T]]) -> tuple[list[T], list[T]]:
    """Return the nodes of a `graph`, each after those on which it depends, and an empty list.

    If there is a cycle, return an empty list and the nodes of a cycle: each one depends on the one before,
    and the first is also the last.
    """
    try:
        return [*TopologicalSorter(graph).static_order()], []
    except CycleError as error:
        return [], error.args[1]


def components(graph: Mapping[T, Iterable[T]]) -> Iterator[tuple[T, ...]]:
    """Yield the strongly connected components of a `graph`, each after those on which it depends.

    All nodes must be keys of the graph.
    """
    nodes = list(graph)
    number = {node: i for i, node in enumerate(nodes)}
    pairs = [
        (number[node], number[source])
        for node, sources in graph.items()
        for source in sources
    ]
    rows, columns = zip(*pairs, strict=True) if pairs else ((), ())
    _, places, starts = ca.Sparsity.triplet(len(nodes), len(nodes), rows, columns).scc()
    # CasADi lists first the components on which no other depends.
    for begin, end in reversed(list(pairwise(starts))):
        yield tuple(nodes[i] for i in sorted(places[begin:end]))


def cycles(graph: Mapping[T, Collection[T]]) -> Iterator[tuple[T, ...]]:
    """Return the strongly connected components of a `graph` that contain a cycle."""
    return (c for c in components(graph) if len(c) > 1 or c[0] in graph[c[0]])


def graph_of(system: System, feedthrough: Feedthrough, active: Active) -> Graph:
    """Return the dependence graph, by `feedthrough`, of outputs of a `system` while `active` clocks tick."""
    holding = system.holding(active)
    graph: Graph = {}
    for path, block in system.blocks.items():
        # A held output depends on nothing within the instant, which opens the loop.
        if path in holding:
            continue
        for port in block.outputs():
            sources = graph.setdefault(port, {})
            for name in (
                p.name for p in block.inputs() if p.name in feedthrough[path][port.name]
            ):
                for driver in system.drivers[path, name]:
                    source = driver.source
                    if source is not None and source.block.path not in holding:
                        sources[source.block.port(source.name)] = (
                            f"{path}.{name} ==feedthrough==> {port.path}   [{driver.where}]"
                        )
    return graph


def reached_from(
    system: System,
    feedthrough: Feedthrough,
    path: str,
    names: Iterable[str],
    holding: Container[str],
    among: Collection[str],
) -> list[str]:
    """Return the blocks `among` others on which inputs of a block depend within one instant, in fixed order.

    The search starts at the inputs `names` of the block at `path` of the `system`. It goes backwards through
    all blocks, by their `feedthrough`, except those that are `holding` their outputs.
    """
    found: dict[str, None] = {}
    visited: set[tuple[str, str]] = set()
    waiting = [(path, name) for name in sorted(names)]
    while waiting:
        for driver in system.drivers[waiting.pop()]:
            if driver.source is None:
                continue
            key = source, output = driver.source.block.path, driver.source.name
            if key in visited:
                continue
            visited.add(key)
            if source in among:
                found[source] = None
            elif source not in holding:
                waiting += [(source, i) for i in sorted(feedthrough[source][output])]
    return [*found]


def torn_ports(graph: Graph, preferred: Container[Port]) -> frozenset[Port]:
    """Return outputs whose removal leaves no cycle in a `graph`.

    In each component, `preferred` outputs come first, then small ones with many connections.
    """
    found: set[Port] = set()
    waiting = [graph]
    while waiting:
        for ports in cycles(waiting.pop()):
            inside = _among(graph, ports)
            uses = Counter(source for sources in inside.values() for source in sources)
            best = min(
                ports,
                # Edges in times edges out: such an output is on many cycles.
                key=lambda p: (p not in preferred, p.size, -uses[p] * len(inside[p])),
            )
            found.add(best)
            waiting.append(_among(inside, [port for port in ports if port is not best]))
    return frozenset(found)


def order(
    system: System,
    feedthrough: Feedthrough,
    active: Active,
    torn: frozenset[Port],
    *,
    refuse: bool = True,
) -> list[Stage]:
    """Return the sorted order of the outputs of a `system` that are computed while `active` clocks tick.

    Each output comes after those on which it depends by `feedthrough`. In loops that are solved, dependence
    on `torn` outputs is ignored. If `refuse` is false, all loops count as solved.

    Raises
    ------
    AlgebraicLoopError
        If outputs form an algebraic loop that is not solved; the message shows the cycle.
    """
    graph = graph_of(system, feedthrough, active)
    # Outputs by generations: the inputs of a block are then mostly known when its outputs are computed,
    # so that these have equal expressions and share kernels.
    ports, cycle = in_order(graph)
    if not cycle:
        return [Stage((port,)) for port in ports]
    stages = []
    for component in components(graph):
        inside = _among(graph, component)
        _, cycle = in_order(inside)
        if not cycle:
            stages.append(Stage(component))
            continue
        if refuse and not is_solved(system, [port.block.path for port in component]):
            raise _refused(system, graph, cycle)
        own = tuple(port for port in component if port in torn)
        # Torn outputs are given here, so that they come first and the others follow.
        opened, _ = in_order(inside | {port: {} for port in own})
        stages.append(Stage(tuple(opened), own, "\n".join(_lines(graph, cycle))))
    return stages


def _among(graph: Graph, ports: Iterable[Port]) -> Graph:
    """Return the subgraph of some ports."""
    chosen = dict.fromkeys(ports)
    return {
        port: {s: how for s, how in graph[port].items() if s in chosen}
        for port in chosen
    }


def is_solved(system: System, paths: Collection[str]) -> bool:
    """Return whether a diagram of a `system` that contains all blocks at these `paths` solves its loops."""
    return any(
        diagram.loop_policy == "solve"
        and all(not name or path.startswith(f"{name}.") for path in paths)
        for name, diagram in system.diagrams.items()
    )


def _lines(graph: Graph, cycle: list[Port]) -> list[str]:
    return [
        f"  {first.path} --wire--> {graph[second][first]}"
        for first, second in pairwise(cycle)
    ]


def _refused(system: System, graph: Graph, cycle: list[Port]) -> AlgebraicLoopError:
    """Return the error of an algebraic loop, with its cycle."""
    lines = _lines(graph, cycle)
    error = AlgebraicLoopError(
        f"algebraic loop of {len(lines)} wires: within one instant each signal depends on "
        "itself\n" + "\n".join(lines) + "\nbreak it with a state (Integrator, "
        "TransferFunction), a UnitDelay, or other connections; or solve it at every instant by "
        'Diagram(..., loops="solve")'
    )
    error.diagram = system.diagrams.get("")
    return error

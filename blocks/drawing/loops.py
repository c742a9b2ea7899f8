"""Search for blocks in algebraic loops, for diagrams that may be incomplete."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Hashable, Iterator, Mapping
from typing import TypeVar

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import TrussflowError
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import resolved, targets
from trussflow.blocks.tracing.block_check import isolate, isolate_anew

Place = tuple[Block, str]
T = TypeVar("T", bound=Hashable)


def wires_in(diagram: Diagram) -> Iterator[tuple[Port, Port]]:
    """Yield the connections between leaf blocks, in this diagram and in nested ones."""
    for wire in diagram.wires:
        if wire.source is not None:
            yield from ((resolved(wire.source), target) for target in targets(wire.target))
    for block in diagram.blocks.values():
        if isinstance(block, Diagram):
            yield from wires_in(block)


def in_loops(diagram: Diagram) -> set[Block]:
    """Return the blocks whose outputs depend on themselves within an instant.

    A block that cannot be traced is assumed to have no feedthrough.
    """
    # Only blocks in a cycle of connections are traced, as tracing is slow.
    near: dict[Block, set[Block]] = defaultdict(set)
    fed: dict[Place, set[Place]] = defaultdict(set)
    wires = list(wires_in(diagram))
    for source, target in wires:
        near[source.block].add(target.block)
    through = {block: feedthrough(block) for block in on_circles(near)}
    for source, target in wires:
        passed = through.get(target.block, {}).items()
        fed[source.block, source.name] |= {
            (target.block, out) for out, inputs in passed if target.name in inputs
        }
    return {block for block, _ in on_circles(fed)}


def on_circles(graph: dict[T, set[T]]) -> set[T]:
    """Return the nodes of a graph that are in a cycle."""
    found: set[T] = set()
    for start in graph:
        seen, waiting = set[T](), [start]
        while waiting and start not in seen:
            news = graph.get(waiting.pop(), set()) - seen
            seen |= news
            waiting += news
        found |= {start} & seen
    return found


def feedthrough(block: Block) -> Mapping[str, Collection[str]]:
    """Return the inputs with direct feedthrough to each output, as far as they are known.

    Open shapes are scalar during the trace, as in a simulation.
    """
    if block.sample_time is None and not block.traced:
        return {}
    shapes = [port.inferable_shape.root() for port in block.ports.values() if port.inferable_shape.is_open]
    for shape in shapes:
        shape.fix((), "")
    try:
        return (isolate_anew if shapes else isolate)(block).feedthrough
    except TrussflowError:
        return {}
    finally:
        for shape in shapes:
            shape.value, shape.fixed = None, False

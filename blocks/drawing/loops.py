"""Search for blocks in algebraic loops, for diagrams that may be incomplete."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

from trussflow.blocks.errors import TrussflowError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import resolved, targets
from trussflow.blocks.tracing.block_check import isolate, isolate_anew
from trussflow.blocks.tracing.sorted_order import cycles

Place = tuple[Block, str]


def wires_in(diagram: Diagram) -> Iterator[tuple[Port, Port]]:
    """Yield the connections between leaf blocks, in this diagram and in nested ones."""
    for wire in diagram.wires:
        if wire.source is not None:
            yield from (
                (resolved(wire.source), target) for target in targets(wire.target)
            )
    for block in diagram.blocks.values():
        if isinstance(block, Diagram):
            yield from wires_in(block)


def in_loops(diagram: Diagram) -> set[Block]:
    """Return the blocks whose outputs depend on themselves within an instant.

    A block that cannot be traced is assumed to have no feedthrough.
    """
    # Only blocks in a cycle of connections are traced, as tracing is slow.
    wires = list(wires_in(diagram))
    near: dict[Block, set[Block]] = {
        target.block: set() for pair in wires for target in pair
    }
    for source, target in wires:
        near[target.block].add(source.block)
    through = {block: feedthrough(block) for cycle in cycles(near) for block in cycle}
    outputs = [(block, out) for block, passed in through.items() for out in passed]
    fed: dict[Place, set[Place]] = {output: set() for output in outputs}
    for source, target in wires:
        for out, inputs in through.get(target.block, {}).items():
            if target.name in inputs and (source.block, source.name) in fed:
                fed[target.block, out].add((source.block, source.name))
    return {block for cycle in cycles(fed) for block, _ in cycle}


def feedthrough(block: Block) -> Mapping[str, Collection[str]]:
    """Return the inputs with direct feedthrough to each output, as far as they are known.

    Open shapes are scalar during the trace, as in a simulation.
    """
    if block.sample_time is None and not block.traced:
        return {}
    shapes = [
        port.inferable_shape.root()
        for port in block.ports.values()
        if port.inferable_shape.is_open
    ]
    for shape in shapes:
        shape.fix((), "")
    try:
        return (isolate_anew if shapes else isolate)(block).feedthrough
    except TrussflowError:
        return {}
    finally:
        for shape in shapes:
            shape.value, shape.fixed = None, False

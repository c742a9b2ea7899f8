"""The loop broken at a wire: loop transfer functions for margins."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import LinearAnalysisError
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.rewiring import readers
from trussflow.blocks.framework.system import System, flatten
from trussflow.blocks.linear_analysis.linearize import Amplitudes, Linearizer
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import Reference, named

if TYPE_CHECKING:
    from trussflow.blocks.linear_analysis.linear_model import LinearModel


def loop_transfer(
    diagram: Diagram,
    at: Reference,
    *,
    point: OperatingPoint | None = None,
    amplitude: Amplitudes | None = None,
) -> LinearModel:
    """Return the loop transfer function with the loop broken at a wire.

    Whatever is sent into the broken end comes back, through the rest of the diagram, as -L
    times what was sent: L is the loop gain for negative feedback, as ``control.margin``,
    ``control.nyquist_plot`` and ``control.disk_margins`` want it.

    Parameters
    ----------
    diagram : Diagram
        The closed loop.
    at : Port or str
        Where to break it: an input of a block (that wire alone), or an output (every wire from
        it); whole or sliced. Loops through elements that are not in the slice stay closed.
    point : OperatingPoint, optional
        Where to linearize; by default the initial states.
    amplitude : mapping, optional
        As for `linearize`.

    Returns
    -------
    LinearModel
        Square: inputs are the broken elements, outputs what comes back, sign reversed.

    Raises
    ------
    LinearAnalysisError
        If no loop passes there; the message lists the ports that loops pass through.
    NameLookupError
        If there is no such port; the message lists those there are.
    """
    system = flatten(diagram, external=True)
    one = named(system, at)
    looping = _looping(system)
    read = {(port.block.path, port.name) for port, _, _ in readers(system, one.port)}
    if read.isdisjoint({(path, name) for _, path, name in looping}):
        through = sorted({f"'{source.path}'" for source, _, _ in looping})
        raise LinearAnalysisError(
            f"no loop passes through '{one.port.full_path}'; "
            + (f"loops pass through: {', '.join(through)}" if through else "there is no loop")
        )
    model = Linearizer(diagram, [at], [at], cut=[at]).at(point, amplitude=amplitude)
    return model.returned()


def _looping(system: System) -> list[tuple[Port, str, str]]:
    """Return the wires that loops pass through: source, path of the reader, and its input.

    A loop passes through a wire if the blocks at both ends lead to each other.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    numbers = {path: i for i, path in enumerate(system.blocks)}
    wires, ends = [], []
    for (path, name), drivers in system.drivers.items():
        for driver in drivers:
            if driver.source is not None:
                wires.append((driver.source, path, name))
                ends.append((numbers[driver.source.block.path], numbers[path]))
    rows, columns = zip(*ends, strict=True) if ends else ((), ())
    size = len(numbers)
    graph = coo_array((np.ones(len(ends)), (rows, columns)), shape=(size, size))
    group = connected_components(graph, connection="strong")[1]
    return [wire for wire, (a, b) in zip(wires, ends, strict=True) if group[a] == group[b]]

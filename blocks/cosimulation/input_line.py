"""Inputs from outside that change linearly between communication points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Signals
from trussflow.blocks.framework.external import External
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.system import Driver, System
from trussflow.blocks.framework.types import Array


class Line(Block):
    r"""A straight line in time.

    .. math:: y(t) = u + r (t - t_0)

    Parameters
    ----------
    source : External
        The input whose shape and unit it takes over.
    """

    value = Input("extent", unit=Attribute("own_unit"))
    rate = Input("extent")
    origin = Input(unit="s")
    y = Output("extent", unit=Attribute("own_unit"))

    def __init__(self, source: External) -> None:
        self.extent, self.own_unit = source.extent, source.own_unit
        super().__init__()
        self.__dict__["name"] = f"(line of {source.name})"

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the point of the line at time t."""
        return {"y": u.value + u.rate * (t - u.origin)}


class _Origin(Block):
    """Declares the ports that the further inputs from outside are made of."""

    origin = Input(unit="s")
    rate = Input("extent")

    def __init__(self, extent: tuple[int, ...]) -> None:
        self.extent = extent
        super().__init__()


def with_lines(system: System) -> System:
    """Return a system whose inputs from outside are lines.

    Its inputs from outside are those of `system`, then their rates in the same order, then the
    time from which the rates count.
    """
    sources = list(system.external.values())
    if not sources:
        return system
    lines = {source.path: Line(source) for source in sources}
    rates = [External(_Origin(s.extent).port("rate"), f"rate of {s.name}") for s in sources]
    origin = External(_Origin(()).port("origin"), "origin of lines")
    drivers = {
        key: [
            d
            if d.source is None or d.source.block.path not in lines
            else replace(d, source=lines[d.source.block.path].y)
            for d in found
        ]
        for key, found in system.drivers.items()
    }
    for source, rate, line in zip(sources, rates, lines.values(), strict=True):
        for name, given in (("value", source), ("rate", rate), ("origin", origin)):
            everything = np.arange(line.port(name).size)
            drivers[line.path, name] = [Driver(given.y, everything, everything, "outside")]
    added: list[Block] = [*rates, origin, *lines.values()]
    blocks = system.blocks | {block.path: block for block in added}
    return replace(system, blocks=blocks, drivers=drivers)

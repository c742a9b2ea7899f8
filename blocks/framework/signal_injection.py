"""Signal injection: signals that add to, replace, or read the wires of a flat system.

A loop is opened by cutting a wire and driving its end by an external input. A part of a diagram becomes
a system whose cut wires are external inputs. These functions return new systems; the diagram of the
user does not change.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Signals
from trussflow.blocks.framework.external_inputs import External
from trussflow.blocks.framework.port import Input, Output, Port
from trussflow.blocks.framework.system import Driver, Indices, System, resolved, targets
from trussflow.blocks.support.types import Array


class Adder(Block):
    r"""Add an injected signal to the signal of an input.

    .. math:: y = u + w

    Parameters
    ----------
    port : Port
        The input.
    """

    w = Input("extent", unit=Attribute("own_unit"))
    y = Output("extent", unit=Attribute("own_unit"))

    def __init__(self, port: Port) -> None:
        self.extent, self.own_unit = port.whole_shape or (), port.unit
        default = port.declaration.default
        self.extra_ports = {
            "u": Input("extent", unit=Attribute("own_unit"), default=default)
        }
        super().__init__()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the sum."""
        return {"y": u.u + u.w}


def injected(system: System, port: Port, source: Block, *, cut: bool = False) -> System:
    """Return a system in which the output of a block adds to, or replaces, a signal.

    Parameters
    ----------
    system : System
        The system, which does not change.
    port : Port
        An input, or an output, which selects all its readers; whole or sliced.
    source : Block
        Block with one output y of the port's shape.
    cut : bool
        Whether the output replaces the signal, instead of being added to it.
    """
    blocks = system.blocks | {source.path: source}
    drivers = dict(system.drivers)
    for target, given, taken in readers(system, port):
        key = (target.block.path, target.name)
        injection = Driver(source.ports["y"], taken, given, "injected")
        before = drivers[key]
        if cut and (before or given.size == target.size):
            drivers[key] = [*_without(before, given), injection]
            continue
        adder = Adder(target).named(f"({target.path} + {source.name})")
        blocks[adder.path] = adder
        # If some elements of an input without a driver are cut, the others keep its default.
        passed = np.arange(target.size)
        passed = passed[~np.isin(passed, given)] if cut else passed
        drivers[adder.path, "u"], drivers[adder.path, "w"] = (
            before,
            [] if cut else [injection],
        )
        drivers[key] = [
            Driver(adder.y, passed, passed, "injected"),
            *([injection] if cut else []),
        ]
    return replace(system, blocks=blocks, drivers=drivers)


def probed(system: System, port: Port) -> tuple[System, Port]:
    """Return a system with a probe of the signal at an input, before any later injection.

    Parameters
    ----------
    system : System
        The system, which does not change.
    port : Port
        An input, whole or sliced; an output needs no probe.

    Returns
    -------
    System, Port
        The system, and the output with the signal.
    """
    leaf = resolved(port)
    if not leaf.is_input:
        return system, leaf
    taken = sum(path.startswith(f"(at {leaf.path}") for path in system.blocks)
    # a signal may have several probes
    probe = Adder(leaf).named(f"(at {leaf.path}, {taken + 1})")
    drivers = dict(system.drivers)
    drivers[probe.path, "u"] = drivers[leaf.block.path, leaf.name]
    drivers[probe.path, "w"] = []
    found = replace(system, blocks=system.blocks | {probe.path: probe}, drivers=drivers)
    return found, probe.y if leaf.index is None else probe.y[leaf.index]


def readers(system: System, port: Port) -> list[tuple[Port, Indices, Indices]]:
    """Return the readers of a signal: each input, its elements, and the matching elements of `port`.

    Parameters
    ----------
    system : System
        The system.
    port : Port
        An input, or an output, which selects all its readers; whole or sliced.
    """
    wanted = port.elements().ravel()
    if port.is_input:
        numbers = np.arange(wanted.size)
        return [(leaf.block.port(leaf.name), wanted, numbers) for leaf in targets(port)]
    leaf = resolved(port)
    wanted = leaf.elements().ravel()
    place = {int(element): k for k, element in enumerate(wanted)}
    found = []
    for (path, name), drivers in system.drivers.items():
        for driver in drivers:
            if driver.source is None or driver.source.block is not leaf.block:
                continue
            if driver.source.name != leaf.name:
                continue
            hits = np.array([int(e) in place for e in driver.taken], dtype=bool)
            if hits.any():
                taken = np.array([place[int(e)] for e in driver.taken[hits]])
                found.append(
                    (system.blocks[path].port(name), driver.given[hits], taken)
                )
    return found


def _without(drivers: list[Driver], elements: Indices) -> list[Driver]:
    """Return the drivers without those of these elements."""
    kept = []
    for driver in drivers:
        stays = ~np.isin(driver.given, elements)
        if driver.source is None:
            kept.append(replace(driver, given=driver.given[stays]))
        elif stays.any():
            kept.append(
                replace(driver, taken=driver.taken[stays], given=driver.given[stays])
            )
    return kept


def part_of(
    system: System, paths: Collection[str]
) -> tuple[System, dict[External, Driver]]:
    """Return some blocks of a system as a new system, whose open inputs are external inputs.

    Parameters
    ----------
    system : System
        The system, which does not change.
    paths : collection of str
        Paths of the blocks.

    Returns
    -------
    System, dict
        The new system, and the first driver that each external input replaces.
    """
    inside = {path: system.blocks[path] for path in system.blocks if path in paths}
    outside: dict[tuple[str, str], External] = {}
    first: dict[External, Driver] = {}
    drivers: dict[tuple[str, str], list[Driver]] = {}
    for key, all_drivers in system.drivers.items():
        if key[0] not in inside:
            continue
        drivers[key] = []
        for driver in all_drivers:
            source = driver.source
            if source is None or source.block.path in inside:
                drivers[key].append(driver)
                continue
            origin = (source.block.path, source.name)
            if origin not in outside:
                outside[origin] = External(source.block.port(source.name), source.path)
                first[outside[origin]] = driver
            drivers[key].append(replace(driver, source=outside[origin].y))
    blocks = inside | {external.path: external for external in outside.values()}
    return replace(system, blocks=blocks, drivers=drivers), first

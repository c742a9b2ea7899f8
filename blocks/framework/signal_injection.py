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
    system = _copy(system)
    system.blocks[source.path] = source
    for target, given, taken in readers(system, port):
        key = (target.block.path, target.name)
        if not cut or (not system.drivers[key] and given.size < target.size):
            # If some elements of an input without a driver are cut, the others keep its default.
            name = f"({target.path} + {source.name})"
            # An input is met once for each of the wires that lead to it.
            if name not in system.blocks:
                _insert_adder(system, target, name)
            key = key if cut else (name, "w")
        others = _without(system.drivers[key], given)
        injection = Driver(source.ports["y"], taken, given, "injected")
        system.drivers[key] = [*others, injection]
    return system


def _copy(system: System) -> System:
    """Return a system with dictionaries of its own."""
    return replace(system, blocks=dict(system.blocks), drivers=dict(system.drivers))


def _insert_adder(system: System, target: Port, name: str) -> Port:
    """Insert an `Adder` of that `name` before the input `target`; return its output."""
    adder = Adder(target).named(name)
    key = (target.block.path, target.name)
    everything = np.arange(target.size)
    system.blocks[adder.path] = adder
    system.drivers[adder.path, "u"] = system.drivers[key]
    # Elements without a driver are zero: as yet, the adder changes nothing.
    system.drivers[adder.path, "w"] = []
    system.drivers[key] = [Driver(adder.y, everything, everything, "injected")]
    return adder.y


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
    # A signal may have several probes: the number makes their names distinct.
    taken = sum(path.startswith(f"(at {leaf.path}") for path in system.blocks)
    system = _copy(system)
    # An adder passes whole inputs only; the slice is taken from its output.
    whole = leaf.block.port(leaf.name)
    probe = _insert_adder(system, whole, f"(at {leaf.path}, {taken + 1})")
    return system, probe if leaf.index is None else probe[leaf.index]


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
        # The signal of an input has one reader; of an exposed group,
        # one for each input.
        numbers = np.arange(wanted.size)
        return [(leaf.block.port(leaf.name), wanted, numbers) for leaf in targets(port)]
    leaf = resolved(port)
    wanted = leaf.elements().ravel()
    found = []
    for (path, name), drivers in system.drivers.items():
        for driver in drivers:
            if driver.source is None or driver.source.block is not leaf.block:
                continue
            if driver.source.name != leaf.name:
                continue
            # All pairs of an element that this driver takes and an equal
            # element of `port`.
            hits, taken = np.nonzero(driver.taken[:, None] == wanted)
            if hits.size:
                target = system.blocks[path].port(name)
                found.append((target, driver.given[hits], taken))
    return found


def _without(drivers: list[Driver], elements: Indices) -> list[Driver]:
    """Return the drivers without those of these elements."""
    kept = []
    for driver in drivers:
        stays = ~np.isin(driver.given, elements)
        taken, given = driver.taken[stays], driver.given[stays]
        # A driver whose elements are all cut is left out.
        if given.size:
            kept.append(replace(driver, taken=taken, given=given))
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
            # One external input for each output outside, even if it
            # drives several inputs.
            origin = (source.block.path, source.name)
            if origin not in outside:
                outside[origin] = External(source.block.port(source.name), source.path)
                first[outside[origin]] = driver
            drivers[key].append(replace(driver, source=outside[origin].y))
    blocks = inside | {external.path: external for external in outside.values()}
    return replace(system, blocks=blocks, drivers=drivers), first

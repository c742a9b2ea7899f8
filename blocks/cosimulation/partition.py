"""Partition: a flat diagram cut into the units of a co-simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from trussflow.blocks.cosimulation.diagram_member import DiagramSlave, Settings
from trussflow.blocks.cosimulation.feedthrough_of_part import Reach
from trussflow.blocks.cosimulation.member import Inlet, Unit
from trussflow.blocks.cosimulation.slave import Cosimulated
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.errors import NameLookupError, SimulationError
from trussflow.blocks.framework.external import External
from trussflow.blocks.framework.port import Input, Port
from trussflow.blocks.framework.system import Driver, System

REST = "the rest"
"""Name of the unit of all that is no unit by itself."""

Key = tuple[str, str]
"""Path of a leaf block, and name of its port."""


def partition(
    system: System, names: Sequence[str | Block], logged: Sequence[Port], settings: Settings
) -> list[Unit]:
    """Cut a diagram into units.

    Parameters
    ----------
    system : System
        The flat diagram.
    names : sequence of str or Block
        Blocks and diagrams within, by path or as objects, that become units of their own.
    logged : sequence of Port
        Ports whose values are wanted, besides those that cross from unit to unit.
    settings : Settings
        How the parts that do not step themselves are integrated.

    Returns
    -------
    list of Unit
        In the order of `names`, then blocks that step themselves, then the rest.

    Raises
    ------
    NameLookupError
        If there is no such block, parameter or state.
    SimulationError
        If a block is in two units.
    """
    owner = _owners(system, names)
    _check_names(system, settings)
    groups: dict[str, list[Block]] = {}
    for name in [*dict.fromkeys(_path(n) for n in names), *owner.values()]:
        groups.setdefault(name, [])
    if REST in groups:  # last, whatever the order of the blocks is
        groups[REST] = groups.pop(REST)
    for path, block in system.blocks.items():
        groups[owner[path]].append(block)
    units = []
    for name, blocks in groups.items():
        if len(blocks) == 1 and isinstance(blocks[0], Cosimulated):
            units.append(_own_unit(system, blocks[0], settings))
        elif blocks:
            units.append(_part(system, name, blocks, logged, settings))
    return units


def _path(name: str | Block) -> str:
    return name.path if isinstance(name, Block) else str(name)


def _owners(system: System, names: Sequence[str | Block]) -> dict[str, str]:
    """Return the name of the unit of each leaf block.

    Raises
    ------
    NameLookupError
        If there is no such block.
    SimulationError
        If a block is in two units.
    """
    owner = {path: path for path, b in system.blocks.items() if isinstance(b, Cosimulated)}
    taken: dict[str, str] = {}
    for name in dict.fromkeys(map(_path, names)):
        inside = [
            path
            for path in system.blocks
            if path == name or (name in system.diagrams and path.startswith(f"{name}."))
        ]
        if not inside:
            known = ", ".join([*system.blocks, *filter(None, system.diagrams)])
            raise NameLookupError(f"no block '{name}' for a unit; there are: {known}")
        for path in inside:
            if path in taken:
                raise SimulationError(f"block '{path}' cannot be in two units, '{taken[path]}' and '{name}'")
            taken[path] = name
    return {path: owner.get(path, taken.get(path, REST)) for path in system.blocks}


def _check_names(system: System, settings: Settings) -> None:
    """Refuse values for what is not there; each unit is given its own only.

    Raises
    ------
    NameLookupError
        Naming it.
    """
    for kind, references in (("parameter", settings.parameters), ("state", settings.initial)):
        for reference in references:
            path = reference.rpartition(".")[0]
            if path not in system.blocks:
                raise NameLookupError(
                    f"no {kind} '{reference}': there is no block '{path}'; the blocks are: "
                    f"{', '.join(system.blocks)}"
                )
            if isinstance(system.blocks[path], Cosimulated) and kind == "state":
                raise NameLookupError(
                    f"cannot set {kind} '{reference}' here: '{path}' steps itself; give it the "
                    "value when you build it"
                )


def _own_unit(system: System, block: Block, settings: Settings) -> Unit:
    """Return the unit of a block that steps itself."""
    assert isinstance(block, Cosimulated)
    values = _values(block, settings)
    slave = block.cosimulation_slave(values)
    inputs, outlets = block.inputs(), block.outputs()
    needed = block.feedthrough()
    inlets = tuple(
        Inlet(port, tuple(system.drivers[block.path, port.name]), _default(port)) for port in inputs
    )

    def route(inlet: int, outlet: int) -> list[str]:
        target = inputs[inlet]
        where = next((d.where for d in inlets[inlet].drivers if d.source is not None), "")
        return [_hop(inlets[inlet], target.path, f" ==feedthrough==> {outlets[outlet].path}", where)]

    return Unit(
        name=block.path,
        slave=slave,
        inlets=inlets,
        outlets=tuple(outlets),
        needs=tuple(frozenset(i for i, p in enumerate(inputs) if p.name in needed[o.name]) for o in outlets),
        route=route,
        parameters={f"{block.path}.{n}": np.ravel(v).tolist() for n, v in values.items()},
        fingerprint=str(getattr(slave, "token", "")),
    )


def _values(block: Block, settings: Settings) -> Signals:
    """Return the parameters of a block that steps itself.

    Raises
    ------
    NameLookupError
        If one is set that it does not have.
    """
    values = dict(block.parameters)
    for reference, value in _of({block.path: block}, settings.parameters).items():
        name = reference.rpartition(".")[2]
        if name not in values:
            raise NameLookupError(
                f"no parameter '{reference}'; '{block.path}' has: {', '.join(values) or 'none'}"
            )
        declared = block._declared[name]
        values[name] = declared.convert(value, values[name].shape, f"block '{block.path}'")
    return Signals(f"block '{block.path}'", values)


def _hop(inlet: Inlet, target: str, through: str, where: str) -> str:
    source = next((d.source.path for d in inlet.drivers if d.source is not None), "?")
    return f"{source} --wire--> {target}{through}   [{where}]"


def _default(port: Port) -> float:
    declaration = port.declaration
    return (declaration.default or 0.0) if isinstance(declaration, Input) else 0.0


def _part(system: System, name: str, blocks: list[Block], logged: Sequence[Port], settings: Settings) -> Unit:
    """Return the unit of blocks that are compiled together."""
    inside = {block.path: block for block in blocks}
    outside: dict[Key, External] = {}
    first: dict[Key, tuple[Port, str]] = {}
    drivers: dict[Key, list[Driver]] = {}
    for block in blocks:
        for port in block.inputs():
            found = drivers.setdefault((block.path, port.name), [])
            for driver in system.drivers[block.path, port.name]:
                source = driver.source
                if source is not None and source.block.path not in inside:
                    key = (source.block.path, source.name)
                    if key not in outside:
                        outside[key] = External(source.block.port(source.name), source.path)
                        first[key] = port, driver.where
                    found.append(replace(driver, source=outside[key].y))
                else:
                    found.append(driver)
    part = replace(system, blocks=inside | {e.path: e for e in outside.values()}, drivers=drivers)
    outlets = _outlets(system, inside, logged)
    own = replace(
        settings, parameters=_of(inside, settings.parameters), initial=_of(inside, settings.initial)
    )
    slave = DiagramSlave(part, outlets, own)
    reach = Reach(part, slave.prepared.plan.feedthrough)
    back = [reach.back_from(port) for port in outlets]
    names = [e.name for e in outside.values()]
    return Unit(
        name=name,
        slave=slave,
        inlets=tuple(
            Inlet(e.y, (Driver(system.blocks[key[0]].port(key[1]), everything, everything, where),))
            for (key, e), (_, where) in zip(outside.items(), first.values(), strict=True)
            for everything in [np.arange(e.y.size)]
        ),
        outlets=tuple(outlets),
        needs=tuple(frozenset(i for i, n in enumerate(names) if n in found) for found in back),
        held=frozenset(
            i for i, o in enumerate(outlets) if o.block.sample_time is not None and not o.is_input
        ),
        route=lambda inlet, outlet: back[outlet][names[inlet]],
        parameters=slave.parameters,
        fingerprint=slave.prepared.fingerprint,
    )


def _of(inside: dict[str, Block], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values for the blocks of one part."""
    return {k: v for k, v in values.items() if k.rpartition(".")[0] in inside}


def _outlets(system: System, inside: dict[str, Block], logged: Sequence[Port]) -> list[Port]:
    """Return the ports of a part that others read, or that are logged."""
    found: dict[Key, Port] = {}
    for (path, _), drivers in system.drivers.items():
        for driver in drivers:
            source = driver.source
            if source is not None and source.block.path in inside and path not in inside:
                found[source.block.path, source.name] = source.block.port(source.name)
    for port in logged:
        if port.block.path in inside:
            found.setdefault((port.block.path, port.name), port.block.port(port.name))
    return list(found.values())


def ordered(names: list[str], order: Sequence[str | Block] | None) -> list[int]:
    """Return the numbers of units in the order given.

    Parameters
    ----------
    names : list of str
        Names of the units.
    order : sequence of str or Block, optional
        All of them, in the order wanted.

    Raises
    ------
    NameLookupError
        If it names no unit.
    SimulationError
        If it does not name each once.
    """
    if order is None:
        return list(range(len(names)))
    wanted = [item.path if isinstance(item, Block) else str(item) for item in order]
    for name in wanted:
        if name not in names:
            raise NameLookupError(f"no unit '{name}' for the order; the units are: {', '.join(names)}")
    if sorted(wanted) != sorted(names):
        raise SimulationError(f"the order must name each unit once; the units are: {', '.join(names)}")
    return [names.index(name) for name in wanted]

"""Partition of a flat diagram into the members of a co-simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any, cast

import numpy as np

from trussflow.blocks.cosimulation.diagram_member import DiagramMember, Settings
from trussflow.blocks.cosimulation.network import Inlet, Member
from trussflow.blocks.errors import NameLookupError, SimulationError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.external_inputs import External
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.run_state import SelfStepping
from trussflow.blocks.framework.signal_injection import part_of
from trussflow.blocks.framework.system import Driver, System
from trussflow.blocks.simulation.block_instances import open_block
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.tracing.sorted_order import Feedthrough

REST_NAME = "the rest"
"""Name of the member with all blocks that are in no other member."""


def partition(
    system: System,
    names: Sequence[str | Block],
    logged: Sequence[Port],
    settings: Settings,
) -> list[Member]:
    """Partition a diagram into members.

    Parameters
    ----------
    system : System
        The flat diagram.
    names : sequence of str or Block
        Blocks and nested diagrams, by path or as objects, that become separate members.
    logged : sequence of Port
        Logged ports, which are outputs of members like the ports between members.
    settings : Settings
        Settings of the integration of blocks that do not step themselves.

    Returns
    -------
    list of Member
        Members in the order of `names`, then self-stepping blocks, then the rest.

    Raises
    ------
    NameLookupError
        If there is no such block, parameter or state.
    SimulationError
        If a block is in two members.
    """
    paths = [name.path if isinstance(name, Block) else str(name) for name in names]
    owner = _owners(system, paths)
    _check_names(system, settings)
    stepping = [path for path, b in system.blocks.items() if b.steps_itself]
    # A dictionary keeps this order: named members, FMUs, the rest.
    groups: dict[str, list[Block]] = {n: [] for n in (*paths, *stepping, REST_NAME)}
    for path, block in system.blocks.items():
        groups[owner[path]].append(block)
    members = []
    for name, blocks in groups.items():
        if len(blocks) == 1 and blocks[0].steps_itself:
            members.append(_own_member(system, blocks[0], settings))
        elif blocks:
            members.append(_part(system, name, blocks, logged, settings))
    return members


def _owners(system: System, names: Sequence[str]) -> dict[str, str]:
    """Return the name of the member of each leaf block.

    Raises
    ------
    NameLookupError
        If there is no such block.
    SimulationError
        If a block is in two members.
    """
    owner = {path: path for path, b in system.blocks.items() if b.steps_itself}
    taken: dict[str, str] = {}
    # A name that is given twice is one member.
    for name in dict.fromkeys(names):
        if name == REST_NAME:
            continue
        inside = [
            path
            for path in system.blocks
            if path == name or (name in system.diagrams and path.startswith(f"{name}."))
        ]
        if not inside:
            known = ", ".join([*system.blocks, *filter(None, system.diagrams)])
            raise NameLookupError(f"no block '{name}' for a member; there are: {known}")
        for path in inside:
            if path in taken:
                raise SimulationError(
                    f"block '{path}' cannot be in two members, '{taken[path]}' and '{name}'"
                )
            taken[path] = name
    # A block that steps itself is a member of its own, also within a named diagram.
    return {path: owner.get(path, taken.get(path, REST_NAME)) for path in system.blocks}


def _check_names(system: System, settings: Settings) -> None:
    """Check that all parameters and initial states belong to blocks, as each member gets only its own.

    Raises
    ------
    NameLookupError
        If a block does not exist, or steps itself and has no such states.
    """
    for kind, references in (
        ("parameter", settings.parameters),
        ("state", settings.initial),
    ):
        for reference in references:
            path = reference.rpartition(".")[0]
            if path not in system.blocks:
                raise NameLookupError(
                    f"no {kind} '{reference}': there is no block '{path}'; the blocks are: "
                    f"{', '.join(system.blocks)}"
                )
            if system.blocks[path].steps_itself and kind == "state":
                raise NameLookupError(
                    f"cannot set {kind} '{reference}' here: '{path}' steps itself; give it the "
                    "value when you build it"
                )


def _own_member(system: System, block: Block, settings: Settings) -> Member:
    """Return the member of a block that steps itself."""
    values = _values(block, settings)
    inputs = block.inputs()
    outlets = block.outputs()
    needed = block.feedthrough()
    inlets = tuple(
        Inlet(
            port,
            tuple(system.drivers[block.path, port.name]),
            port.declaration.default or 0.0,
        )
        for port in inputs
    )

    def route(inlet: int, outlet: Port) -> list[str]:
        through = f"{inputs[inlet].path} ==feedthrough==> {outlet.path}"
        return [
            f"{driver.source.path} --wire--> {through}   [{driver.where}]"
            for driver in inlets[inlet].drivers
            if driver.source is not None
        ][:1]

    return Member(
        name=block.path,
        # the block steps itself
        open=lambda: cast(SelfStepping, open_block(block, values)),
        inlets=inlets,
        outlets=tuple(outlets),
        routes=tuple(
            {i: route(i, o) for i, p in enumerate(inputs) if p.name in needed[o.name]}
            for o in outlets
        ),
        parameters={
            f"{block.path}.{n}": np.ravel(v).tolist() for n, v in values.items()
        },
        fingerprint=block.fingerprint,
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
        values[name] = block.parameter_value(name, value)
    return Signals(f"block '{block.path}'", values)


def _part(
    system: System,
    name: str,
    blocks: list[Block],
    logged: Sequence[Port],
    settings: Settings,
) -> Member:
    """Return the member of blocks that are compiled together."""
    inside = {block.path: block for block in blocks}
    part, drivers = part_of(system, inside)
    outlets = _outlets(system, inside, logged)
    own = replace(
        settings,
        parameters=_of(inside, settings.parameters),
        initial=_of(inside, settings.initial),
    )
    # Traced and compiled once; each run opens a twin.
    prepared = Session(
        part, outputs={port.path: port for port in outlets}, **asdict(settings.solver)
    )
    plan = prepared.prepared.plan
    back = [inputs_behind(part, plan.feedthrough, port) for port in outlets]
    names = [external.name for external in drivers]
    return Member(
        name=name,
        open=lambda: DiagramMember(prepared.twin(), list(drivers), own),
        inlets=tuple(_inlet(external, driver) for external, driver in drivers.items()),
        outlets=tuple(outlets),
        routes=tuple(
            {names.index(name): path for name, path in found.items()} for found in back
        ),
        held=frozenset(
            i
            for i, o in enumerate(outlets)
            if o.block.sample_time is not None and not o.is_input
        ),
        parameters=plan.p.listed(plan.parameters(own.parameters)),
        fingerprint=prepared.prepared.fingerprint,
    )


def _inlet(external: External, driver: Driver) -> Inlet:
    """Return the input that reads one output of another member."""
    assert driver.source is not None
    # The external input has all elements of the output; the part selects from them.
    everything = np.arange(external.y.size)
    source = driver.source.block.port(driver.source.name)
    return Inlet(external.y, (Driver(source, everything, everything, driver.where),))


def _of(inside: dict[str, Block], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values for the blocks of one part."""
    return {k: v for k, v in values.items() if k.rpartition(".")[0] in inside}


def _outlets(
    system: System, inside: dict[str, Block], logged: Sequence[Port]
) -> list[Port]:
    """Return the ports of a part that other members read, or that are logged."""
    read = [
        driver.source
        for (path, _), drivers in system.drivers.items()
        for driver in drivers
        if driver.source is not None and path not in inside
    ]
    found = {
        (port.block.path, port.name): port.block.port(port.name)
        for port in (*read, *logged)
        if port.block.path in inside
    }
    return list(found.values())


def inputs_behind(
    system: System, feedthrough: Feedthrough, port: Port
) -> dict[str, list[str]]:
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
    # Breadth first from the port against the signal flow, so each
    # route is the shortest.
    routes: dict[Port, list[str]] = {port: []}
    waiting = [port]
    for at in waiting:  # grows
        block = at.block
        if isinstance(block, External):
            continue
        # Through a logged input, the path goes on by its own wires only.
        needed = {at.name} if at.is_input else feedthrough[block.path][at.name]
        for into in block.inputs():
            drivers = system.drivers[block.path, into.name]
            for driver in drivers if into.name in needed else ():
                if driver.source is None:
                    continue
                source = driver.source.block.port(driver.source.name)
                if source not in routes:
                    external = isinstance(source.block, External)
                    origin = source.block.name if external else source.path
                    hop = f"{origin} --wire--> {into.path}"
                    if not at.is_input:
                        hop += f" ==feedthrough==> {at.path}"
                    routes[source] = [f"{hop}   [{driver.where}]", *routes[at]]
                    waiting.append(source)
    return {p.block.name: r for p, r in routes.items() if isinstance(p.block, External)}

"""Channels: the logged signals, and their columns in a logged row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import chain, count

import numpy as np

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.declarations import Mode, State
from trussflow.blocks.framework.port import Axes, Inferable, Output, Port
from trussflow.blocks.framework.system import System
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import shown

Chosen = Mapping[str, Port | str] | Sequence[Port | str]
"""Ports, as ports or ``"block.port"``, or states, ``"block.state"``; optionally by a name for results."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One logged port, or slice of one.

    Attributes
    ----------
    name : str
        Name of the variable in the result.
    port : Port
        The port of a leaf block, whole or sliced.
    columns : slice
        Place of the whole port in a logged row.
    axes : dict of str to tuple
        Labels of the axes behind time, by name; empty tuples without labels.
    """

    name: str
    port: Port
    columns: slice
    axes: Axes

    @property
    def is_mode(self) -> bool:
        """Whether the signal is a mode, which may be infinite."""
        return self.port.name in self.port.block.declared(Mode)

    @property
    def places(self) -> Vector:
        """Indices of the elements in a logged row."""
        found: Vector = self.columns.start + self.port.elements().ravel()
        return found

    def values(self, *pieces: Vector) -> Vector:
        """Return the values of this channel in `pieces` of logged rows [as declared], joined along time."""
        places = self.places
        found = np.concatenate([rows[:, places] for rows in pieces])
        return found.reshape(len(found), *self.port.elements().shape)

    def attributes(self) -> dict[str, str]:
        """Return unit, frame and meaning."""
        found = {
            "long_name": self.port.declaration.meaning or self.port.path,
            "source": self.port.path,
        }
        units = self.port.element_units()
        if any(u is not None for u in units):
            same = len(set(units)) == 1
            found["units"] = (
                str(units[0]) if same else ", ".join(u or "" for u in units)
            )
        if self.port.frame is not None:
            found["frame"] = self.port.frame
        return found


def channels(ports: Mapping[str, Port]) -> list[Channel]:
    """Return the channels of ports, which follow one another in a row.

    All axes of one name in a result have the same labels: an axis with other labels gets a number behind
    its name. Axes without labels are named by their size, so that signals of one shape can be
    subtracted.

    Raises
    ------
    SimulationError
        If a name cannot be used in a result file.
    """
    found = []
    start = 0
    known: Axes = {}
    for name, port in ports.items():
        text: object = name
        # netCDF has no '/' in names, and 'time' is the name of the coordinate.
        if not isinstance(text, str) or text in ("", "time") or "/" in text:
            raise SimulationError(
                f"cannot log {port.describe()} as {name!r}: names are not empty, not 'time', and without '/'"
            )
        shape, declared, axes = port.shape or (), port.axes(), Axes()
        if len(declared) != len(shape):
            axes = {
                # A square matrix needs two names: element_3 and element_3_.
                f"element_{n}" + "_" * shape[:i].count(n): ()
                for i, n in enumerate(shape)
            }
        else:
            for axis, labels in declared.items():
                names = chain([axis], (f"{axis}_{k}" for k in count(2)))
                # setdefault() claims a new name, and finds the labels of a known one.
                free = (
                    n
                    for n in names
                    if n not in ports and known.setdefault(n, labels) == labels
                )
                axes[next(free)] = labels
        columns = slice(start, start + port.size)
        found.append(Channel(name, port, columns, axes))
        start = columns.stop
    return found


def _signal(system: System, reference: Port | str) -> Port:
    """Return the port of a leaf block by a reference, or a port with the value of a state."""
    path, _, own = (
        reference.rpartition(".") if isinstance(reference, str) else ("", "", "")
    )
    block = system.blocks.get(path if path or system.diagrams else system.root.path)
    # If a port has the name of a state, the port is meant.
    if block is None or own not in block.declared(State) or own in block.ports:
        return system.port(reference)
    state, shape = block.declared(State)[own], block.state_shape(own)
    unit, labels = block._resolved(state.unit) or None, block._resolved(state.labels)
    declared = Output(shape, unit=unit, meaning=state.meaning)
    return Port(
        block,
        own,
        declared,
        *(Inferable(known, fixed=True) for known in (shape, unit, None, labels)),
    )


def chosen_channels(system: System, chosen: Chosen | None) -> list[Channel]:
    """Return the channels of the `chosen` ports and states of a `system`; of all outputs if None.

    Raises
    ------
    NameLookupError
        If there is no such port.
    SimulationError
        If a port is chosen twice, `chosen` is text instead of a list, or a name cannot be used.
    """
    if chosen is None:
        return channels(
            {p.path: p for b in system.blocks.values() for p in b.outputs()}
        )
    given: object = chosen
    if isinstance(given, str) or not isinstance(given, Sequence | Set | Mapping):
        raise SimulationError(
            f"the ports to log must be a list, such as ['block.y'], or a dict, not {shown(chosen)}"
        )
    references = [*(chosen.values() if isinstance(chosen, Mapping) else chosen)]
    for reference in references:
        if not isinstance(reference, str | Port):
            raise SimulationError(
                f"cannot log {shown(reference)}: give ports, such as block.y, or names, such as 'block.y'"
            )
    names = (
        [*chosen]
        if isinstance(chosen, Mapping)
        else [r if isinstance(r, str) else r.full_path for r in references]
    )
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise SimulationError(f"ports are to be logged twice: {', '.join(twice)}")
    ports = (_signal(system, reference) for reference in references)
    return channels(dict(zip(names, ports, strict=True)))

"""Ports, parameters and states of a block for an FMU, and their mapping to FMU variables."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np

from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.support.types import Array, Vector
from trussflow.fmu.errors import FmuError
from trussflow.fmu.importing.unit_table import UnitTable
from trussflow.fmu.runtime.array_ports import VariableGroup, gather, legal_names
from trussflow.fmu.runtime.description import FmuDescription, FmuVariable
from trussflow.fmu.runtime.start_values import Starts, declared_start, resized, resolve
from trussflow.fmu.runtime.variable_buffers import shares


class VariableVector:
    """Mapping between named groups of a block and one vector of the FMU.

    Used for the inputs, the outputs, the parameters and the states. The vector has the elements in
    the FMU's order; each name of the block refers to some of its elements.

    Parameters
    ----------
    order : sequence of FmuVariable
        The variables in the FMU's order.
    groups : dict of str to VariableGroup
        The FMU variables of each name of the block.

    Attributes
    ----------
    size : int
        Number of elements of the vector.
    places : slice or array of int
        Index of the concatenated elements of all names into the vector.
    """

    def __init__(
        self, order: Sequence[FmuVariable], groups: dict[str, VariableGroup]
    ) -> None:
        self.order = order
        self.groups = groups
        self.size = sum(v.size for v in order)
        spans = {v.name: span for v, span in shares(order, range(self.size))}
        places = {
            name: [i for v in group.variables for i in spans[v.name]]
            for name, group in groups.items()
        }
        self._places = {name: _index(listed) for name, listed in places.items()}
        self.places = _index(list(chain.from_iterable(places.values())))

    def split(self, flat: Vector) -> dict[str, Array]:
        """Return copies of the values in a vector, by name.

        Parameters
        ----------
        flat : Vector
            The vector [units as the FMU states].
        """
        return {
            name: flat[self._places[name]].reshape(group.shape).copy()
            for name, group in self.groups.items()
        }

    def join(self, values: Signals) -> Vector:
        """Return the vector of named values.

        Parameters
        ----------
        values : Signals
            The values [units as the FMU states].
        """
        # Filled completely, as each variable belongs to one group.
        flat = np.empty(self.size)
        for name, places in self._places.items():
            flat[places] = values[name].ravel()
        return flat


def _index(places: list[int]) -> Any:
    """Return the index of elements of a vector: a slice if possible, because it does not copy."""
    first = places[0] if places else 0
    end = first + len(places)
    return slice(first, end) if places == [*range(first, end)] else np.array(places)


class ImportInterface:
    """Ports, parameters and states of a block for an FMU.

    Parameters
    ----------
    description : FmuDescription
        The model description.
    given : mapping of str to object
        Parameters and start values by the names of the FMU or the block [units as the FMU states].
    units : mapping of str to (str or None)
        The user's definitions of units, see `UnitTable`.
    reserved : collection of str
        Names of attributes of blocks.
    with_states : bool
        Whether continuous states are states of the block.
    declared_starts : bool
        Whether inputs with a common declared start value for all elements may stay unconnected.

    Raises
    ------
    FmuError
        If a name, a value or a unit does not fit.
    """

    def __init__(
        self,
        description: FmuDescription,
        given: Mapping[str, Any],
        units: Mapping[str, str | None],
        reserved: Collection[str],
        *,
        with_states: bool,
        declared_starts: bool,
    ) -> None:
        self._declared_starts = declared_starts
        description = self.description = resized(description, given)
        taken = set(reserved)  # of equal names, the first one is not changed
        parameters = self._vector(description.numbers("parameter"), taken)
        self.inputs = self._vector(description.numbers("input"), taken)
        self.outputs = self._vector(description.numbers("output"), taken)
        named = parameters.groups | self.inputs.groups
        self.starts: Starts = resolve(
            description, given, {name: g.variables for name, g in named.items()}
        )
        known = {
            n: g
            for n, g in parameters.groups.items()
            if all(map(self._is_known, g.variables))
        }
        # Parameters without a value stay with the FMU; a block needs a default.
        self.parameters = VariableVector(
            [v for group in known.values() for v in group.variables], known
        )
        self._table = UnitTable(description, units)
        states = description.states if with_states else ()
        self.states = self._vector(states, taken, "_state")
        self.declarations = self._declarations()

    @staticmethod
    def _vector(
        variables: Sequence[FmuVariable], taken: set[str], suffix: str = ""
    ) -> VariableVector:
        """Group variables into arrays and give each group a unique name.

        If a name is taken, as that of a state which is also an output, it gets the suffix first.
        """
        groups = {}
        for group in gather(variables):
            plain = legal_names([group.name], ())[group.name]
            name = f"{plain}{suffix}" if plain in taken else plain
            name = legal_names([name], taken)[name]
            taken.add(name)
            groups[name] = group
        return VariableVector(variables, groups)

    def _is_known(self, variable: FmuVariable) -> bool:
        """Return whether a parameter has a given or declared value; resizing drops declared ones."""
        stated = variable.start is not None or not variable.shape
        return variable.name in self.starts or (
            stated and bool(np.isfinite(declared_start(variable)).all())
        )

    def _start(self, variables: Sequence[FmuVariable]) -> Vector:
        """Return the start values of variables: given, or declared by the FMU."""
        parts = [self.starts.get(v.name, declared_start(v)) for v in variables]
        # The empty part serves FMUs without inputs: `concatenate` needs an array.
        return np.concatenate([np.zeros(0), *parts])

    def initial_inputs(self) -> Vector:
        """Return the start values of the inputs: given, or declared by the FMU."""
        return self._start(self.inputs.order)

    def _declarations(self) -> dict[str, Any]:
        """Return the declarations of the block."""
        declared: dict[str, Any] = {}
        for name, group in self.inputs.groups.items():
            declared[name] = Input(
                group.shape, default=self._default(group), **self._about(group)
            )
        for name, group in self.outputs.groups.items():
            declared[name] = Output(group.shape, **self._about(group))
        for name, group in self.parameters.groups.items():
            about = self._about(group)
            if not isinstance(about["unit"], str):
                # parameters support one unit, not one per element
                about["unit"] = ""
            default = self._start(group.variables).reshape(group.shape)
            declared[name] = Parameter(default, group.shape, **about)
        for name, group in self.states.groups.items():
            about = self._about(group)
            declared[name] = State(
                group.shape, **{**about, "unit": about["unit"] or ""}
            )
        for name, declaration in declared.items():
            declaration.name = name
        return declared

    def _about(self, group: VariableGroup) -> dict[str, Any]:
        return {"unit": self._unit(group), "meaning": group.variables[0].meaning}

    def _unit(self, group: VariableGroup) -> Unit:
        """Return the unit of a group, or the units of its elements if they differ."""
        units = [
            self._table.unit(v.unit) for v in group.variables for _ in range(v.size)
        ]
        if len(set(units)) <= 1:
            return units[0] if units else None
        return tuple("" if unit is None else unit for unit in units)

    def _default(self, group: VariableGroup) -> float | None:
        """Return the value of an unconnected input, or None if the input must be connected."""
        given = any(v.name in self.starts for v in group.variables)
        declared = self._declared_starts and all(
            v.start is not None for v in group.variables
        )
        if not given and not declared:
            return None
        values = self._start(group.variables)
        # The slice keeps this valid for an array without elements.
        if np.any(values != values[:1]):
            if not given:
                return None
            raise FmuError(
                f"FMU '{self.description.name}': input '{group.name}' can be given one value for "
                "all its elements; connect a Constant to it instead"
            )
        return float(values[0]) if values.size else 0.0

    # -- values -------------------------------------------------------------------------------

    def _values(self, p: Signals) -> Starts:
        """Return the values of the parameters by the FMU's names."""
        return {
            v.name: value
            for name, group in self.parameters.groups.items()
            for v, value in shares(group.variables, p[name].flatten())
        }

    def initial_values(self, p: Signals) -> Starts:
        """Return the given values, and the parameters that differ from the model description.

        Parameters
        ----------
        p : Signals
            The parameters of the block [units as the FMU states].
        """
        known = self.description.variables
        # Values that the FMU has already are not set; it may refuse to set them.
        return self.starts | {
            name: value
            for name, value in self._values(p).items()
            if name in self.starts
            or not np.array_equal(value, declared_start(known[name]))
        }

    def tunable(self, p: Signals) -> Starts:
        """Return the values of the tunable parameters.

        Parameters
        ----------
        p : Signals
            The parameters of the block [units as the FMU states].
        """
        known = self.description.variables
        return {
            name: value
            for name, value in self._values(p).items()
            if known[name].variability == "tunable"
        }

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        """Return the inputs with direct feedthrough to each output, by the block's names."""
        found: dict[str, tuple[str, ...]] = {}
        for name, group in self.outputs.groups.items():
            # One set for each variable; None means all inputs, if the FMU does not state them.
            known = [self.description.dependencies.get(v.name) for v in group.variables]
            everything = None in known
            needed = frozenset().union(*(names for names in known if names is not None))
            found[name] = tuple(
                inlet
                for inlet, other in self.inputs.groups.items()
                if everything or any(v.name in needed for v in other.variables)
            )
        return found

    def variables(self) -> dict[str, tuple[str, ...]]:
        """Return the names of the FMU variables of each name of the block."""
        groups: dict[str, VariableGroup] = {}
        for vector in (self.inputs, self.outputs, self.parameters, self.states):
            groups |= vector.groups
        return {
            name: tuple(v.name for v in group.variables)
            for name, group in groups.items()
        }

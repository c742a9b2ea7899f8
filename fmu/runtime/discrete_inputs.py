"""Separation of continuous inputs from inputs that may change at events only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.support.types import Vector
from trussflow.fmu.runtime.description import REAL_TYPES, FmuVariable
from trussflow.fmu.runtime.library import Library
from trussflow.fmu.runtime.variable_buffers import VariableBuffers


class DiscreteInputs:
    """The discrete inputs among the inputs of an instance: they may change at events only.

    Parameters
    ----------
    inputs : VariableBuffers
        Buffers of all inputs, bound.
    library : Library
        Library of the instance.

    Attributes
    ----------
    places : array of int
        Indices of the elements of the discrete inputs in the vector of all inputs.
    """

    def __init__(self, inputs: VariableBuffers, library: Library) -> None:
        continuous = continuous_elements(inputs.variables)
        self.places = np.flatnonzero(~continuous)
        self._continuous = inputs
        self._continuous_places: Any = slice(None)
        if self.places.size:
            self._continuous_places = np.flatnonzero(continuous)
            variables = [v for v in inputs.variables if is_continuous(v)]
            self._continuous = VariableBuffers(variables, library, writes=True)
            self._continuous.bind()

    def write_continuous(self, u: Vector) -> None:
        """Set the continuous inputs.

        Parameters
        ----------
        u : Vector
            All inputs [units as the FMU states].
        """
        if self._continuous.values.size:
            self._continuous.values[:] = u[self._continuous_places]
            self._continuous.write()


def is_continuous(variable: FmuVariable) -> bool:
    """Return whether a `variable` may change between events."""
    return variable.variability == "continuous" and variable.type in REAL_TYPES


def continuous_elements(variables: Sequence[FmuVariable]) -> NDArray[np.bool_]:
    """Return whether each element of `variables` may change between events."""
    flags = [np.full(v.size, is_continuous(v)) for v in variables]
    return np.concatenate([np.zeros(0, dtype=bool), *flags])

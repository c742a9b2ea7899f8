"""Separation of continuous inputs from inputs that may change at events only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.types import Vector
from trussflow.fmu.runtime.description import REAL_TYPES, FmuVariable
from trussflow.fmu.runtime.library import Library
from trussflow.fmu.runtime.variable_buffers import VariableBuffers


class SplitInputs:
    """The inputs of an instance that has events.

    Parameters
    ----------
    everything : VariableBuffers
        Buffers of all inputs, bound.
    library : Library
        Library of the instance.
    """

    def __init__(self, everything: VariableBuffers, library: Library) -> None:
        self._everything = everything
        inputs = everything.variables
        smooth = smooth_elements(inputs)
        self._places, self.jumping = np.flatnonzero(smooth), np.flatnonzero(~smooth)
        self._smooth = everything
        if self.jumping.size:
            self._smooth = VariableBuffers([v for v in inputs if is_smooth(v)], library, writes=True)
            self._smooth.bind()

    def write_smooth(self, u: Vector) -> None:
        """Set the continuous inputs.

        Parameters
        ----------
        u : Vector
            All inputs [units as the FMU states].
        """
        if self._places.size:
            self._smooth.values[:] = u if self._smooth is self._everything else u[self._places]
            self._smooth.write()


def is_smooth(variable: FmuVariable) -> bool:
    """Return whether a `variable` may change between events."""
    return variable.variability == "continuous" and variable.type in REAL_TYPES


def smooth_elements(variables: Sequence[FmuVariable]) -> NDArray[np.bool_]:
    """Return whether each element of `variables` may change between events."""
    flags = [np.full(v.size, is_smooth(v)) for v in variables]
    return np.concatenate([np.zeros(0, dtype=bool), *flags])

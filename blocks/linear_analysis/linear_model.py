"""Linear model of python-control with its operating point and the names of its signals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import control

from trussflow.blocks.linear_analysis.operating_point import OperatingPoint


class LinearModel(control.StateSpace):  # type: ignore[misc] # python-control ships no types
    """A linearized diagram: a ``control.StateSpace`` with its operating point.

    Operations of python-control (products, feedback, conversions) return a plain StateSpace.

    Parameters
    ----------
    *matrices : array
        A, B, C, D, and the sample time of a discrete model.
    operating_point : OperatingPoint
        Operating point of the linearization.
    derivatives : dict
        Method of differentiation of each Python block, keyed by path; all other derivatives
        are exact.
    **names
        As for ``control.StateSpace``: inputs, outputs, states, name.
    """

    def __init__(
        self,
        *matrices: Any,
        operating_point: OperatingPoint,
        derivatives: Mapping[str, str],
        **names: Any,
    ) -> None:
        # By default python-control removes states without influence; the names of the
        # states would no longer match.
        super().__init__(*matrices, remove_useless_states=False, **names)
        self.operating_point = operating_point
        self.derivatives = dict(derivatives)

    def __reduce__(self) -> tuple[Callable[[], LinearModel], tuple[()]]:
        """Pickle and copy by the constructor arguments: python-control keeps functions that cannot be pickled."""
        matrices = self.A, self.B, self.C, self.D, self.dt
        about: dict[str, Any] = {
            "operating_point": self.operating_point,
            "derivatives": self.derivatives,
            "inputs": self.input_labels,
            "outputs": self.output_labels,
            "states": self.state_labels,
            "name": self.name,
        }
        return partial(LinearModel, *matrices, **about), ()

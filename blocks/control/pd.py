"""Proportional-derivative control."""

from __future__ import annotations

import numpy.typing as npt

from trussflow.blocks.control.tracking import Tracking, errors
from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals
from trussflow.blocks.framework.port import INFERRED, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.signals import ShapeLike
from trussflow.blocks.support.types import Array


class PD(Tracking):
    r"""Proportional-derivative control.

    .. math:: f = -k_p e - k_d \dot e, \qquad e = x - x_d

    Each gain is one number, or one per element.

    Parameters
    ----------
    proportional_gain : array_like
        k_p ≥ 0 [force unit / unit].
    derivative_gain : array_like
        k_d ≥ 0 [force unit s / unit].
    unit, force_unit : str, tuple of str or None
        Units of position and force, or one per element; None leaves units unchecked.
    shape : int, tuple of int or None
        Shape of all signals [-]; None takes it from the gains, or else from the wires.

    Raises
    ------
    ParameterError
        If a gain is negative, or shapes disagree.
    """

    force = Output(INFERRED, unit=Attribute("force_unit"), meaning="commanded force")
    proportional_gain = Parameter(shape=None, minimum=0.0, meaning="k_p")
    derivative_gain = Parameter(shape=None, minimum=0.0, meaning="k_d")
    _symbol = Symbol(
        "−{proportional_gain:k_p} e − {derivative_gain:k_d} ė", caption="e = x − x_d"
    )

    def __init__(
        self,
        proportional_gain: npt.ArrayLike,
        derivative_gain: npt.ArrayLike,
        *,
        unit: Unit = None,
        force_unit: Unit = None,
        shape: ShapeLike = None,
    ) -> None:
        self.force_unit = force_unit
        super().__init__(
            shape,
            unit,
            proportional_gain=proportional_gain,
            derivative_gain=derivative_gain,
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return force and errors."""
        e, de = errors(u)
        force = -p.proportional_gain * e - p.derivative_gain * de
        return {"force": force, "error": e, "error_rate": de}

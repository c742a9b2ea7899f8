"""Inputs and error signals that tracking controllers share."""

from __future__ import annotations

from trussflow.blocks.framework.declarations import Attribute, Signals
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.signals import (
    VELOCITY_UNIT,
    Shaped,
    ShapeLike,
    set_motion_units,
)
from trussflow.blocks.support.types import Array


class Tracking(Shaped):
    r"""Base of controllers that make a position follow a reference.

    .. math:: e = x - x_d, \qquad \dot e = \dot x - \dot x_d

    Parameters
    ----------
    shape : int, tuple of int or None
        Shape of all signals [-]; None takes it from the parameters, or else from the wires.
    unit : str, tuple of str or None
        Unit of the position, or one per element; None leaves units unchecked.
    **parameters : array_like
        Parameters of the controller.
    """

    reference_position = Input(INFERRED, unit=Attribute("unit"), meaning="where to be")
    reference_velocity = Input(INFERRED, unit=VELOCITY_UNIT, meaning="its rate")
    position = Input(INFERRED, unit=Attribute("unit"), meaning="measured position")
    velocity = Input(INFERRED, unit=VELOCITY_UNIT, meaning="measured velocity")
    error = Output(INFERRED, unit=Attribute("unit"), meaning="position minus reference")
    error_rate = Output(
        INFERRED, unit=VELOCITY_UNIT, meaning="velocity minus reference"
    )

    def __init__(self, shape: ShapeLike, unit: Unit, **parameters: object) -> None:
        set_motion_units(self, unit)
        super().__init__(shape, **parameters)


def errors(u: Signals) -> tuple[Array, Array]:
    """Return position and velocity error of a tracking controller's inputs."""
    return u.position - u.reference_position, u.velocity - u.reference_velocity

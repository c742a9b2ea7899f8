"""Disturbance observer."""

from __future__ import annotations

import numpy.typing as npt

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.signals import (
    ACCELERATION_UNIT,
    VELOCITY_UNIT,
    Shaped,
    ShapeLike,
    set_motion_units,
)
from trussflow.blocks.support.types import Array


class DisturbanceObserver(Shaped):
    r"""Estimate the disturbance of a rate from the signal and its known rate.

    .. math::

        \hat d = L v + z, \qquad \dot z = -L \hat d - L a

    so that :math:`\dot{\hat d} = L (d - \hat d)`: a first-order lag, with an ultimate error
    of at most ξ/L where :math:`\|\dot d\| \le \xi`. The estimate starts at zero. If the estimate is
    compensated, the known acceleration a must contain the compensation; otherwise the estimate of a constant d
    settles at d/2.

    Parameters
    ----------
    gain : array_like
        L > 0 [1/s]; one number, or one per element.
    unit : str, tuple of str or None
        Unit of the position whose rate v is, or one per element; None leaves units unchecked.
    shape : int, tuple of int or None
        Shape of all signals [-]; None takes it from the gain, or else from the wires.

    Raises
    ------
    ParameterError
        If the gain is not allowed, or shapes disagree.

    References
    ----------
    Li, Wei, Chen (2026), *Anti-Disturbance Trajectory Tracking Control of Large Space
    Flexible Truss by Four Space Robots*, eq. (46) with theorem 1; the known acceleration
    is G^-1 (u - c) there.
    """

    velocity = Input(INFERRED, unit=VELOCITY_UNIT, meaning="measured velocity")
    nominal_acceleration = Input(
        INFERRED,
        unit=ACCELERATION_UNIT,
        meaning="a: known part of the acceleration, compensation included",
    )
    disturbance_estimate = Output(
        INFERRED, unit=ACCELERATION_UNIT, meaning="estimated disturbance acceleration"
    )
    z = State(INFERRED, meaning="estimate less gain times velocity")
    gain = Parameter(shape=None, above=0.0, unit="1/s", meaning="L: bandwidth")
    _symbol = Symbol("d̂ = z + {gain:L} v\nż = −{gain:L} (d̂ + a)")

    def __init__(
        self, gain: npt.ArrayLike, *, unit: Unit = None, shape: ShapeLike = None
    ) -> None:
        set_motion_units(self, unit)
        super().__init__(shape, gain=gain)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the estimate, which does not depend on the acceleration of the same instant."""
        return {"disturbance_estimate": p.gain * u.velocity + x.z}

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the rate of z."""
        # With dv/dt = nominal + d, the rate of the estimate L v + z is L (d -
        # estimate): the estimate follows d without a measured acceleration.
        estimate = p.gain * u.velocity + x.z
        return {"z": -p.gain * (estimate + u.nominal_acceleration)}

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Return the z at which the estimate starts at zero."""
        return {"z": -p.gain * u.velocity}

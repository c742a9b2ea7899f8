"""Sliding-mode tracking control, as commanded accelerations.

Both controllers compute an acceleration in task coordinates. Other blocks convert it to
forces (inertia, velocity terms, allocation), so the controllers suit any plant of the
same size.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trussflow.blocks.control.tracking import Tracking, errors
from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.piecewise import limited
from trussflow.blocks.library.signals import ACCELERATION_UNIT, VELOCITY_UNIT, ShapeLike
from trussflow.blocks.support.types import Array
from trussflow.blocks.tracing.kernels import elementwise
from trussflow.blocks.tracing.memoized import memoized


def signed_power(x: Array, exponent: Array) -> Array:
    r"""Return :math:`\mathrm{sgn}^b(x) = |x|^b\,\mathrm{sgn}(x)`, element by element.

    For b < 1 the slope at zero is infinite. Automatic derivatives at exactly zero get the
    slope 1 of the linear law b = 1 instead, so that linearization and implicit solvers see
    finite numbers there.

    Parameters
    ----------
    x : array
        Any value [any].
    exponent : array
        b > 0 [1].
    """
    return elementwise(_signed_power, x, exponent)


def _signed_power(x: Array, exponent: Array) -> Array:
    size = np.abs(x)
    return np.where(size > 0.0, np.sign(x) * size**exponent, x)


def unit_vector(x: Array, layer: Array) -> Array:
    r"""Return :math:`x / (\|x\| + \iota)`, with exact derivatives also at zero.

    Parameters
    ----------
    x : array
        Any value [any].
    layer : array, shape ()
        Boundary layer ι > 0 [unit of x].
    """
    square = np.sum(x**2)
    # The root has no derivative at exactly zero, where it does not matter either.
    return x / (np.where(square > 0.0, np.sqrt(square), 0.0) + layer)


class SlidingMode(Tracking):
    """Base of sliding-mode controllers: the ports that they share."""

    reference_acceleration = Input(
        INFERRED, unit=ACCELERATION_UNIT, meaning="second derivative of the reference"
    )
    acceleration = Output(
        INFERRED, unit=ACCELERATION_UNIT, meaning="commanded: feedforward + feedback"
    )
    feedforward = Output(
        INFERRED, unit=ACCELERATION_UNIT, meaning="acceleration of the reference"
    )
    feedback = Output(
        INFERRED, unit=ACCELERATION_UNIT, meaning="what the errors add to it"
    )
    sliding_variable = Output(
        INFERRED, unit=VELOCITY_UNIT, meaning="zero on the sliding surface"
    )


def _commanded(
    u: Signals,
    feedback: Array,
    sliding_variable: Array,
    error: Array,
    error_rate: Array,
) -> Values:
    """Return all outputs of a law that adds `feedback` to the reference."""
    return {
        "acceleration": u.reference_acceleration + feedback,
        "feedforward": u.reference_acceleration,
        "feedback": feedback,
        "sliding_variable": sliding_variable,
        "error": error,
        "error_rate": error_rate,
    }


class IntegralSlidingMode(SlidingMode):
    r"""Integral sliding-mode control with fractional powers.

    .. math::

        s &= \dot e + \int_0^t \gamma\,\mathrm{sgn}^\beta(\dot e)
             + \mu\,\mathrm{sgn}^{\beta/(2-\beta)}(e)\;dt \\
        a &= \ddot x_d - \gamma\,\mathrm{sgn}^\beta(\dot e)
             - \mu\,\mathrm{sgn}^{\beta/(2-\beta)}(e)
             - \eta \frac{s}{\|s\| + \iota} - \sigma s

    If the plant follows a up to a disturbance d, then s obeys
    :math:`\dot s = d - \eta s / (\|s\| + \iota) - \sigma s`. Each gain is one number, or one
    per element.

    Parameters
    ----------
    gamma, mu : array_like
        γ, μ > 0 [1/s, 1/s^2 for β = 1]; that makes p² + γp + μ Hurwitz.
    beta : float
        β, above 0 and at most 1 [1]; at 1 the law is linear but for the term with η. Below 1 the slope at
        zero error is infinite, and a linearization there takes that of β = 1.
    eta : array_like
        η ≥ 0 [unit/s^2], reaching gain.
    sigma : array_like
        σ ≥ 0 [1/s], linear reaching gain.
    boundary_layer : float
        ι > 0 [unit/s]; smooths the reaching term near the surface.
    unit : str, tuple of str or None
        Unit of the position, or one per element; None leaves units unchecked.
    shape : int, tuple of int or None
        Shape of all signals [-]; None takes it from the gains, or else from the wires.

    Raises
    ------
    ParameterError
        If a gain is not allowed, or shapes disagree.

    References
    ----------
    Li, Wei, Chen (2026), *Anti-Disturbance Trajectory Tracking Control of Large Space
    Flexible Truss by Four Space Robots*, eqs. (52)-(54), (62); the acceleration is what
    stands behind G J_g^-1 there.
    """

    integral = State(INFERRED, meaning="integral term of the sliding variable")
    gamma = Parameter(shape=None, above=0.0, meaning="γ: gain of the error rate")
    mu = Parameter(shape=None, above=0.0, meaning="μ: gain of the error")
    beta = Parameter(above=0.0, maximum=1.0, meaning="β: exponent")
    eta = Parameter(shape=None, minimum=0.0, meaning="η: reaching gain")
    sigma = Parameter(
        shape=None, minimum=0.0, unit="1/s", meaning="σ: linear reaching gain"
    )
    boundary_layer = Parameter(above=0.0, meaning="ι: boundary layer")
    _symbol = Symbol(
        "ẍ_d − {gamma:γ} sgn^(β)ė − {mu:μ} sgn^(β′)e\n− {eta:η} s/‖s‖ − {sigma:σ} s",
        caption="e = x − x_d, s = ė + ∫({gamma:γ} sgn^(β)ė + {mu:μ} sgn^(β′)e) dt",
    )

    def __init__(
        self,
        *,
        gamma: npt.ArrayLike,
        mu: npt.ArrayLike,
        beta: float,
        eta: npt.ArrayLike,
        sigma: npt.ArrayLike,
        boundary_layer: float,
        unit: Unit = None,
        shape: ShapeLike = None,
    ) -> None:
        super().__init__(
            shape,
            unit,
            gamma=gamma,
            mu=mu,
            beta=beta,
            eta=eta,
            sigma=sigma,
            boundary_layer=boundary_layer,
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the commanded acceleration and its parts, and the errors."""
        e, de, nominal = self._nominal(u, p)
        s = de + x.integral
        reaching = p.eta * unit_vector(s, p.boundary_layer) + p.sigma * s
        feedback = -nominal - reaching
        return _commanded(u, feedback, s, e, de)

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the integrand of the sliding variable."""
        return {"integral": self._nominal(u, p)[-1]}

    @memoized
    def _nominal(self, u: Signals, p: Signals) -> tuple[Array, Array, Array]:
        """Return the errors, and the error dynamics that the controller imposes on the sliding surface."""
        e, de = errors(u)
        rate = p.gamma * signed_power(de, p.beta)
        return e, de, rate + p.mu * signed_power(e, p.beta / (2.0 - p.beta))


class ConventionalSlidingMode(SlidingMode):
    r"""Sliding-mode control with a linear surface and a switching term.

    .. math::

        s &= \dot e + \lambda e \\
        a &= \ddot x_d - \lambda \dot e - \eta\,\mathrm{sgn}(s)

    so that :math:`\dot s = d - \eta\,\mathrm{sgn}(s)` for a disturbance d. With a boundary
    layer, sgn(s) becomes s/ι where \|s\| < ι. Each gain is one number, or one per element.

    Parameters
    ----------
    slope : array_like
        λ > 0 [1/s].
    eta : array_like
        η ≥ 0 [unit/s^2], switching gain.
    boundary_layer : array_like
        ι ≥ 0 [unit/s]; 0 switches.
    unit : str, tuple of str or None
        Unit of the position, or one per element; None leaves units unchecked.
    shape : int, tuple of int or None
        Shape of all signals [-]; None takes it from the gains, or else from the wires.

    Raises
    ------
    ParameterError
        If a gain is not allowed, or shapes disagree.

    References
    ----------
    Li, Wei, Chen (2026), section 4.4, the comparison: λ = 2, η = 0.001, no boundary layer.
    """

    slope = Parameter(
        shape=None, above=0.0, unit="1/s", meaning="λ: slope of the surface"
    )
    eta = Parameter(shape=None, minimum=0.0, meaning="η: switching gain")
    boundary_layer = Parameter(shape=None, minimum=0.0, meaning="ι: boundary layer")
    _symbol = Symbol(
        "ẍ_d − {slope:λ} ė − {eta:η} sgn(s)\ns = ė + {slope:λ} e", caption="e = x − x_d"
    )

    def __init__(
        self,
        *,
        slope: npt.ArrayLike,
        eta: npt.ArrayLike,
        boundary_layer: npt.ArrayLike = 0.0,
        unit: Unit = None,
        shape: ShapeLike = None,
    ) -> None:
        super().__init__(
            shape, unit, slope=slope, eta=eta, boundary_layer=boundary_layer
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the commanded acceleration and its parts, and the errors."""
        e, de = errors(u)
        s = de + p.slope * e
        layer = p.boundary_layer
        # Both branches of the `where` below are computed: without a layer, divide by 1.
        inside = limited(s / np.where(layer > 0.0, layer, 1.0), -1.0, 1.0)
        feedback = -p.slope * de - p.eta * np.where(layer > 0.0, inside, np.sign(s))
        return _commanded(u, feedback, s, e, de)

"""What a Kalman filter believes: how the state goes on by one sample, and what the sensors show of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from trussflow.blocks.framework.errors import BlockError, Explained, TracingError, TrussflowError
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.tracing.array_function import ArrayFunction
from trussflow.blocks.tracing.calling import brief


class Process(Protocol):
    """A model in steps of one sample, the command held in each.

    Attributes
    ----------
    noise : Vector, shape (m, m)
        R: covariance of the noise in one measurement [as declared].
    """

    @property
    def noise(self) -> Vector: ...

    def step(self, t: Array, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return the state one sample later, its Jacobian Φ, and the covariance of what noise adds."""

    def measure(self, t: Array, x: Array, u: Array) -> tuple[Array, Array]:
        """Return what the sensors show, and its Jacobian H by the state."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearProcess:
    r"""A linear process, with white sequences w and v.

    .. math:: x_{k+1} = \Phi x_k + \Gamma u_k + a + w_k, \qquad y_k = C x_k + D u_k + b + v_k

    Attributes
    ----------
    A, B, C, D : Vector
        Φ, Γ, C, D [any].
    covariance, noise : Vector
        Covariances of w and of v [any].
    drift, bias : Vector
        The constants a and b [any].
    """

    A: Vector
    B: Vector
    C: Vector
    D: Vector
    covariance: Vector
    noise: Vector
    drift: Vector
    bias: Vector

    def step(self, t: Array, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return Φ x + Γ u + a, Φ and the covariance of w."""
        return self.A @ x + self.B @ u + self.drift, self.A, self.covariance

    def measure(self, t: Array, x: Array, u: Array) -> tuple[Array, Array]:
        """Return C x + D u + b, and C."""
        return self.C @ x + self.D @ u + self.bias, self.C


class NonlinearProcess:
    r"""A nonlinear process in continuous time, its measurements sampled.

    .. math:: \dot x = f(t, x, u) + w, \qquad y_k = h(t_k, x_k, u_k) + v_k

    Each step of length T is two RK4 steps. With :math:`\Phi_2` the exact Jacobian of the second, and
    :math:`\Phi` that of both, the noise adds

    .. math:: \tfrac T 6 \left(\Phi Q \Phi^T + 4 \Phi_2 Q \Phi_2^T + Q\right),

    which is Simpson's rule for the integral of :math:`\Phi Q \Phi^T` and as semidefinite as Q is.

    Parameters
    ----------
    rates, outputs : callable
        f and h, functions of (t, x, u) that trace [as declared].
    density : Vector or callable
        Q: power spectral density of w, a matrix or a function of (t, x, u) [rate² s].
    noise : Vector
        Covariance of v [as declared].
    sizes : tuple of int
        Number of states, and of commands [-].
    period : float
        Length of a sample [s].
    steps : int
        Steps in one sample [-].

    Raises
    ------
    TracingError
        If a function cannot be traced.
    BlockError
        If one returns another number of elements.
    """

    def __init__(
        self,
        rates: Callable[..., Array],
        outputs: Callable[..., Array],
        density: Vector | Callable[..., Array],
        noise: Vector,
        sizes: tuple[int, int],
        period: float,
        steps: int,
    ) -> None:
        self.noise, self._length, self._steps, self._size = noise, period / steps, steps, sizes[0]
        self._density = density if callable(density) else lambda t, x, u: density
        shapes = (), (sizes[0],), (sizes[1],)
        for name, function, size in (("rates", rates, sizes[0]), ("outputs", outputs, len(noise))):
            with Explained(partial(_untraced, name)):
                shape = ArrayFunction.of(function, shapes).shape
            if shape != (size,):
                raise BlockError(
                    f"'{name}' of a Kalman filter must return a vector of {size} elements, not of {shape[0]}"
                )
        self._half = ArrayFunction.of(partial(_rk4, rates, self._length / 2), shapes)
        self._outputs = ArrayFunction.of(outputs, shapes)
        self._half_by_x, self._outputs_by_x = self._half.jacobian(1), self._outputs.jacobian(1)

    def step(self, t: Array, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return the state one sample later, its Jacobian, and the covariance of what noise adds."""
        h, whole, covariance = self._length, np.eye(self._size), np.zeros((self._size, self._size))
        for _ in range(self._steps):
            middle, first = self._half(t, x, u), self._half_by_x(t, x, u)
            end, second = self._half(t + h / 2, middle, u), self._half_by_x(t + h / 2, middle, u)
            both = second @ first
            early, half_way = self._density(t, x, u), self._density(t + h / 2, middle, u)
            added = both @ early @ both.T + 4 * second @ half_way @ second.T + self._density(t + h, end, u)
            whole, covariance = both @ whole, both @ covariance @ both.T + h / 6 * added
            t, x = t + h, end
        return x, whole, covariance

    def measure(self, t: Array, x: Array, u: Array) -> tuple[Array, Array]:
        """Return h, and its exact Jacobian by the state."""
        return self._outputs(t, x, u), self._outputs_by_x(t, x, u)


def _rk4(rates: Callable[..., Array], h: float, t: Array, x: Array, u: Array) -> Array:
    """Return the state after one RK4 step."""
    k1 = rates(t, x, u)
    k2 = rates(t + h / 2, x + h / 2 * k1, u)
    k3 = rates(t + h / 2, x + h / 2 * k2, u)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(t + h, x + h * k3, u))


def _untraced(name: str, error: Exception) -> TrussflowError:
    return TracingError(
        f"'{name}' of a Kalman filter is called with (t, x, u) and cannot be traced: {brief(error)}\n"
        "  blocks/tracing/README.md lists what traces"
    )

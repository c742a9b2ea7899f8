"""Process models of Kalman filters: propagation by one sample, and measurement equation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import casadi as ca
import numpy as np
import numpy.typing as npt

from trussflow.blocks.control.covariances import covariance as checked
from trussflow.blocks.control.covariances import sampled_covariance
from trussflow.blocks.errors import BlockError, Explained, TracingError
from trussflow.blocks.library.linear import matrices
from trussflow.blocks.linear_analysis.lifting import held_flow
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import (
    as_shape,
    finite_array,
    positive,
    positive_whole,
)
from trussflow.blocks.tracing.call_checks import brief
from trussflow.blocks.tracing.kernels import (
    expressions,
    from_expression,
    is_traced,
    symbol,
    to_expression,
)


@dataclass(frozen=True, eq=False)
class ArrayFunction:
    """A function traced once; a call inlines it for traced arrays, and evaluates it for numbers.

    Attributes
    ----------
    function : casadi.Function
        Function from the arguments, as row-major columns, to one such column.
    shape : tuple of int
        Shape of the result [-].
    """

    function: ca.Function
    shape: tuple[int, ...]

    @classmethod
    def of(
        cls, function: Callable[..., Array], shapes: Sequence[tuple[int, ...]]
    ) -> ArrayFunction:
        """Trace a function that returns a vector.

        Parameters
        ----------
        function : callable
            Function as for a `Function` block.
        shapes : sequence of tuple of int
            Shapes of its arguments [-].
        """
        arguments = [symbol(f"a{i}", shape) for i, shape in enumerate(shapes)]
        value = to_expression(function(*arguments))
        return cls(
            ca.Function("array", expressions(arguments), ca.cse([ca.densify(value)])),
            (value.numel(),),
        )

    def __call__(self, *arguments: Array) -> Array:
        """Return the value for arguments of the traced shapes."""
        if any(map(is_traced, arguments)):
            return from_expression(self.function(*expressions(arguments)), self.shape)
        return np.reshape(self.function(*map(np.ravel, arguments)).full(), self.shape)

    def jacobian(self, number: int) -> ArrayFunction:
        """Return the function of the exact Jacobian with respect to the argument with this index."""
        symbols = self.function.sx_in()
        # CasADi's `vec` is column-major; of the transposed matrix it is row-major.
        matrix = ca.jacobian(self.function(*symbols), symbols[number])
        return ArrayFunction(
            ca.Function("jacobian", symbols, [ca.densify(ca.vec(matrix.T))]),
            matrix.shape,
        )


class Process:
    """Process model in steps of one sample, with held commands.

    Parameters
    ----------
    every : float
        Length of a sample [s].
    noise : array_like
        Covariance of the noise of one measurement, positive definite; one number or a vector is a
        diagonal [any].
    sizes : tuple of int
        Number of states, measurements and commands [-].
    state_names : sequence of str, optional
        Names of the states, such as ``"plant/position[0]"``; by default ``x[0]`` and so on.

    Raises
    ------
    ParameterError
        If the covariance is not symmetric and positive definite.
    BlockError
        If the number of names differs from the number of states.
    SimulationError
        If `every` is not above 0.
    """

    def __init__(
        self,
        every: float,
        noise: npt.ArrayLike,
        sizes: Sequence[int],
        state_names: Sequence[str] | None,
    ) -> None:
        positive(every=every)
        self.every, (self.order, self.measurements, self.commands) = every, sizes
        self.noise = checked(
            "measurement noise", noise, self.measurements, definite=True
        )
        self.state_names = tuple(state_names or (f"x[{i}]" for i in range(self.order)))
        if len(self.state_names) != self.order:
            raise BlockError(
                f"a process of {self.order} states cannot have {len(self.state_names)} names"
            )

    def step(self, t: Array, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return the state one sample later, its Jacobian, and the covariance added by noise.

        Parameters
        ----------
        t : Array
            Time [s].
        x, u : Array
            State and command [as declared].
        """
        raise NotImplementedError

    def measure(self, t: Array, x: Array, u: Array) -> tuple[Array, Array]:
        """Return the measurement and its Jacobian with respect to the state.

        Parameters
        ----------
        t : Array
            Time [s].
        x, u : Array
            State and command [as declared].
        """
        raise NotImplementedError


class LinearProcess(Process):
    r"""A linear process, sampled, with white sequences w and v.

    .. math:: x_{k+1} = A x_k + B u_k + a + w_k, \qquad y_k = C x_k + D u_k + b + v_k

    Parameters
    ----------
    A, B, C, D : array_like
        Matrices [any]; shapes as for `DiscreteStateSpace`.
    every : float
        Length of a sample [s].
    covariance, noise : array_like
        Covariances of w, positive semidefinite, and of v, positive definite; one number or a vector is a
        diagonal [any].
    drift, bias : array_like
        The constants a and b [any].
    state_names : sequence of str, optional
        Names of the states.

    Raises
    ------
    BlockError
        If sizes do not fit, or a covariance is not positive (semi)definite.
    """

    def __init__(
        self,
        A: npt.ArrayLike,
        B: npt.ArrayLike,
        C: npt.ArrayLike,
        D: npt.ArrayLike = 0.0,
        *,
        every: float,
        covariance: npt.ArrayLike,
        noise: npt.ArrayLike,
        drift: npt.ArrayLike = 0.0,
        bias: npt.ArrayLike = 0.0,
        state_names: Sequence[str] | None = None,
    ) -> None:
        self.A, B, C, D = matrices("LinearProcess", A, B, C, D)
        # B, C and D are vectors for scalar inputs and outputs; make them matrices.
        n, self.C = len(self.A), np.atleast_2d(C)
        m, self.B = len(self.C), B.reshape(n, -1)
        self.D = D.reshape(m, -1)
        super().__init__(every, noise, (n, m, self.B.shape[1]), state_names)
        self.covariance = checked("process noise", covariance, n)
        self.drift, self.bias = (
            finite_array("drift", drift, (n,)),
            finite_array("bias", bias, (m,)),
        )

    def step(self, t: Array, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return A x + B u + a of `x` and `u` [as declared], A and the covariance of w, at any `t` [s]."""
        return self.A @ x + self.B @ u + self.drift, self.A, self.covariance

    def measure(self, t: Array, x: Array, u: Array) -> tuple[Array, Array]:
        """Return C x + D u + b of `x` and `u` [as declared], and C, at any `t` [s]."""
        return self.C @ x + self.D @ u + self.bias, self.C


class NonlinearProcess(Process):
    r"""A nonlinear process in continuous time, its measurements sampled.

    .. math:: \dot x = f(t, x, u) + w, \qquad y_k = h(t_k, x_k, u_k) + v_k

    Each step of length T is two RK4 steps. With :math:`\Phi_2` the exact Jacobian of the second, and
    :math:`\Phi` that of both, the noise adds

    .. math:: \tfrac T 6 \left(\Phi Q \Phi^T + 4 \Phi_2 Q \Phi_2^T + Q\right),

    which is Simpson's rule for the integral of :math:`\Phi Q \Phi^T` and as semidefinite as Q is.

    Parameters
    ----------
    rates, outputs : callable
        f and h: functions of (t, x, u) that trace, as those of `Function` [as declared].
    states, measurements, commands : int
        Sizes of x, y and u [-].
    every : float
        Length of a sample [s].
    density : array_like or callable
        Q: power spectral density of w, positive semidefinite; one number or a vector is a diagonal, a
        function of (t, x, u) must return a matrix [rate² s].
    noise : array_like
        Covariance of v, positive definite [as declared].
    steps : int
        Integration steps per sample [-].
    state_names : sequence of str, optional
        Names of the states.

    Raises
    ------
    TracingError
        If a function cannot be traced.
    BlockError
        If a function returns another number of elements, or a covariance is not positive (semi)definite.
    """

    def __init__(
        self,
        rates: Callable[..., Array],
        outputs: Callable[..., Array],
        *,
        states: int,
        measurements: int,
        commands: int = 0,
        every: float,
        density: npt.ArrayLike | Callable[..., Array],
        noise: npt.ArrayLike,
        steps: int = 1,
        state_names: Sequence[str] | None = None,
    ) -> None:
        positive_whole(steps=steps)
        sizes = as_shape("a Kalman filter", (states, measurements, commands))
        super().__init__(every, noise, sizes, state_names)
        self._steps, self._shapes = steps, ((), (states,), (commands,))
        self._rates = self._traced("rates", rates, states)
        self._outputs = self._traced("outputs", outputs, measurements)
        matrix = (
            np.zeros(0)
            if callable(density)
            else checked("process noise", density, states)
        )
        self._density = density if callable(density) else lambda *_: matrix

    def _traced(
        self, name: str, function: Callable[..., Array], size: int
    ) -> ArrayFunction:
        with Explained(
            lambda error: TracingError(
                f"'{name}' of a Kalman filter is called with (t, x, u) and cannot be traced: {brief(error)}\n"
                "  docs/traceable.md lists the supported operations"
            )
        ):
            found = ArrayFunction.of(function, self._shapes)
        if found.shape != (size,):
            raise BlockError(
                f"'{name}' of a Kalman filter must return {size} elements, not {found.shape[0]}"
            )
        return found

    @cached_property
    def _parts(self) -> tuple[ArrayFunction, ...]:
        """Half a step, its Jacobian, and the Jacobian of the outputs."""
        half = ArrayFunction.of(
            partial(_rk4, self._rates, self.every / self._steps / 2), self._shapes
        )
        return half, half.jacobian(1), self._outputs.jacobian(1)

    def step(self, t: Array, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return state one sample after `x` [as declared] at `t` [s], Jacobian and noise covariance."""
        (half, by_x, _), Q, h = self._parts, self._density, self.every / self._steps
        whole, spread = np.eye(self.order), np.zeros((self.order, self.order))
        for _ in range(self._steps):
            middle, first = half(t, x, u), by_x(t, x, u)
            end, second = half(t + h / 2, middle, u), by_x(t + h / 2, middle, u)
            # Simpson's rule: noise at the start passes through both halves of the step,
            # noise in the middle through the second half, noise at the end through none.
            both = second @ first
            added = (
                both @ Q(t, x, u) @ both.T
                + 4 * second @ Q(t + h / 2, middle, u) @ second.T
            )
            spread = both @ spread @ both.T + h / 6 * (added + Q(t + h, end, u))
            whole, t, x = both @ whole, t + h, end
        return x, whole, spread

    def measure(self, t: Array, x: Array, u: Array) -> tuple[Array, Array]:
        """Return h(`t`, `x`, `u`) [as declared], and its exact Jacobian with respect to the state."""
        return self._outputs(t, x, u), self._parts[2](t, x, u)

    def linearized(self, t: float, x: Vector, u: Vector) -> LinearProcess:
        """Return the linearization of the process at a point, sampled exactly.

        Parameters
        ----------
        t : float
            Time [s].
        x, u : Vector
            State and command [as declared].
        """
        A, B = (self._rates.jacobian(i)(t, x, u) for i in (1, 2))
        C, D = (self._outputs.jacobian(i)(t, x, u) for i in (1, 2))
        # Rates are A x + B u + drift near the point, which need not be at rest. The
        # drift is one more column of B, with an input that is held at 1.
        drift = self._rates(t, x, u) - A @ x - B @ u
        flow, driven = held_flow(A, np.column_stack([B, drift]), self.every)
        return LinearProcess(
            flow,
            driven[:, :-1],
            C,
            D,
            every=self.every,
            covariance=sampled_covariance(A, self._density(t, x, u), self.every),
            noise=self.noise,
            drift=driven[:, -1],
            bias=self._outputs(t, x, u) - C @ x - D @ u,
            state_names=self.state_names,
        )


def _rk4(rates: Callable[..., Array], h: float, t: Array, x: Array, u: Array) -> Array:
    """Return the state after one RK4 step."""
    k1 = rates(t, x, u)
    k2 = rates(t + h / 2, x + h / 2 * k1, u)
    k3 = rates(t + h / 2, x + h / 2 * k2, u)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(t + h, x + h * k3, u))

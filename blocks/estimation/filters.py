"""Kalman filters: sampled blocks that estimate the state of a plant from measurements and commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypedDict, Unpack

import numpy as np
import numpy.typing as npt

from trussflow.blocks.estimation.covariances import covariance, refuse_unobserved, steady_covariance
from trussflow.blocks.estimation.names import places
from trussflow.blocks.estimation.processes import LinearProcess, NonlinearProcess, Process
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.clock import exact, ticks
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.errors import BlockError
from trussflow.blocks.framework.port import Input, Output, Port
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.framework.validation import finite_array, is_whole, positive, positive_whole, shown
from trussflow.blocks.library.linear import matrices
from trussflow.blocks.library.signals import finite
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite


class FilterSettings(TypedDict, total=False):
    """What any filter can be told besides its model."""

    command_delay: float
    measurement_delay: float
    initial_estimate: npt.ArrayLike
    initial_command: npt.ArrayLike
    state_names: Sequence[str] | None
    measurement_unit: Unit
    command_unit: Unit


class Filter(Block):
    r"""Base of Kalman filters; it knows when what is told of what.

    At the instant t_k the measurement shows the plant as it was m samples before, its command arrives n samples
    later, and the command given now is not known yet. So the filter works on the state at t_{k-m}, which the
    command of m + n samples ago drives: with white noise that is the filter without delays, m samples late.
    From there it predicts over the delays with the commands given since, which nobody can do better.

    Parameters
    ----------
    process : Process
        The model.
    order, commands : int
        Number of states, and of commands; without commands there is no port for them [-].
    every : float
        Time between samples [s].
    command_delay, measurement_delay : float
        Multiples of that: until a command acts, and since what is measured [s].
    initial_estimate : array_like, shape (n,)
        Estimate before the first measurement [any].
    initial_command : array_like
        What was commanded before the start [any].
    state_names : sequence of str, optional
        Names of the states, such as ``"plant/position[0]"``; by default ``x[0]`` and so on.
    measurement_unit, command_unit : str, tuple of str or None
        Units of the inputs, or one per element; None leaves them unchecked.
    **parameters : array_like
        Parameters of the filter.

    Raises
    ------
    BlockError
        If a delay is negative, or there are not as many names as states.
    SimulationError
        If a delay is no multiple of the sample time.
    """

    measurement = Input("measurements", unit=Attribute("measurement_unit"), meaning="what the sensors show")
    estimate = Output("order", meaning="state now, from all measurements so far")
    prediction = Output("order", meaning="state when the command given now begins to act")
    innovation = Output("measurements", meaning="measurement less what the filter expected")
    predicted = State("order", initial="initial_estimate", meaning="state measured next, expected")
    sent = State(("late", "commands"), initial="initial_command", meaning="commands under way, oldest first")
    initial_estimate = Parameter(shape="order", meaning="estimate before the first measurement")
    initial_command = Parameter(shape=("late", "commands"), meaning="what was commanded before the start")

    def __init__(
        self,
        process: Process,
        order: int,
        commands: int,
        every: float,
        *,
        command_delay: float = 0.0,
        measurement_delay: float = 0.0,
        initial_estimate: npt.ArrayLike = 0.0,
        initial_command: npt.ArrayLike = 0.0,
        state_names: Sequence[str] | None = None,
        measurement_unit: Unit = None,
        command_unit: Unit = None,
        **parameters: npt.ArrayLike,
    ) -> None:
        owner = type(self).__name__
        self.process, self.order, self.commands, self.measurements = (
            process,
            order,
            commands,
            len(process.noise),
        )
        delays = {"command_delay": command_delay, "measurement_delay": measurement_delay}
        found = []
        for name, given in delays.items():
            delay = finite(owner, name, given)
            if delay < 0:
                raise BlockError(
                    f"{owner} cannot have {name} = {delay:g} s: nothing is known before it happens"
                )
            advice = "take a sample time that divides it"
            found.append(ticks(exact(delay), exact(every), f"{name} of {owner}", advice))
        self.ahead, self.behind = found
        self.late = self.ahead + self.behind
        names = [f"x[{i}]" for i in range(order)] if state_names is None else list(state_names)
        if len(names) != order:
            raise BlockError(f"{owner} has {order} states, but {len(names)} state_names")
        self.state_names = tuple(names)
        self.measurement_unit, self.command_unit = measurement_unit, command_unit
        command = Input("commands", unit=Attribute("command_unit"), meaning="what the actuators are told")
        self.extra_ports = {"command": command} if commands else {}
        super().__init__(initial_estimate=initial_estimate, initial_command=initial_command, **parameters)
        self.sampled(every)

    def of(self, name: str, output: str = "estimate") -> Port:
        """Return the part of an output that is a state, such as ``of("plant.position[0:3]")``.

        Parameters
        ----------
        name : str
            Name of the state.
        output : str
            Which output, ``"estimate"`` or ``"prediction"``.

        Raises
        ------
        NameLookupError
            If there is no such state; the message lists them.
        """
        return self.port(output)[places(self.state_names, name).tolist()]

    def corrected(
        self, t: Array, x: Signals, u: Signals, command: Array
    ) -> tuple[Array, Array | None, Values]:
        """Return the state measured, its covariance where that is not constant, and further outputs.

        Parameters
        ----------
        t : Array
            When it was measured [s].
        x, u : Signals
            States and inputs of the filter [as declared].
        command : Array
            The command that acted then [as declared].
        """
        raise NotImplementedError

    def _all(self, t: Array, x: Signals, u: Signals) -> tuple[Values, Values]:
        """Return the outputs, and the states after the instant."""
        given = [*(x.sent[i] for i in range(self.late)), u.command if self.commands else np.zeros(0)]
        every = self.sample_time or 0.0
        then = t - self.behind * every
        state, spread, outputs = self.corrected(then, x, u, given[0])
        predicted, wider = self._later(then, state, spread, given[:1])
        state, spread = self._later(then, state, spread, given[: self.behind])
        ahead, _ = self._later(t, state, None, given[self.behind : self.late])
        sent = np.stack(given[1:]) if self.late else x.sent
        outputs = {"estimate": state, "prediction": ahead, **outputs}
        states = {"predicted": predicted, "sent": sent}
        if spread is not None:
            outputs["covariance"], states["predicted_covariance"] = spread, wider
        return outputs, states

    def _later(
        self, t: Array, x: Array, P: Array | None, commands: Sequence[Array]
    ) -> tuple[Array, Array | None]:
        """Return the state and its covariance as many samples later as there are commands."""
        for command in commands:
            x, by_x, added = self.process.step(t, x, command)
            P = None if P is None else by_x @ P @ by_x.T + added
            t = t + (self.sample_time or 0.0)
        return x, P

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return what the measurement tells."""
        return self._all(t, x, u)[0]

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return what is expected of the next measurement."""
        return self._all(t, x, u)[1]


def linear_process(
    owner: str,
    system: tuple[npt.ArrayLike, ...],
    process_covariance: npt.ArrayLike,
    measurement_covariance: npt.ArrayLike,
    drift: npt.ArrayLike,
    bias: npt.ArrayLike,
) -> LinearProcess:
    """Return a linear process, checked.

    Parameters
    ----------
    owner : str
        Whose it is, for messages.
    system : tuple of array_like
        The matrices A, B, C, D, as for `DiscreteStateSpace` [any].
    process_covariance, measurement_covariance : array_like
        Covariances, as matrices, diagonals or numbers [any].
    drift, bias : array_like
        The constants a and b [any].

    Raises
    ------
    BlockError
        If sizes do not fit, or a covariance is none.
    """
    A, B, C, D = matrices(owner, *system)
    n, C = len(A), np.atleast_2d(C)
    B = B.reshape(n, -1)
    m = len(C)
    return LinearProcess(
        A=A,
        B=B,
        C=C,
        D=D.reshape(m, B.shape[1]),
        covariance=covariance(f"process covariance of {owner}", process_covariance, n),
        noise=covariance(f"measurement noise of {owner}", measurement_covariance, m, definite=True),
        drift=finite_array(f"drift of {owner}", drift, (n,)),
        bias=finite_array(f"bias of {owner}", bias, (m,)),
    )


class KalmanFilter(Filter):
    r"""The steady Kalman filter of a linear system.

    .. math::

        x_{k+1} &= A x_k + B u_k + a + w_k, & y_k &= C x_k + D u_k + b + v_k \\
        \hat x_k &= \bar x_k + K (y_k - C \bar x_k - D u_k - b), & \bar x_{k+1} &= A \hat x_k + B u_k + a \\
        K &= P C^T S^{-1}, & S &= C P C^T + R

    with white noise w and v of the covariances Q and R. P is the covariance of :math:`\bar x` in the steady state,
    from the discrete Riccati equation. The inputs are the measurement y and, where there is one, the command u as
    it is applied; the estimate uses both up to now, but for the command of this very instant.

    Parameters
    ----------
    A, B, C, D : array_like
        Matrices [any]; shapes as for `StateSpace`.
    process_covariance, measurement_covariance : array_like
        Q, positive semidefinite, and R, positive definite [any]; one number or a vector is a diagonal.
    every : float
        Time between samples [s].
    drift, bias : array_like
        The constants a and b [any].
    allow_unobserved : bool
        Whether states that the measurements do not show may be left to the model, if they decay.
    **settings
        As for `Filter`: command_delay, measurement_delay, initial_estimate, initial_command, state_names,
        measurement_unit, command_unit.

    Attributes
    ----------
    gain : Vector, shape (n, m)
        K [any].
    covariance : Vector, shape (n, n)
        Of the error of the estimate [any].
    innovation_covariance : Vector, shape (m, m)
        S [any].

    Raises
    ------
    BlockError
        If sizes do not fit, or a covariance is none.
    LinearAnalysisError
        If a state cannot be estimated: the measurements do not show it, or no noise drives it and it does not decay.

    References
    ----------
    Anderson, Moore (1979), *Optimal Filtering*, sections 3.1 and 4.4.
    """

    def __init__(
        self,
        A: npt.ArrayLike,
        B: npt.ArrayLike,
        C: npt.ArrayLike,
        D: npt.ArrayLike = 0.0,
        *,
        process_covariance: npt.ArrayLike,
        measurement_covariance: npt.ArrayLike,
        every: float,
        drift: npt.ArrayLike = 0.0,
        bias: npt.ArrayLike = 0.0,
        allow_unobserved: bool = False,
        **settings: Unpack[FilterSettings],
    ) -> None:
        positive(every=every)
        process = linear_process(
            type(self).__name__, (A, B, C, D), process_covariance, measurement_covariance, drift, bias
        )
        names = settings.get("state_names") or [f"x[{i}]" for i in range(len(process.A))]
        P = steady_covariance(process, names, allow_unobserved=allow_unobserved)
        C = process.C
        self.innovation_covariance = C @ P @ C.T + process.noise
        self.gain = np.linalg.solve(self.innovation_covariance, C @ P).T
        rest = np.eye(len(P)) - self.gain @ C
        self._then = rest @ P @ rest.T + self.gain @ process.noise @ self.gain.T
        super().__init__(process, len(P), process.B.shape[1], every, **settings)

    @property
    def covariance(self) -> Vector:
        """Covariance of the error of the estimate [any]."""
        at_rest = np.zeros(self.order), [np.zeros(self.commands)] * self.behind
        found = self._later(0.0, at_rest[0], self._then, at_rest[1])[1]
        return np.asarray(found)

    def corrected(
        self, t: Array, x: Signals, u: Signals, command: Array
    ) -> tuple[Array, Array | None, Values]:
        """Return the state measured, corrected by the constant gain."""
        innovation = u.measurement - self.process.measure(t, x.predicted, command)[0]
        return x.predicted + self.gain @ innovation, None, {"innovation": innovation}


class VaryingFilter(Filter):
    """Base of Kalman filters that carry the covariance of their error along.

    Parameters
    ----------
    process : Process
        The model.
    order, commands : int
        Number of states, and of commands [-].
    every : float
        Time between samples [s].
    initial_covariance : array_like
        Of the error of the initial estimate; one number or a vector is a diagonal [any].
    **settings
        As for `Filter`.

    Raises
    ------
    ParameterError
        If the covariance is none.
    """

    covariance = Output(("order", "order"), meaning="covariance of the error of the estimate")
    innovation_covariance = Output(
        ("measurements", "measurements"), meaning="covariance that the innovation should have"
    )
    predicted_covariance = State(
        ("order", "order"), initial="initial_covariance", meaning="of the error of the state measured next"
    )
    initial_covariance = Parameter(
        shape=("order", "order"), meaning="of the error of the estimate before the first measurement"
    )

    def __init__(
        self,
        process: Process,
        order: int,
        commands: int,
        every: float,
        *,
        initial_covariance: npt.ArrayLike,
        **settings: Unpack[FilterSettings],
    ) -> None:
        what = f"parameter 'initial_covariance' of {type(self).__name__}"
        first = covariance(what, initial_covariance, order)
        super().__init__(process, order, commands, every, initial_covariance=first, **settings)

    def check_parameters(self, p: Signals) -> None:
        """Refuse an initial covariance that is none."""
        covariance(f"parameter 'initial_covariance' of {p.owner}", p.initial_covariance, self.order)

    def corrected(
        self, t: Array, x: Signals, u: Signals, command: Array
    ) -> tuple[Array, Array | None, Values]:
        """Return the state measured and its covariance, in the form of Joseph, which round-off cannot spoil."""
        shown, H = self.process.measure(t, x.predicted, command)
        innovation, P = u.measurement - shown, x.predicted_covariance
        S = H @ P @ H.T + self.process.noise
        K = solve_positive_definite(S, H @ P).T
        rest = np.eye(self.order) - K @ H
        spread = rest @ P @ rest.T + K @ self.process.noise @ K.T
        outputs = {"innovation": innovation, "innovation_covariance": S}
        return x.predicted + K @ innovation, (spread + spread.T) / 2, outputs


class TimeVaryingKalmanFilter(VaryingFilter):
    r"""The Kalman filter of a linear system from its first measurement on.

    The equations of `KalmanFilter` with a P that is propagated from the initial covariance:

    .. math:: P_{k|k} = (1 - K C) P (1 - K C)^T + K R K^T, \qquad P_{k+1} = A P_{k|k} A^T + Q

    Parameters
    ----------
    A, B, C, D : array_like
        Matrices [any]; shapes as for `StateSpace`.
    process_covariance, measurement_covariance : array_like
        Q, positive semidefinite, and R, positive definite [any]; one number or a vector is a diagonal.
    initial_covariance : array_like
        P at the first measurement; one number or a vector is a diagonal [any].
    every : float
        Time between samples [s].
    drift, bias : array_like
        The constants a and b [any].
    allow_unobserved : bool
        Whether states that the measurements do not show may be left to the model, if they decay.
    **settings
        As for `Filter`.

    Raises
    ------
    BlockError
        If sizes do not fit, or a covariance is none.
    LinearAnalysisError
        If the measurements do not show a state.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan (2001), *Estimation with Applications to Tracking and Navigation*,
    section 5.2; Joseph's form is eq. (5.2.3-18).
    """

    def __init__(
        self,
        A: npt.ArrayLike,
        B: npt.ArrayLike,
        C: npt.ArrayLike,
        D: npt.ArrayLike = 0.0,
        *,
        process_covariance: npt.ArrayLike,
        measurement_covariance: npt.ArrayLike,
        initial_covariance: npt.ArrayLike,
        every: float,
        drift: npt.ArrayLike = 0.0,
        bias: npt.ArrayLike = 0.0,
        allow_unobserved: bool = False,
        **settings: Unpack[FilterSettings],
    ) -> None:
        positive(every=every)
        process = linear_process(
            type(self).__name__, (A, B, C, D), process_covariance, measurement_covariance, drift, bias
        )
        names = settings.get("state_names") or [f"x[{i}]" for i in range(len(process.A))]
        refuse_unobserved(process, names, allow_decaying=allow_unobserved)
        order, commands = process.B.shape
        super().__init__(process, order, commands, every, initial_covariance=initial_covariance, **settings)


class ExtendedKalmanFilter(VaryingFilter):
    r"""The extended Kalman filter of a nonlinear system, linearized at the estimate by exact Jacobians.

    .. math:: \dot x = f(t, x, u) + w, \qquad y_k = h(t_k, x_k, u_k) + v_k

    between samples stepped by RK4, as `NonlinearProcess` says.

    Parameters
    ----------
    rates, outputs : callable
        f and h: functions of (t, x, u) that trace, as those of `Function` [as declared].
    states, measurements, commands : int
        Sizes of x, y and u [-].
    process_noise : array_like or callable
        Power spectral density of w, positive semidefinite; one number or a vector is a diagonal, a function of
        (t, x, u) must return a matrix [rate² s].
    measurement_noise : array_like
        Covariance of v, positive definite [any].
    initial_covariance : array_like
        Of the error of the initial estimate [any].
    every : float
        Time between samples [s].
    steps : int
        Steps within each [-].
    **settings
        As for `Filter`.

    Raises
    ------
    BlockError
        If sizes do not fit, or a covariance is none.
    TracingError
        If a function cannot be traced.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan (2001), *Estimation with Applications to Tracking and Navigation*,
    section 10.3.3.
    """

    def __init__(
        self,
        rates: Callable[..., Array],
        outputs: Callable[..., Array],
        *,
        states: int,
        measurements: int,
        commands: int = 0,
        process_noise: npt.ArrayLike | Callable[..., Array],
        measurement_noise: npt.ArrayLike,
        initial_covariance: npt.ArrayLike,
        every: float,
        steps: int = 1,
        **settings: Unpack[FilterSettings],
    ) -> None:
        positive(every=every)
        positive_whole(states=states, measurements=measurements, steps=steps)
        if not is_whole(commands) or commands < 0:
            raise BlockError(f"ExtendedKalmanFilter cannot have commands = {shown(commands)}")
        owner = type(self).__name__
        density = (
            process_noise
            if callable(process_noise)
            else covariance(f"process noise of {owner}", process_noise, states)
        )
        noise = covariance(f"measurement noise of {owner}", measurement_noise, measurements, definite=True)
        process = NonlinearProcess(rates, outputs, density, noise, (states, commands), every, steps)
        super().__init__(process, states, commands, every, initial_covariance=initial_covariance, **settings)

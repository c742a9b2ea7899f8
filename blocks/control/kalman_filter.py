"""Kalman filters: sampled blocks that estimate the state of a plant from measurements and commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.control.covariances import (
    covariance,
    refuse_undetectable,
    steady_covariance,
)
from trussflow.blocks.control.process_models import LinearProcess, Process
from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.clock import exact, ticks
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output, Port
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.signals import finite
from trussflow.blocks.linear_analysis.references import label_places
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import shown
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite


class Filter(Block):
    """Base of Kalman filters with delayed commands and measurements.

    A measurement shows the plant m samples ago, and a command acts n samples later. The filter therefore
    updates the state of m samples ago, driven by the command of m + n samples ago. For white noise this is
    the filter without delays, m samples late, and optimal. The filter then predicts over the delays with the
    commands sent since.

    Parameters
    ----------
    process : Process
        The model.
    command_delay, measurement_delay : float
        Delay of the actuators and delay of the measurements, multiples of the sample time [s].
    initial_estimate : array_like, shape (n,)
        Estimate before the first measurement [any].
    initial_command : array_like
        Commands before the start [any].
    measurement_unit, command_unit : str, tuple of str or None
        Units of the inputs, or one per element; None leaves them unchecked.
    **parameters : array_like
        Parameters of the filter.

    Raises
    ------
    BlockError
        If a delay is negative.
    SimulationError
        If a delay is no multiple of the sample time.
    """

    _symbol = Symbol("x̄ + K (y − ȳ)")
    measurement = Input(
        "measurements",
        unit=Attribute("measurement_unit"),
        meaning="measurements of the sensors",
    )
    estimate = Output("order", meaning="state now, from all measurements so far")
    prediction = Output("order", meaning="state when the current command begins to act")
    innovation = Output("measurements", meaning="measurement minus its prediction")
    predicted = State(
        "order",
        initial="initial_estimate",
        meaning="predicted state at the next measurement",
    )
    sent = State(
        ("late", "commands"),
        initial="initial_command",
        meaning="commands that have not acted yet, oldest first",
    )
    initial_estimate = Parameter(
        shape="order", meaning="estimate before the first measurement"
    )
    initial_command = Parameter(
        shape=("late", "commands"), meaning="commands before the start"
    )

    def __init__(
        self,
        process: Process,
        *,
        command_delay: float = 0.0,
        measurement_delay: float = 0.0,
        initial_estimate: npt.ArrayLike = 0.0,
        initial_command: npt.ArrayLike = 0.0,
        measurement_unit: Unit = None,
        command_unit: Unit = None,
        **parameters: npt.ArrayLike,
    ) -> None:
        self.process, self.state_names = process, process.state_names
        self.order, self.measurements, self.commands = (
            process.order,
            process.measurements,
            process.commands,
        )
        self.ahead = self._samples("command_delay", command_delay)
        self.behind = self._samples("measurement_delay", measurement_delay)
        self.late = self.ahead + self.behind
        self.measurement_unit, self.command_unit = measurement_unit, command_unit
        command = Input(
            "commands",
            unit=Attribute("command_unit"),
            meaning="commands of the actuators",
        )
        self.extra_ports = {"command": command} if self.commands else {}
        super().__init__(
            initial_estimate=initial_estimate,
            initial_command=initial_command,
            **parameters,
        )
        self.sampled(process.every)

    def _samples(self, name: str, given: float) -> int:
        """Return a delay as a number of samples."""
        owner = type(self).__name__
        delay, what = finite(owner, name, given), f"{name} of {owner}"
        if delay < 0:
            raise BlockError(f"{what} is {delay:g} s: it must be at least 0")
        return ticks(
            exact(delay),
            exact(self.process.every),
            what,
            "take a sample time that divides it",
        )

    def of(self, name: str, output: str = "estimate") -> Port:
        """Return the port of one state of an output, such as ``of("plant.position[0:3]")``.

        Parameters
        ----------
        name : str
            Name of the state.
        output : str
            Name of the output, ``"estimate"`` or ``"prediction"``.

        Raises
        ------
        NameLookupError
            If there is no such state; the message lists the states.
        """
        return self.port(output)[label_places(self.state_names, name).tolist()]

    def weighted(self, x: Signals, H: Array) -> tuple[Array, Array | None, Values]:
        """Return the gain, the covariance after the measurement unless constant, and further outputs.

        Parameters
        ----------
        x : Signals
            States of the filter [as declared].
        H : Array
            Jacobian of the measurement with respect to the state [as declared].
        """
        raise NotImplementedError

    def _all(self, t: Array, x: Signals, u: Signals) -> tuple[Values, Values]:
        """Return the outputs and the updated states."""
        # Oldest first. The measurement is of time `then`, when the command sent `late`
        # samples ago acted: given[0]. The others act in the samples from `then` on.
        given = [*x.sent, u.command if self.commands else np.zeros(0)]
        then = t - self.behind * self.process.every
        shown, H = self.process.measure(then, x.predicted, given[0])
        innovation, (gain, spread, outputs) = u.measurement - shown, self.weighted(x, H)
        state = x.predicted + gain @ innovation
        # Three predictions from the updated state: by one sample, for the next update;
        # over the measurement delay, to the present; from there over the command delay.
        predicted, wider = self._later(then, state, spread, given[:1])
        state, spread = self._later(then, state, spread, given[: self.behind])
        ahead, _ = self._later(t, state, None, given[self.behind : self.late])
        outputs |= {"estimate": state, "prediction": ahead, "innovation": innovation}
        states = {
            "predicted": predicted,
            # Without delays the buffer has no rows, and nothing can be stacked.
            "sent": np.stack(given[1:]) if self.late else x.sent,
        }
        if spread is not None:
            outputs["covariance"], states["predicted_covariance"] = spread, wider
        return outputs, states

    def _later(
        self, t: Array, x: Array, P: Array | None, commands: Sequence[Array]
    ) -> tuple[Array, Array | None]:
        """Propagate the state and its covariance by one sample per command."""
        for command in commands:
            x, by_x, added = self.process.step(t, x, command)
            P, t = (
                None if P is None else by_x @ P @ by_x.T + added,
                t + self.process.every,
            )
        return x, P

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the estimate, the prediction and the innovation."""
        return self._all(t, x, u)[0]

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the prediction for the next measurement."""
        return self._all(t, x, u)[1]


class KalmanFilter(Filter):
    r"""The steady Kalman filter of a linear process.

    .. math::

        \hat x_k &= \bar x_k + K (y_k - C \bar x_k - D u_k - b), & \bar x_{k+1} &= A \hat x_k + B u_k + a \\
        K &= P C^T S^{-1}, & S &= C P C^T + R

    with the symbols of `LinearProcess`, and P the covariance of :math:`\bar x` in the steady state, from
    the discrete Riccati equation. The inputs are the measurement y and, if the process has commands, the
    applied command u. The estimate at an instant uses the commands before this instant only.

    Parameters
    ----------
    process : LinearProcess
        The model.
    **settings
        As for `Filter`: command_delay, measurement_delay, initial_estimate, initial_command,
        measurement_unit, command_unit.

    Attributes
    ----------
    gain : Vector, shape (n, m)
        K [any].
    innovation_covariance : Vector, shape (m, m)
        S [any].

    Raises
    ------
    LinearAnalysisError
        If a state does not decay, and is unobservable or not driven by noise.

    References
    ----------
    Anderson, Moore (1979), *Optimal Filtering*, sections 3.1 and 4.4.
    """

    def __init__(self, process: LinearProcess, **settings: Any) -> None:
        _check_process("KalmanFilter", process, LinearProcess)
        A, C, Q, R, names = (
            process.A,
            process.C,
            process.covariance,
            process.noise,
            process.state_names,
        )
        refuse_undetectable(A, C, names)
        P = steady_covariance(A, C, Q, R, names)
        self.innovation_covariance = C @ P @ C.T + R
        # (S^-1 C P)^T = P C^T S^-1, as P and S are symmetric.
        self.gain = np.linalg.solve(self.innovation_covariance, C @ P).T
        self._measured = _joseph(P, self.gain, C, R)
        super().__init__(process, **settings)

    @property
    def covariance(self) -> Vector:
        """Covariance of the error of the estimate [any]."""
        # A linear process has the same Jacobian and noise at all states and commands.
        nothing = [np.zeros(self.commands)] * self.behind
        return np.asarray(
            self._later(0.0, np.zeros(self.order), self._measured, nothing)[1]
        )

    def weighted(self, x: Signals, H: Array) -> tuple[Array, Array | None, Values]:
        """Return the constant gain."""
        return self.gain, None, {}


class ExtendedKalmanFilter(Filter):
    r"""Time-varying and extended Kalman filter, which propagates its covariance.

    For a `LinearProcess` the filter is optimal from the first measurement on. A `NonlinearProcess` is
    linearized at the estimate by exact Jacobians. With H the Jacobian of the measurement,

    .. math::

        K = P H^T (H P H^T + R)^{-1}, \qquad P_{k|k} = (1 - K H) P (1 - K H)^T + K R K^T,
        \qquad P_{k+1} = \Phi P_{k|k} \Phi^T + Q

    Parameters
    ----------
    process : Process
        The model.
    initial_covariance : array_like
        P at the first measurement; one number or a vector is a diagonal [any].
    **settings
        As for `Filter`.

    Raises
    ------
    ParameterError
        If the covariance has another shape, or is not symmetric and positive semidefinite.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan (2001), *Estimation with Applications to Tracking and Navigation*,
    sections 5.2 and 10.3.3; the covariance update is in Joseph form.
    """

    covariance = Output(
        ("order", "order"), meaning="covariance of the error of the estimate"
    )
    innovation_covariance = Output(
        ("measurements", "measurements"), meaning="covariance of the innovation"
    )
    predicted_covariance = State(
        ("order", "order"),
        initial="initial_covariance",
        meaning="covariance of the predicted state",
    )
    initial_covariance = Parameter(
        shape=("order", "order"), meaning="covariance of the initial estimate"
    )

    def __init__(
        self, process: Process, *, initial_covariance: npt.ArrayLike, **settings: Any
    ) -> None:
        _check_process("ExtendedKalmanFilter", process, Process)
        first = covariance("initial_covariance", initial_covariance, process.order)
        super().__init__(process, initial_covariance=first, **settings)

    def check_parameters(self, p: Signals) -> None:
        """Raise `ParameterError` for an invalid initial covariance."""
        covariance(
            f"parameter 'initial_covariance' of {p.owner}",
            p.initial_covariance,
            self.order,
        )

    def weighted(self, x: Signals, H: Array) -> tuple[Array, Array | None, Values]:
        """Return the gain and the covariance after the measurement."""
        P, R = x.predicted_covariance, self.process.noise
        S = H @ P @ H.T + R
        # S is at least R, which is positive definite: a Cholesky factor exists.
        gain = solve_positive_definite(S, H @ P).T
        return gain, _joseph(P, gain, H, R), {"innovation_covariance": S}


def _check_process(owner: str, process: object, kind: type[Process]) -> None:
    if not isinstance(process, kind):
        what = (
            "a LinearProcess"
            if kind is LinearProcess
            else "a LinearProcess or a NonlinearProcess"
        )
        raise BlockError(
            f"{owner} needs {what}, not {shown(process)}; kalman_filter makes one of a diagram"
        )


def _joseph(P: Array, K: Array, H: Array, R: Vector) -> Array:
    """Return the covariance after a measurement in Joseph form, which stays positive semidefinite."""
    rest = np.eye(K.shape[0]) - K @ H
    after = rest @ P @ rest.T + K @ R @ K.T
    # Asymmetry from round-off would grow from sample to sample.
    return (after + after.T) / 2

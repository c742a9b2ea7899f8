"""Kalman filters: sampled blocks that estimate the state of a plant from measurements and commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.estimation.covariances import covariance, refuse_unobserved, steady_covariance
from trussflow.blocks.estimation.processes import LinearProcess, Process
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.clock import exact, ticks
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.errors import BlockError
from trussflow.blocks.framework.port import Input, Output, Port
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.framework.validation import shown
from trussflow.blocks.library.signals import finite
from trussflow.blocks.linear_analysis.references import label_places
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite


class Filter(Block):
    """Base of Kalman filters; it knows when what is told of what.

    At an instant the measurement shows the plant as it was m samples before, the command arrives n samples
    later, and the command given now is not known yet. So the filter works on the state of m samples ago,
    which the command of m + n samples ago drives: with white noise that is the filter without delays, m
    samples late. From there it predicts over the delays with the commands given since; none can do better.

    Parameters
    ----------
    process : Process
        The model.
    command_delay, measurement_delay : float
        From a command until it acts, and from what is measured until it arrives: multiples of the sample
        time [s].
    initial_estimate : array_like, shape (n,)
        Estimate before the first measurement [any].
    initial_command : array_like
        What was commanded before the start [any].
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

    measurement = Input("measurements", unit=Attribute("measurement_unit"), meaning="what the sensors show")
    estimate = Output("order", meaning="state now, from all measurements so far")
    prediction = Output("order", meaning="state when the command given now begins to act")
    innovation = Output("measurements", meaning="measurement less what the filter expected")
    predicted = State("order", initial="initial_estimate", meaning="state measured next, as expected")
    sent = State(("late", "commands"), initial="initial_command", meaning="commands under way, oldest first")
    initial_estimate = Parameter(shape="order", meaning="estimate before the first measurement")
    initial_command = Parameter(shape=("late", "commands"), meaning="what was commanded before the start")

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
        self.order, self.measurements, self.commands = process.order, process.measurements, process.commands
        self.ahead = self._samples("command_delay", command_delay)
        self.behind = self._samples("measurement_delay", measurement_delay)
        self.late = self.ahead + self.behind
        self.measurement_unit, self.command_unit = measurement_unit, command_unit
        command = Input("commands", unit=Attribute("command_unit"), meaning="what the actuators are told")
        self.extra_ports = {"command": command} if self.commands else {}
        super().__init__(initial_estimate=initial_estimate, initial_command=initial_command, **parameters)
        self.sampled(process.every)

    def _samples(self, name: str, given: float) -> int:
        """Return how many samples a delay is."""
        owner = type(self).__name__
        delay, what = finite(owner, name, given), f"{name} of {owner}"
        if delay < 0:
            raise BlockError(f"{what} is {delay:g} s: nothing is known before it happens")
        return ticks(exact(delay), exact(self.process.every), what, "take a sample time that divides it")

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
        return self.port(output)[label_places(self.state_names, name).tolist()]

    def weighted(self, x: Signals, H: Array) -> tuple[Array, Array | None, Values]:
        """Return the gain, the covariance after the measurement unless constant, and further outputs.

        Parameters
        ----------
        x : Signals
            States of the filter [as declared].
        H : Array
            Jacobian of what is measured by the state [as declared].
        """
        raise NotImplementedError

    def _all(self, t: Array, x: Signals, u: Signals) -> tuple[Values, Values]:
        """Return the outputs, and the states after the instant."""
        given = [*x.sent, u.command if self.commands else np.zeros(0)]
        then = t - self.behind * self.process.every
        shown, H = self.process.measure(then, x.predicted, given[0])
        innovation, (gain, spread, outputs) = u.measurement - shown, self.weighted(x, H)
        state = x.predicted + gain @ innovation
        predicted, wider = self._later(then, state, spread, given[:1])
        state, spread = self._later(then, state, spread, given[: self.behind])
        ahead, _ = self._later(t, state, None, given[self.behind : self.late])
        outputs |= {"estimate": state, "prediction": ahead, "innovation": innovation}
        states = {"predicted": predicted, "sent": np.stack(given[1:]) if self.late else x.sent}
        if spread is not None:
            outputs["covariance"], states["predicted_covariance"] = spread, wider
        return outputs, states

    def _later(
        self, t: Array, x: Array, P: Array | None, commands: Sequence[Array]
    ) -> tuple[Array, Array | None]:
        """Return the state and its covariance as many samples later as there are commands."""
        for command in commands:
            x, by_x, added = self.process.step(t, x, command)
            P, t = None if P is None else by_x @ P @ by_x.T + added, t + self.process.every
        return x, P

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return what the measurement tells."""
        return self._all(t, x, u)[0]

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return what is expected of the next measurement."""
        return self._all(t, x, u)[1]


class KalmanFilter(Filter):
    r"""The steady Kalman filter of a linear process.

    .. math::

        \hat x_k &= \bar x_k + K (y_k - C \bar x_k - D u_k - b), & \bar x_{k+1} &= A \hat x_k + B u_k + a \\
        K &= P C^T S^{-1}, & S &= C P C^T + R

    with the symbols of `LinearProcess`, and P the covariance of :math:`\bar x` in the steady state, from
    the discrete Riccati equation. The inputs are the measurement y and, where there is one, the command u
    as it is applied. The estimate uses both up to now, but for the command of this very instant.

    Parameters
    ----------
    process : LinearProcess
        The model.
    allow_unobserved : bool
        Whether states that the measurements do not show may be left to the model, if they decay.
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
        If a state cannot be estimated: the measurements do not show it, or it does not decay and no noise
        drives it.

    References
    ----------
    Anderson, Moore (1979), *Optimal Filtering*, sections 3.1 and 4.4.
    """

    def __init__(self, process: LinearProcess, *, allow_unobserved: bool = False, **settings: Any) -> None:
        _check_process("KalmanFilter", process, LinearProcess)
        A, C, Q, R, names = process.A, process.C, process.covariance, process.noise, process.state_names
        refuse_unobserved(A, C, names, allow_decaying=allow_unobserved)
        P = steady_covariance(A, C, Q, R, names)
        self.innovation_covariance = C @ P @ C.T + R
        self.gain = np.linalg.solve(self.innovation_covariance, C @ P).T
        self._measured = _joseph(P, self.gain, C, R)
        super().__init__(process, **settings)

    @property
    def covariance(self) -> Vector:
        """Covariance of the error of the estimate [any]."""
        nothing = [np.zeros(self.commands)] * self.behind
        return np.asarray(self._later(0.0, np.zeros(self.order), self._measured, nothing)[1])

    def weighted(self, x: Signals, H: Array) -> tuple[Array, Array | None, Values]:
        """Return the constant gain."""
        return self.gain, None, {}


class ExtendedKalmanFilter(Filter):
    r"""The Kalman filter that carries its covariance along: time-varying, and extended.

    Of a `LinearProcess` it is the filter that is best from the first measurement on; a `NonlinearProcess`
    is linearized at the estimate, by exact Jacobians. With H that of what is measured,

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
    sections 5.2 and 10.3.3; the form of P after a measurement is Joseph's.
    """

    covariance = Output(("order", "order"), meaning="covariance of the error of the estimate")
    innovation_covariance = Output(("measurements", "measurements"), meaning="covariance it should have")
    predicted_covariance = State(
        ("order", "order"), initial="initial_covariance", meaning="of the state measured next, as expected"
    )
    initial_covariance = Parameter(shape=("order", "order"), meaning="of the initial estimate")

    def __init__(self, process: Process, *, initial_covariance: npt.ArrayLike, **settings: Any) -> None:
        _check_process("ExtendedKalmanFilter", process, Process)
        first = covariance("initial_covariance", initial_covariance, process.order)
        super().__init__(process, initial_covariance=first, **settings)

    def check_parameters(self, p: Signals) -> None:
        """Refuse an initial covariance that is none."""
        covariance(f"parameter 'initial_covariance' of {p.owner}", p.initial_covariance, self.order)

    def weighted(self, x: Signals, H: Array) -> tuple[Array, Array | None, Values]:
        """Return the gain, and the covariance of the state measured."""
        P, R = x.predicted_covariance, self.process.noise
        S = H @ P @ H.T + R
        gain = solve_positive_definite(S, H @ P).T
        return gain, _joseph(P, gain, H, R), {"innovation_covariance": S}


def _check_process(owner: str, process: object, kind: type[Process]) -> None:
    if not isinstance(process, kind):
        what = "a LinearProcess" if kind is LinearProcess else "a LinearProcess or a NonlinearProcess"
        raise BlockError(f"{owner} needs {what}, not {shown(process)}; kalman_filter makes one of a diagram")


def _joseph(P: Array, K: Array, H: Array, R: Vector) -> Array:
    """Return the covariance after a measurement in the form that round-off cannot make negative."""
    rest = np.eye(K.shape[0]) - K @ H
    after = rest @ P @ rest.T + K @ R @ K.T
    return (after + after.T) / 2

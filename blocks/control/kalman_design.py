"""Design of Kalman filters from a diagram or a linear model."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.control.covariances import covariance, refuse_undetectable
from trussflow.blocks.control.kalman_filter import ExtendedKalmanFilter, KalmanFilter
from trussflow.blocks.control.process_models import ArrayFunction, NonlinearProcess
from trussflow.blocks.errors import LinearAnalysisError, NameLookupError, ParameterError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.opened_model import (
    RATES_AND_OUTPUTS,
    LocalJacobians,
)
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import (
    References,
    all_labels,
    all_named,
    label_places,
    layout_labels,
    named,
)
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import by_name, one_of, positive, shown
from trussflow.blocks.tracing.linear_algebra import block_diagonal

Model = Callable[[Array, Array, Array], Array]
"""State derivatives followed by measurements, as a function of (t, x, all inputs)."""

ByName = Mapping[str, npt.ArrayLike]
"""Covariances, keyed by the name of a state or signal."""


@dataclass(frozen=True)
class GaussMarkov:
    r"""First-order Gauss-Markov disturbance, dd/dt = -d/τ + w.

    Parameters
    ----------
    standard_deviation : float
        Stationary standard deviation of d, above 0 [unit of the signal].
    time_constant : float
        τ > 0 [s].

    Raises
    ------
    SimulationError
        If either is not above 0.
    """

    standard_deviation: float
    time_constant: float

    def __post_init__(self) -> None:
        positive(
            standard_deviation=self.standard_deviation, time_constant=self.time_constant
        )


@dataclass(frozen=True, eq=False)
class Plant:
    """Plant with its inputs, states and outputs as vectors.

    Attributes
    ----------
    model : callable
        State derivatives and measurements.
    states, inputs, outputs : list of str
        Names; all outputs are measured.
    commands : int
        Number of commands, which are the first inputs [-].
    at : tuple
        Time, states and inputs of the operating point; the estimate starts there [as declared].
    units : mapping of str to Unit
        Units of measurements and commands.
    """

    model: Model
    states: Sequence[str]
    inputs: Sequence[str]
    outputs: Sequence[str]
    commands: int
    at: tuple[float, Vector, Vector]
    units: Mapping[str, Unit]


def kalman_filter(
    plant: Block,
    measured: References = None,
    inputs: References = None,
    *,
    every: float,
    measurement_noise: npt.ArrayLike,
    process_noise: ByName | npt.ArrayLike | None = None,
    disturbances: Mapping[str, npt.ArrayLike | GaussMarkov] | None = None,
    command_delay: float = 0.0,
    measurement_delay: float = 0.0,
    kind: str = "steady",
    initial_covariance: ByName | npt.ArrayLike | None = None,
    at: OperatingPoint | None = None,
    steps: int = 1,
) -> KalmanFilter | ExtendedKalmanFilter:
    r"""Return a Kalman filter for a plant: a sampled block that estimates the states of the plant.

    The plant is linearized by exact Jacobians and sampled exactly with held commands;
    ``kind="extended"`` uses the nonlinear equations instead. The block has the inputs `measurement` and
    `command`. The output `estimate` is the current state, `prediction` the state at the time when the current
    command begins to act. Both hold the states of the plant, then those of the disturbances;
    ``of("block.state")`` returns the port of one state. A covariance may be a matrix, its diagonal, or one
    number for the whole diagonal.

    Parameters
    ----------
    plant : Block
        Diagram or block in continuous time; `from_control` makes one of a linear model. The filter works on
        the signals of the block.
    measured, inputs : Port, str or sequence of these, optional
        Measured and commanded ports of any inner block, whole or sliced, as for `linearize`. Wires that
        drive a commanded port are cut. The default is all outputs and all inputs of the plant.
    every : float
        Time between samples [s].
    measurement_noise : array_like
        Covariance of the noise of one measurement, positive definite [unit²].
    process_noise : mapping or array_like, optional
        Two-sided power spectral density of white noise, keyed by the name of a state, whose derivative it
        enters [(unit/s)² s], or of an input, to which it is added [unit² s]. An array is the density of
        the derivatives of all states.
    disturbances : mapping, optional
        Slow disturbances to estimate, keyed by the state, input or measured output to which they are added
        (to a state: to its derivative). A value is the density of a random walk [unit²/s] or a
        `GaussMarkov`. The names of these estimates begin with ``disturbance.``.
    command_delay, measurement_delay : float
        Delay of the actuators and delay of the measurements, multiples of `every` [s].
    kind : str
        ``"steady"``: constant gain. ``"varying"``: linear and time-varying, optimal from the first
        measurement on. ``"extended"``: linearized at the estimate in each sample.
    initial_covariance : mapping or array_like
        Covariance of the initial estimation error, by name or of all states; unused if steady [unit²].
    at : OperatingPoint, optional
        Operating point of the linearization and start of the estimate.
    steps : int
        Integration steps per sample of the extended filter [-].

    Returns
    -------
    KalmanFilter or ExtendedKalmanFilter
        The block.

    Raises
    ------
    LinearAnalysisError
        If a state is unobservable and does not decay, white noise reaches a measurement directly, or the plant cannot be
        linearized.
    NameLookupError
        If a name matches no state or signal; the message lists the valid names.
    ParameterError
        If a covariance is missing, of another shape, or not symmetric and positive (semi)definite.
    SimulationError
        If a time is not above 0, or a delay no multiple of `every`.

    Notes
    -----
    The covariance of the noise in a sample is that of Van Loan (1978), the filter that of Anderson and
    Moore (1979). States that decay and that no measurement shows are estimated by the model alone. The
    observability of an extended filter depends on the state and is not checked.
    """
    one_of("kind of Kalman filter", kind, ("steady", "varying", "extended"))
    slow = by_name("disturbances", disturbances)
    names = [*(process_noise if isinstance(process_noise, Mapping) else ()), *slow]
    if not isinstance(plant, Block):
        raise LinearAnalysisError(
            f"cannot make this Kalman filter of {shown(plant)}: give a block; from_control makes one of a "
            "linear model"
        )
    opened = _of_block(plant, measured, inputs, names, at, linear=kind != "extended")
    sampling = {"every": every, "noise": measurement_noise, "steps": steps}
    process, z, u = _with_disturbances(opened, process_noise, slow, sampling)
    settings: dict[str, Any] = {
        "command_delay": command_delay,
        "measurement_delay": measurement_delay,
        "initial_estimate": z,
        "initial_command": u,
        **opened.units,
    }
    linear = process.linearized(opened.at[0], z, u) if kind != "extended" else None
    if kind == "steady" and linear:
        return KalmanFilter(linear, **settings)
    if initial_covariance is None:
        raise ParameterError(
            f"a filter of kind '{kind}' needs initial_covariance, the covariance of its first estimate"
        )
    if linear:
        refuse_undetectable(linear.A, linear.C, linear.state_names)
    rows, matrix = _assembled(
        "initial_covariance", initial_covariance, process.state_names, z.size
    )
    return ExtendedKalmanFilter(
        linear or process, initial_covariance=rows @ matrix @ rows.T, **settings
    )


def _of_block(
    plant: Block,
    measured: References,
    inputs: References,
    names: Sequence[str],
    at: OperatingPoint | None,
    *,
    linear: bool,
) -> Plant:
    """Open a diagram at its commands, its measurements and the inputs of noise and disturbances."""
    system = flatten(plant, external=True)
    commands, seen = (
        all_named(system, inputs, plant.inputs()),
        all_named(system, measured, plant.outputs()),
    )
    known, put_in = set(all_labels([*commands, *seen])), [*commands]
    for name in names:
        with contextlib.suppress(NameLookupError):
            # a state, or an unknown name, which is reported later
            one = named(system, name)
            if one.port.is_input and not known.issuperset(one.labels()):
                put_in.append(one)
                known.update(one.labels())
    # Inputs of the plant itself have no wire inside the diagram that must be cut.
    driven = [one.port for one in commands if one.port.block is not plant]
    linearizer = Linearizer(
        plant, [one.port for one in put_in], [one.port for one in seen], cut=driven
    )
    opened, point, (x, d, p) = linearizer.opened(at)
    faults = {
        "sampled blocks": opened.instants is not None,
        "Python blocks, without exact Jacobians": opened.plan.python_blocks
        and not linear,
        "algebraic loops that are solved by iteration": opened.plan.guesses.size
        and not linear,
    }
    if what := next((what for what, there in faults.items() if there), ""):
        raise LinearAnalysisError(
            f"cannot make this Kalman filter of '{plant.name}': it has {what}"
        )
    # `d` holds all external values. `columns` places the commands and noise inputs in
    # it, so that `columns.T @ d` is their value at the operating point.
    rows = [*range(x.size), *opened.output_rows.tolist()]
    columns = np.eye(d.size)[:, opened.input_columns - x.size]
    v = columns.T @ d
    if linear:
        with LocalJacobians(opened, point.time, p) as local:
            # Rates and outputs at the operating point, where rates need not be zero.
            rest = local.values(RATES_AND_OUTPUTS, x, d)[rows]
        found = linearizer.at(at)
        matrix = np.block([[found.A, found.B], [found.C, found.D]])
        begin = np.concatenate([x, v])

        def model(t: Array, x: Array, given: Array) -> Array:  # noqa: ARG001
            return rest + matrix @ (np.concatenate([x, given]) - begin)

    else:
        program = opened.programs[RATES_AND_OUTPUTS]
        function = ArrayFunction(program.expanded, (program.size,))

        def model(t: Array, x: Array, given: Array) -> Array:
            return function(t, x, d + columns @ (given - v), p)[rows]

    units: dict[str, Unit] = {}
    for what, ones in (("measurement_unit", seen), ("command_unit", commands)):
        each = [unit for one in ones for unit in one.port.element_units()]
        units[what] = None if None in each else tuple(map(str, each))
    labels = layout_labels(opened.plan.x), all_labels(put_in), all_labels(seen)
    return Plant(model, *labels, len(all_labels(commands)), (point.time, x, v), units)


def _with_disturbances(
    plant: Plant,
    process_noise: Any,
    slow: Mapping[str, Any],
    sampling: Mapping[str, Any],
) -> tuple[NonlinearProcess, Vector, Vector]:
    """Return a plant with its disturbances as states, and state and command of the operating point."""
    n, k = len(plant.states), len(plant.states) + len(plant.inputs)
    labels = [*plant.states, *plant.inputs, *plant.outputs]
    # Columns that add white noise w and disturbances d to derivatives, inputs and outputs.
    by_w, density = _assembled("process_noise", process_noise, labels[:k], n)
    by_w = np.eye(len(labels), k) @ by_w
    # The variance of dd/dt = -d/τ + w is S τ / 2 for a density S of w.
    markov = {name: one for name, one in slow.items() if isinstance(one, GaussMarkov)}
    stationary = {
        name: 2 * one.standard_deviation**2 / one.time_constant
        for name, one in markov.items()
    }
    by_d, wandering = _assembled("disturbances", {**slow, **stationary}, labels, 0)
    forgets = {
        name: 1 / markov[name].time_constant if name in markov else 0.0 for name in slow
    }
    _, decay = _assembled("disturbances", forgets, labels, 0)
    by_u = np.eye(k - n, plant.commands)
    (time, x0, v0), quiet, size = plant.at, np.zeros(len(density)), n + len(decay)
    z, u0 = np.append(x0, np.zeros(len(decay))), v0[: plant.commands]

    def whole(t: Array, z: Array, u: Array, w: Array) -> Array:
        added = by_d @ z[n:] + by_w @ w
        found = plant.model(t, z[:n], v0 + by_u @ (u - u0) + added[n:k])
        return np.concatenate(
            [found[:n] + added[:n], -(decay @ z[n:]), found[n:] + added[k:]]
        )

    # Argument 3 is w; rows from `size` on are the derivatives of the measurements.
    slopes = ArrayFunction.of(whole, ((), (size,), u0.shape, quiet.shape)).jacobian(3)
    fast = slopes(time, z, u0, quiet)[size:].any(axis=1)
    if fast.any():
        raise LinearAnalysisError(
            f"process noise enters what is measured, {', '.join(np.array(plant.outputs)[fast])}, with "
            "nothing in between: a sample of white noise has no covariance; make it a GaussMarkov disturbance"
        )

    def spread(t: Array, z: Array, u: Array) -> Array:
        by = slopes(t, z, u, quiet)[:size]
        return by @ density @ by.T + block_diagonal(np.zeros((n, n)), wandering)

    process = NonlinearProcess(
        lambda t, z, u: whole(t, z, u, quiet)[:size],
        lambda t, z, u: whole(t, z, u, quiet)[size:],
        states=size,
        measurements=len(plant.outputs),
        commands=u0.size,
        density=spread,
        state_names=[
            *plant.states,
            # Each column of `by_d` has a single 1, at the signal that it disturbs.
            *(f"disturbance/{labels[i]}" for i in by_d.argmax(axis=0)),
        ],
        **sampling,
    )
    return process, z, u0


def _assembled(
    what: str, given: Any, labels: Sequence[str], whole: int
) -> tuple[Vector, Vector]:
    """Return the columns of the identity of the signals with a covariance, and this covariance.

    A mapping gives a block-diagonal matrix. An array is the covariance of the first `whole` signals [-].
    """
    from scipy.linalg import block_diag

    unit = np.eye(len(labels))
    if given is not None and not isinstance(given, Mapping):
        return unit[:, :whole], covariance(what, given, whole)
    named = by_name(what, given)
    found = {name: label_places(labels, name).ravel() for name in named}
    parts = [
        covariance(f"{what} of '{name}'", named[name], where.size)
        for name, where in found.items()
    ]
    columns = np.fromiter(chain.from_iterable(found.values()), np.int64)
    return unit[:, columns], block_diag(np.zeros((0, 0)), *parts)

"""Kalman filters in one call, from a diagram or a linear model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.estimation.covariances import covariance, sampled_covariance
from trussflow.blocks.estimation.filters import ExtendedKalmanFilter, KalmanFilter, TimeVaryingKalmanFilter
from trussflow.blocks.estimation.names import places
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import exact
from trussflow.blocks.framework.errors import LinearAnalysisError, ParameterError
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.framework.validation import by_name, one_of, positive, shown
from trussflow.blocks.linear_analysis.jacobians import MODEL
from trussflow.blocks.linear_analysis.lifting import held_flow
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import Named as One
from trussflow.blocks.linear_analysis.references import (
    References,
    all_labels,
    all_named,
    layout_labels,
    named,
    split_index,
)
from trussflow.blocks.tracing.array_function import ArrayFunction

if TYPE_CHECKING:
    import control

KINDS = ("steady", "varying", "extended")


@dataclass(frozen=True)
class GaussMarkov:
    r"""A slow disturbance that forgets: :math:`\dot d = -d / \tau + w`.

    Parameters
    ----------
    standard_deviation : float
        Of d in the long run, above 0 [unit of the signal].
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
        positive(standard_deviation=self.standard_deviation, time_constant=self.time_constant)

    def rate_and_density(self, period: float) -> tuple[float, float]:
        """Return by what rate it forgets, and the density of w; sampled, of differences over a `period` [s]."""
        variance = self.standard_deviation**2
        if not period:
            return 1.0 / self.time_constant, 2.0 * variance / self.time_constant
        kept = np.exp(-period / self.time_constant)
        return (1.0 - kept) / period, variance * (1.0 - kept**2) / period


Named = Mapping[str, npt.ArrayLike]
"""Covariances by the name of what they are of."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Plant:
    """A plant opened at its inputs.

    Attributes
    ----------
    states, inputs, outputs : list of str
        Names; all outputs are measured.
    commands : list of int
        Which of the inputs are commands [-].
    values : callable
        Rates and then outputs, of (t, x, inputs), as a function that traces.
    rest : tuple
        Time, states and inputs where the estimate starts, and where the plant is linearized [as declared].
    units : tuple of Unit
        Of measurements and commands.
    period : float
        Sample time of a discrete model, whose rates are differences over it; 0 of a continuous one [s].
    """

    states: list[str]
    inputs: list[str]
    outputs: list[str]
    commands: list[int]
    values: Callable[[Array, Array, Array], Array]
    rest: tuple[float, Vector, Vector]
    units: tuple[Unit, Unit]
    period: float = 0.0


def kalman_filter(
    plant: Block | control.StateSpace,
    measured: References = None,
    inputs: References = None,
    *,
    every: float,
    measurement_noise: npt.ArrayLike,
    process_noise: By_name | npt.ArrayLike | None = None,
    disturbances: Mapping[str, npt.ArrayLike | GaussMarkov] | None = None,
    command_delay: float = 0.0,
    measurement_delay: float = 0.0,
    kind: str = "steady",
    initial_covariance: By_name | npt.ArrayLike | None = None,
    at: OperatingPoint | None = None,
    allow_unobserved: bool = False,
    steps: int = 1,
) -> KalmanFilter | TimeVaryingKalmanFilter | ExtendedKalmanFilter:
    r"""Return a Kalman filter for a plant: a sampled block that estimates its states, each by its name.

    The plant is linearized by exact Jacobians and sampled exactly, its commands held; ``kind="extended"`` keeps
    its own equations instead. Its inputs are `measurement` and `command`, nothing else; `estimate` is the state
    now, `prediction` the state when the command given now begins to act, both of the plant's states and then of
    the disturbances. ``of("block.state")`` is the part of the estimate that is one state, to be wired.

    A covariance is given as a matrix, as its diagonal, or as one number for all of the diagonal.

    Parameters
    ----------
    plant : Block or control.StateSpace
        A diagram or block, whose signals the filter then takes and gives as they are, or a linear model, such as
        `linearize` returns; then all are deviations from where that was linearized. A discrete model must be of
        the filter's sample time; white noise in it is held over each sample.
    measured, inputs : Port, str or sequence of these, optional
        What is measured, and what is commanded: ports of any block within, whole or sliced, as for `linearize`;
        what drives a commanded port in the diagram is cut off. By default all that the plant exposes.
    every : float
        Time between samples [s].
    measurement_noise : array_like
        Covariance of the noise in one measurement, positive definite [unit²].
    process_noise : mapping or array_like, optional
        Power spectral density of white noise, two-sided, by the name of what it enters: a state, into whose rate
        [(unit/s)² s], or an input, to which it adds [unit² s]. Or one density for the rates of all states.
    disturbances : mapping, optional
        Slow disturbances to be estimated, by the name of what they add to: the rate of a state, an input, or a
        measured output. A density says how fast a constant may wander [unit²/s]; or a `GaussMarkov`. The names of
        the estimates begin with ``disturbance.``.
    command_delay, measurement_delay : float
        Multiples of `every`: from a command until it acts, and from what is measured until it arrives [s].
    kind : str
        ``"steady"``: constant gain. ``"varying"``: linear, with the gain of an initial covariance.
        ``"extended"``: linearized at the estimate in each sample.
    initial_covariance : mapping or array_like
        Of the error of the estimate at the start, by name, or of all; not for the steady filter [unit²].
    at : OperatingPoint, optional
        Where a diagram is linearized, and where the estimate starts.
    allow_unobserved : bool
        Whether states that the measurements do not show may be left to the model, if they decay.
    steps : int
        Steps of the integration in each sample, for the extended filter [-].

    Returns
    -------
    KalmanFilter, TimeVaryingKalmanFilter or ExtendedKalmanFilter
        The block.

    Raises
    ------
    LinearAnalysisError
        If what is measured does not show a state, white noise is in what is measured, or the plant cannot be
        linearized.
    NameLookupError
        If there is no state or signal of a name; the message lists those there are.
    ParameterError
        If a covariance has another shape, or is not symmetric and positive (semi)definite.
    SimulationError
        If a time is not above 0, or a delay no multiple of `every`.

    Notes
    -----
    The covariance of the noise in a sample is that of Van Loan (1978); the filter that of Anderson and Moore
    (1979). Whether an extended filter can observe what it should is not checked: it changes with the state.
    """
    one_of("kind of Kalman filter", kind, KINDS)
    positive(every=every)
    slow = by_name("disturbances", disturbances)
    names = [*(process_noise if isinstance(process_noise, Mapping) else ()), *slow]
    if isinstance(plant, Block):
        opened = _of_block(plant, measured, inputs, names, at, linear=kind != "extended")
    else:
        opened = _of_model(plant, measured, inputs, every, linear=kind != "extended")
    function, density, states = _augmented(opened, process_noise, slow)
    n, (time, x, v) = len(states), opened.rest
    z, u = np.concatenate([x, np.zeros(n - x.size)]), v[opened.commands]
    settings: dict[str, Any] = {
        "every": every,
        "command_delay": command_delay,
        "measurement_delay": measurement_delay,
        "state_names": states,
        "initial_estimate": z,
        "initial_command": u,
        "measurement_unit": opened.units[0],
        "command_unit": opened.units[1],
    }
    if kind != "steady":
        if initial_covariance is None:
            raise ParameterError(f"a filter of kind '{kind}' needs initial_covariance: of its first estimate")
        rows, matrix = _assembled("initial_covariance", initial_covariance, states, n)
        settings["initial_covariance"] = rows @ matrix @ rows.T
    if kind == "extended":
        return ExtendedKalmanFilter(
            lambda t, z, u: function(t, z, u)[:n],
            lambda t, z, u: function(t, z, u)[n:],
            states=n,
            measurements=len(opened.outputs),
            commands=u.size,
            process_noise=density,
            measurement_noise=measurement_noise,
            steps=steps,
            **settings,
        )
    by_z, by_u = function.jacobian(1)(time, z, u), function.jacobian(2)(time, z, u)
    constant = function(time, z, u) - by_z @ z - by_u @ u
    driven = np.column_stack([by_u[:n], constant[:n]])
    if opened.period:
        flow, driven, noise = np.eye(n) + every * by_z[:n], every * driven, every * density(time, z, u)
    else:
        noise = sampled_covariance(by_z[:n], density(time, z, u), every)
        flow, driven = held_flow(by_z[:n], driven, every)
    return (KalmanFilter if kind == "steady" else TimeVaryingKalmanFilter)(
        flow,
        driven[:, :-1],
        by_z[n:],
        by_u[n:],
        drift=driven[:, -1],
        bias=constant[n:],
        process_covariance=noise,
        measurement_covariance=measurement_noise,
        allow_unobserved=allow_unobserved,
        **settings,
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
    """Open a diagram at commands, measurements, and what noise and disturbances enter."""
    system = flatten(plant, external=True)
    commands, shown = all_named(system, inputs, plant.inputs()), all_named(system, measured, plant.outputs())
    states = [f"{path}.{name}" for path, block in system.blocks.items() for name in block.states()]
    entries = [named(system, name) for name in names if not _is_state(name, states)]
    known = set(all_labels([*commands, *shown]))
    extra = [one for one in entries if set(one.labels()) - known]
    ports = [one.port for one in [*commands, *extra]]
    driven = [one.port for one in commands if one.port.block is not plant]
    linearizer = Linearizer(plant, ports, [one.port for one in shown], cut=driven)
    model, point, (x, d, p) = linearizer.rewired(at)
    if model.instants is not None or (model.plan.python_blocks and not linear):
        raise LinearAnalysisError(
            f"cannot make a Kalman filter of '{plant.name}' as it is: it has "
            + (
                "sampled blocks"
                if model.instants is not None
                else "Python blocks, which have no exact Jacobians"
            )
            + "; linearize it, and give the model: the filter then works on deviations"
        )
    into = np.zeros((d.size, model.input_columns.size))
    into[model.input_columns - x.size, np.arange(model.input_columns.size)] = 1.0
    v = into.T @ d
    rows = [*range(x.size), *model.output_rows.tolist()]
    if linear:
        found = linearizer.at(at)
        with model.at(point.time, p) as local:
            rest = local.values(MODEL, x, d)[rows]
        values = _linear(np.block([[found.A, found.B], [found.C, found.D]]), x, v, rest)
    else:
        program = model.jacobians.program(MODEL)
        function = ArrayFunction(program.function.expand(), (program.size,))

        def values(t: Array, x: Array, v: Array) -> Array:
            return function(t, x, d + into @ (v - into.T @ d), p)[rows]

    return Plant(
        states=layout_labels(model.plan.x),
        inputs=all_labels([*commands, *extra]),
        outputs=all_labels(shown),
        commands=list(range(len(all_labels(commands)))),
        values=values,
        rest=(point.time, x, v),
        units=(_units(shown), _units(commands)),
    )


def _is_state(name: str, states: Sequence[str]) -> bool:
    """Tell whether a name, maybe without its path, is that of a state."""
    text = split_index(name)[0]
    return any(state == text or state.endswith(f".{text}") for state in states)


def _units(found: Sequence[One]) -> Unit:
    """Return the units of all elements, if all have one."""
    units = [unit for one in found for unit in one.port.element_units()]
    return None if None in units else tuple(map(str, units))


def _of_model(
    system: control.StateSpace, measured: References, inputs: References, every: float, *, linear: bool
) -> Plant:
    """Choose commands and measurements of a linear model."""
    if not hasattr(system, "state_labels"):
        raise LinearAnalysisError(
            f"a Kalman filter is made of a block, or of a linear model, not of {shown(system)}"
        )
    if not linear:
        raise LinearAnalysisError(
            "an extended Kalman filter needs a diagram, or functions: a model is linear"
        )
    if system.isdtime(strict=True) and exact(float(system.dt)) != exact(every):
        raise LinearAnalysisError(
            f"the model is sampled every {system.dt} s, the filter every {every} s: they must be equal"
        )
    period = every if system.isdtime(strict=True) else 0.0
    n, rows, columns = (
        system.nstates,
        _chosen(system.output_labels, measured),
        _chosen(system.input_labels, inputs),
    )
    # Differences over the period are rates to what comes, and sampling makes next states of them again.
    rates = (
        (np.hstack([system.A - np.eye(n), system.B]) / period) if period else np.hstack([system.A, system.B])
    )
    matrix = np.vstack([rates, np.hstack([system.C, system.D])[rows]])
    x, v = np.zeros(n), np.zeros(system.ninputs)
    return Plant(
        states=list(system.state_labels),
        inputs=list(system.input_labels),
        outputs=[system.output_labels[i] for i in rows],
        commands=columns,
        values=_linear(matrix, x, v, np.zeros(n + len(rows))),
        rest=(0.0, x, v),
        units=(None, None),
        period=period,
    )


def _chosen(labels: Sequence[str], references: References) -> list[int]:
    """Return the numbers of the signals of a model that are named; by default all."""
    if references is None:
        return list(range(len(labels)))
    chosen = references if isinstance(references, list | tuple) else [references]
    return [int(i) for one in chosen for i in np.ravel(places(labels, one))]


def _linear(matrix: Vector, x0: Vector, v0: Vector, rest: Vector) -> Callable[[Array, Array, Array], Array]:
    """Return rates and outputs as a linear function of (t, x, v) around a point."""
    n = x0.size
    return lambda t, x, v: rest + matrix[:, :n] @ (x - x0) + matrix[:, n:] @ (v - v0)


def _augmented(
    plant: Plant, process_noise: Named | npt.ArrayLike | None, slow: Mapping[str, Any]
) -> tuple[ArrayFunction, Callable[[Array, Array, Array], Array], list[str]]:
    """Return a plant with its disturbances as states: rates and outputs, density of the noise, names."""
    n, m, period = len(plant.states), len(plant.outputs), plant.period
    signals = [*plant.states, *plant.inputs]
    k, labels = len(signals), [*signals, *plant.outputs]
    noise, density = _assembled("process_noise", process_noise, signals, n)
    densities: dict[str, npt.ArrayLike] = {}
    rates = [np.zeros(0)]
    for name, one in slow.items():
        rate, densities[name] = one.rate_and_density(period) if isinstance(one, GaussMarkov) else (0.0, one)
        rates.append(np.full(places(labels, name).size, rate))
    entry, wandering = _assembled("disturbances", densities, labels, 0)
    size = n + entry.shape[1]
    # Rows of z = (x, d), and how rates, inputs and outputs of the plant depend on z, u and the noise w.
    state, slowly, lift = np.eye(n, size), np.eye(size)[n:], np.eye(size + m, n + m)
    lift[n:, n:] = np.eye(size + m - n, m, -(size - n))
    by_z = lift @ np.vstack([entry[:n], entry[k:]]) @ slowly
    by_z[:size] -= slowly.T @ np.diag(np.concatenate(rates)) @ slowly
    by_w = lift @ np.vstack([noise[:n], np.zeros((m, len(density)))])
    v_by_u, v_by_d, v_by_w = np.eye(k - n)[:, plant.commands], entry[n:k] @ slowly, noise[n:]
    at_rest = plant.rest[2] - v_by_u @ plant.rest[2][plant.commands]

    def everything(t: Array, z: Array, u: Array, w: Array) -> Array:
        v = at_rest + v_by_u @ u + v_by_d @ z + v_by_w @ w
        return lift @ plant.values(t, state @ z, v) + by_z @ z + by_w @ w

    quiet, shapes = np.zeros(len(density)), ((), (size,), (len(plant.commands),))
    whole = ArrayFunction.of(everything, (*shapes, quiet.shape))
    by_noise, wandering = whole.jacobian(3), slowly.T @ wandering @ slowly
    at = plant.rest[0], state.T @ plant.rest[1], plant.rest[2][plant.commands]
    shown = by_noise(*at, quiet)[size:].any(axis=1)
    if shown.any():
        raise LinearAnalysisError(
            f"process noise enters what is measured, {', '.join(np.array(plant.outputs)[shown])}, with nothing in "
            "between: a sample of white noise has no covariance; make it a disturbance, GaussMarkov(...)"
        )

    def spread(t: Array, z: Array, u: Array) -> Array:
        by = by_noise(t, z, u, quiet)[:size]
        return by @ density @ by.T + wandering

    names = [f"disturbance/{labels[i]}" for i in np.argmax(entry, axis=0)]
    return (
        ArrayFunction.of(lambda t, z, u: everything(t, z, u, quiet), shapes),
        spread,
        [*plant.states, *names],
    )


def _assembled(
    what: str, given: Named | npt.ArrayLike | None, labels: Sequence[str], whole: int
) -> tuple[Vector, Vector]:
    """Return which of the signals have a covariance, as columns of the identity, and that covariance.

    Given by names, it is block diagonal; else it is that of the first signals, the `whole` number of them [-].
    """
    from scipy.linalg import block_diag

    unit = np.eye(len(labels))
    if given is None:
        given = {}
    if not isinstance(given, Mapping):
        return unit[:, :whole], covariance(what, given, whole)
    found = {name: places(labels, name).ravel() for name in by_name(what, given)}
    parts = [covariance(f"{what} of '{name}'", given[name], places.size) for name, places in found.items()]
    columns = [np.zeros(0, dtype=np.int64), *found.values()]
    return unit[:, np.concatenate(columns)], block_diag(np.zeros((0, 0)), *parts)

r"""Exact derivatives of functions of a run with respect to parameters and initial states.

A fixed-step run is a composition of ticks, each with the sampled blocks and one step of the solver,

.. math:: z_{k+1} = T_k(z_k, q), \qquad y_k = g_k(z_k, q), \qquad J = J(y_0, \ldots, y_n),

with z = (x, d), and the varied values q. CasADi differentiates the composition in forward or reverse mode,
whichever needs less work (Griewank, Walther 2008, *Evaluating Derivatives*, chapter 3). So the derivatives
have no error of finite differences, and belong to the same steps as the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import prod
from typing import Any, Unpack

import casadi as ca
import numpy as np

from trussflow.blocks.errors import (
    DivergenceError,
    Explained,
    NameLookupError,
    SimulationError,
    TracingError,
)
from trussflow.blocks.framework.clock import exact, ticks
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.layout import Layout, spans
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.simulator import Simulator, SimulatorSettings
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import by_name, finite_array, positive
from trussflow.blocks.sweeps.tangents import TangentExecutor
from trussflow.blocks.tracing.call_checks import brief
from trussflow.blocks.tracing.kernels import (
    shape_of,
    symbol,
    to_expression,
    written_out,
)

AFFINITY_TOLERANCE = 1e-9
"""Largest deviation of initial states from affine functions of q, relative to their change [-]."""

Run = Mapping[str, Array]
"""Logged signals by name, with time along the first axis; and ``"time"``."""


class _Rows(dict[str, Array]):
    """Logged signals by name; the error for another name lists them."""

    def __missing__(self, name: str) -> Array:
        raise NameLookupError(
            f"no signal '{name}' is logged; there are: {', '.join(self)}"
        )


class DifferentiatedRun:
    """Functions of a run, as one function of the varied values, with its exact derivative.

    Parameters
    ----------
    simulator : Simulator
        Simulator with fixed steps, without Python blocks or iterated loops.
    duration : float
        Time to simulate [s].
    functions : mapping of callable
        Functions by name, from the logged signals as traced arrays by name to numbers.
    names : iterable of str
        Varied parameters and initial states, ``"block.name"``.

    Attributes
    ----------
    values : Layout
        Order of the varied values in q.
    results : dict
        Shape of the result of each function by name.

    Raises
    ------
    SimulationError
        If the run cannot be differentiated, or `names` is empty.
    NameLookupError
        If there is no such parameter or state, or a function uses a signal that is not logged.
    TracingError
        If a function does not trace.
    """

    def __init__(
        self,
        simulator: Simulator,
        duration: float,
        functions: Mapping[str, Callable[[Run], Any]],
        names: Iterable[str],
    ) -> None:
        positive(duration=duration)
        prepared = simulator.prepared
        _refuse(prepared)
        self._plan = plan = prepared.plan
        varied = plan.x, plan.memory
        entries = [plan.p.find(name, "parameter or state", *varied) for name in names]
        if not entries:
            raise SimulationError(
                "nothing varies: name parameters or initial states, such as 'block.name'"
            )
        self.values = Layout((e.path, e.name, e.shape) for e in entries)
        self._parameters = [
            (e, plan.p.entries[key])
            for key, e in self.values.entries.items()
            if key in plan.p.entries
        ]
        every = ticks(simulator.log_step or exact(duration), prepared.tick, "log_step")
        end = ticks(exact(duration), prepared.tick, "the duration")
        # A run logs its end, too, even between two multiples of log_step.
        instants = np.unique([*range(0, end, every), end])
        self.results: dict[str, tuple[int, ...]] = {}
        self._made = self._made_of(
            prepared,
            np.asarray(instants * prepared.tick_seconds, dtype=float),
            functions,
        )
        self._instants = instants
        many, size = self.values.size, plan.x.size + plan.d_size
        if plan.has_events:
            self._executor = TangentExecutor(prepared, many)
            return
        # Called with at = q: the initial value is then z, and its
        # derivative by q is `slopes`.
        q, at, z = (ca.MX.sym("symbol", n) for n in (many, many, size))
        slopes = ca.MX.sym("slopes", size, many)
        # The last tick logs the end; the step that follows it is not used.
        count = int(instants[-1]) + 1
        run = self._tick(prepared, size).mapaccum("run", count)
        times, due = _calendar(prepared, count)
        _, rows = run(z + slopes @ (q - at), ca.repmat(q, 1, count), times, due)
        found = self._made(rows[:, instants.tolist()])
        self._function = ca.Function(
            "differentiated", [q, at, z, slopes], [found, ca.jacobian(found, q)]
        )

    def _tick(self, prepared: Prepared, size: int) -> ca.Function:
        """Return the function of one tick: sampled blocks, logged outputs, and a step of the solver."""
        plan = self._plan
        programs = {program.name: program.expanded for program in prepared.programs}
        sizes = {"z": size, "q": self.values.size, "t": 3, "due": 1}
        z, q, times, due = (ca.MX.sym(name, n) for name, n in sizes.items())
        # Defaults are constants; only varied parameters depend on q.
        p = ca.MX(plan.parameters({}))
        for e, own in self._parameters:
            p[own.start : own.stop] = q[e.start : e.stop]
        x, d = ca.vertsplit(z, [0, plan.x.size, plan.x.size + plan.d_size])
        # Set 0 samples nothing. The last argument lets CasADi evaluate
        # the chosen branch only.
        for number in range(1, len(prepared.schedule.sets)):
            d = ca.if_else(
                due == number, programs[f"sample_{number}"](times[0], x, d, p), d, True
            )

        def rate(time: ca.MX, state: ca.MX) -> ca.MX:
            return programs["derivative"](time, state, d, p)

        step, instants = float(prepared.step or 0.0), ca.vertsplit(times)
        after = FIXED_STEP[prepared.solver.solver](rate, instants, step, x)
        rows = programs["outputs"](times[0], x, d, p)
        return ca.Function("tick", [z, q, times, due], [ca.vertcat(after, d), rows])

    def _made_of(
        self,
        prepared: Prepared,
        times: Vector,
        functions: Mapping[str, Callable[[Run], Any]],
    ) -> ca.Function:
        """Return the function from all logged rows, as columns, to the results of the functions."""
        width = sum(channel.port.size for channel in prepared.channels)
        logged, rows = ca.SX.sym("rows", width, len(times)), _Rows(time=times)
        leaves, values = [], []
        for channel in prepared.channels:
            elements = channel.port.elements()
            rows[channel.name] = symbol(channel.name, (len(times), *elements.shape))
            leaves.append(to_expression(rows[channel.name]))
            values.append(
                ca.vec(logged[(channel.columns.start + elements.ravel()).tolist(), :])
            )
        # The functions are traced with plain symbols for the signals, which are then
        # replaced by the columns of the logged rows.
        found = []
        for name, function in functions.items():
            with explained(name), written_out():
                value = function(rows)
                self.results[name] = shape_of(value)
                found.append(to_expression(value))
        column = ca.substitute(
            ca.vertcat(*found), ca.vertcat(*leaves), ca.vertcat(*values)
        )
        return ca.Function("made", [logged], [ca.densify(column)])

    def __call__(
        self, values: Mapping[str, Any]
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return the results of the functions, and their derivatives by the varied values.

        Parameters
        ----------
        values : mapping
            All varied values by name [as declared].

        Returns
        -------
        found : dict
            Results by the name of the function [what it returns].
        derivatives : dict
            Jacobians by the name of the function: a row for each element of the result, a column for each
            element of the varied values, in the order of `values`.

        Raises
        ------
        SimulationError
            If initial states are not affine functions of a parameter.
        DivergenceError
            If a result is not finite.
        ParameterError
            If a value is not allowed.
        """
        q = np.zeros(self.values.size)
        for e in self.values:
            name = f"{e.path}.{e.name}"
            array = finite_array(f"'{name}'", values[name], e.shape)
            self.values.put(q, e.path, e.name, array)
        z = self._start(q)
        slopes = self._slopes(q, z)
        if self._plan.has_events:
            found, derivative = self._through_events(q, z, slopes)
        else:
            found, derivative = (m.full() for m in self._function(q, q, z, slopes))
        if not np.isfinite(found).all():
            named = self.values.named(q)
            shown = ", ".join(f"{name} = {value}" for name, value in named.items())
            raise DivergenceError(f"a result of the run is not finite with {shown}")
        places = spans(map(prod, self.results.values()))
        results, derivatives = dict[str, Array](), dict[str, Array]()
        for (name, shape), rows in zip(self.results.items(), places, strict=True):
            results[name] = found[rows, 0].reshape(shape)
            derivatives[name] = derivative[rows]
        return results, derivatives

    def _through_events(
        self, q: Vector, z: Vector, slopes: Array
    ) -> tuple[Array, Array]:
        """Return the results of the functions for a run with events, and their derivative by q."""
        states = self._plan.x.size
        p, _ = self._p_and_initial(q)
        # A varied parameter is itself an element of q: its derivative is a unit vector.
        moved = np.zeros((len(p), len(q)))
        for e, own in self._parameters:
            moved[own.start : own.stop, e.start : e.stop] = np.eye(own.stop - own.start)
        parts = (z[:states], z[states:], p), (slopes[:states], slopes[states:], moved)
        rows, along = self._executor.run(self._instants, *parts)
        found = self._made(rows.T)
        # From (ticks, width, q): the columns of all ticks for each direction, side by
        # side, as forward() of CasADi expects.
        seeds = np.moveaxis(along, 2, 0).reshape(-1, rows.shape[1]).T
        derivative = self._made.forward(len(q))(rows.T, found, seeds)
        return found.full(), derivative.full()

    def _p_and_initial(self, q: Vector) -> tuple[Vector, dict[str, Array]]:
        """Return p, and the varied initial states by name."""
        initial = self.values.named(q)
        names = [f"{e.path}.{e.name}" for e, _ in self._parameters]
        p = self._plan.parameters({name: initial.pop(name) for name in names})
        return p, initial

    def _start(self, q: Vector) -> Vector:
        """Return the initial x and d."""
        return np.concatenate(self._plan.initial(*self._p_and_initial(q)))

    def _slopes(self, q: Vector, z: Vector) -> Vector:
        """Return the derivative of the initial x and d by q: exact, as they are affine functions of q."""
        columns = []
        for k in range(len(q)):
            step = np.zeros(len(q))
            # A power of two, so that differences of an affine function are not rounded.
            step[k] = np.spacing(abs(q[k]) + 1.0) * 2.0**40
            # An affine function changes twice as much over twice the step.
            once, twice = self._start(q + step) - z, self._start(q + 2.0 * step) - z
            if np.max(
                np.abs(twice - 2.0 * once), initial=0.0
            ) > AFFINITY_TOLERANCE * np.max(np.abs(twice), initial=0.0):
                raise SimulationError(
                    f"initial states are no affine function of {self.values.describe(k)}, so they cannot be "
                    "differentiated; vary the initial states instead"
                )
            columns.append(once / step[k])
        return np.column_stack(columns)


def gradient(
    diagram: Diagram,
    duration: float,
    function: Callable[[Run], Any],
    values: Mapping[str, Any],
    **settings: Unpack[SimulatorSettings],
) -> tuple[Array, dict[str, Array]]:
    """Return a function of a run, and its exact derivative by parameters and initial states.

    Parameters
    ----------
    diagram : Diagram
        Diagram to run with fixed steps, without Python blocks or iterated loops.
    duration : float
        Time to simulate [s].
    function : callable
        Function from the run to a number or an array. ``run["block.port"]`` is an array with time along the
        first axis, and ``run["time"]`` has the times. The function must trace, as equations of blocks.
    values : mapping
        Parameters and initial states, ``"block.name"``, for the derivative [as declared].
    **settings
        As for `Simulator`: log, log_step, step, solver.

    Returns
    -------
    value : array
        Result of the function [what the function returns].
    derivatives : dict of array
        Derivatives by the names in `values`. The shape is that of the result followed by that of the value.

    Raises
    ------
    SimulationError
        If the run cannot be differentiated.
    DivergenceError
        If the value is not finite.
    NameLookupError
        If there is no such parameter or state.
    TracingError
        If the function does not trace.

    Examples
    --------
    >>> import numpy as np
    >>> from trussflow.blocks import Diagram, Gain, Integrator, gradient
    >>> loop = Diagram("decay")
    >>> law, level = loop.add(law=Gain(-2.0), level=Integrator(3.0))
    >>> _ = law >> level >> law
    >>> end = lambda run: run["level.y"][-1]
    >>> value, by = gradient(loop, 1.0, end, {"law.gain": -2.0}, step=1e-3)
    >>> round(float(value), 6), round(float(by["law.gain"]), 6)
    (0.406006, 0.406006)
    """
    values = by_name("values", values)
    differentiated = DifferentiatedRun(
        Simulator(diagram, **settings), duration, {"it": function}, values
    )
    value, derivatives = differentiated(values)
    found, slopes = value["it"], derivatives["it"]
    return found, {
        f"{e.path}.{e.name}": slopes[:, e.start : e.stop].reshape(found.shape + e.shape)
        for e in differentiated.values
    }


def _refuse(prepared: Prepared) -> None:
    """Check that runs can be differentiated.

    Raises
    ------
    SimulationError
        If there are Python blocks, iterated loops, or an adaptive solver.
    """
    plan = prepared.plan
    found = {
        "Python blocks, which have no derivatives": bool(plan.python_blocks),
        "algebraic loops found by iteration": bool(plan.guesses.size),
        "transport delays": bool(plan.histories.size),
        f"the adaptive solver '{prepared.solver.solver}'; use rk4 or euler": not prepared.solver.is_fixed,
    }
    there = [what for what, is_there in found.items() if is_there]
    if there:
        raise SimulationError(
            f"cannot differentiate the run of '{plan.name}': it has {'; '.join(there)}"
        )


def explained(name: str) -> Explained:
    """Convert an exception from the function of that `name` during tracing into a `TracingError`."""
    return Explained(
        lambda error: TracingError(
            f"cannot differentiate {name}: {brief(error)}\n  it is called with traced arrays, which have no "
            "numbers, and may use the same functions as equations of blocks"
        )
    )


def _calendar(prepared: Prepared, count: int) -> tuple[Vector, Vector]:
    """Return the start, middle and end time of each of `count` ticks [s], and its due set of clocks."""
    times = np.arange(count + 1) * float(prepared.tick)
    begin, end = times[:-1], times[1:]
    middle = begin + prepared.tick_seconds / 2
    due = prepared.schedule.due(0, count)[None].astype(float)
    # As in `Executor._step`: a signal that jumps at the end has not jumped yet.
    return np.array([begin, middle, np.nextafter(end, begin)]), due

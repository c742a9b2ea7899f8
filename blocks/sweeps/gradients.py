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
from trussflow.blocks.framework.clock import exact
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.simulator import Simulator, SimulatorSettings
from trussflow.blocks.simulation.solver import fixed_step
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
    shapes : dict
        Shape of each varied value by name.
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
        entries = {
            name: plan.p.find(name, "parameter or state", plan.x, plan.memory)
            for name in names
        }
        if not entries:
            raise SimulationError(
                "nothing varies: name parameters or initial states, such as 'block.name'"
            )
        self.shapes = {name: e.shape for name, e in entries.items()}
        self._parameters = {
            n: e for n, e in entries.items() if (e.path, e.name) in plan.p.entries
        }
        self._places = dict(
            zip(self.shapes, spans(map(prod, self.shapes.values())), strict=True)
        )
        every = prepared.ticks(simulator.log_step or exact(duration), "log_step")
        end = prepared.ticks(exact(duration), "the duration")
        instants = np.unique([*range(0, end, every), end])
        self.results: dict[str, tuple[int, ...]] = {}
        made = self._made_of(
            prepared,
            np.asarray(instants * prepared.tick_seconds, dtype=float),
            functions,
        )

        self._instants, self._made = instants, made
        if plan.has_events:
            self._executor = TangentExecutor(
                prepared, sum(map(prod, self.shapes.values()))
            )
            return
        q, at, z, slopes = (
            ca.MX.sym(n, *size)
            for n, size in zip(("q", "at", "z", "slopes"), self._sizes(), strict=True)
        )
        ticks = int(instants[-1]) + 1
        run = self._tick(prepared).mapaccum("run", ticks)
        times, due = _calendar(prepared, ticks)
        _, rows = run(z + slopes @ (q - at), ca.repmat(q, 1, ticks), times, due)
        found = made(rows[:, instants.tolist()])
        self._function = ca.Function(
            "differentiated", [q, at, z, slopes], [found, ca.jacobian(found, q)]
        )

    def _sizes(self) -> list[tuple[int, int]]:
        many, size = (
            sum(map(prod, self.shapes.values())),
            self._plan.x.size + self._plan.d_size,
        )
        return [(many, 1), (many, 1), (size, 1), (size, many)]

    def _tick(self, prepared: Prepared) -> ca.Function:
        """Return the function of one tick: sampled blocks, logged outputs, and a step of the solver."""
        plan, programs = (
            self._plan,
            {program.name: program.expanded for program in prepared.programs},
        )
        z, q, times, due = (
            ca.MX.sym(name, size)
            for name, size in (
                ("z", self._sizes()[2][0]),
                ("q", self._sizes()[0][0]),
                ("t", 3),
                ("due", 1),
            )
        )
        p = ca.MX(plan.parameters({}))
        for name, entry in self._parameters.items():
            p[entry.start : entry.stop] = q[self._places[name]]
        x, d = ca.vertsplit(z, [0, plan.x.size, plan.x.size + plan.d_size])
        for number in range(1, len(prepared.schedule.sets)):
            d = ca.if_else(
                due == number, programs[f"sample_{number}"](times[0], x, d, p), d, True
            )

        def rate(time: ca.MX, state: ca.MX) -> ca.MX:
            return programs["derivative"](time, state, d, p)

        step, instants = float(prepared.step or 0.0), ca.vertsplit(times)
        after = fixed_step(prepared.solver.solver, rate, instants, step, x)
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
    ) -> tuple[dict[str, Array], dict[str, dict[str, Array]]]:
        """Return the results of the functions, and their derivatives by the varied values.

        Parameters
        ----------
        values : mapping
            All varied values by name [as declared].

        Returns
        -------
        found : dict
            Results by the name of the function [what it returns].
        derivatives : dict of dict
            Derivatives by the names of the function and of the varied value. The shape is that of the
            result followed by that of the value.

        Raises
        ------
        SimulationError
            If initial states are not affine functions of a parameter.
        DivergenceError
            If a result is not finite.
        ParameterError
            If a value is not allowed.
        """
        arrays = {
            n: finite_array(f"'{n}'", values[n], shape)
            for n, shape in self.shapes.items()
        }
        q = np.concatenate([np.ravel(value) for value in arrays.values()])
        z = self._start(q)
        slopes = self._slopes(q, z)
        if self._plan.has_events:
            found, derivative = self._through_events(q, z, slopes)
        else:
            found, derivative = (m.full() for m in self._function(q, q, z, slopes))
        if not np.isfinite(found).all():
            shown = ", ".join(f"{name} = {value}" for name, value in arrays.items())
            raise DivergenceError(f"a result of the run is not finite with {shown}")
        rows = dict(
            zip(self.results, spans(map(prod, self.results.values())), strict=True)
        )
        return (
            {
                name: found[rows[name], 0].reshape(shape)
                for name, shape in self.results.items()
            },
            {
                name: {
                    one: derivative[rows[name], self._places[one]].reshape(
                        (*shape, *own)
                    )
                    for one, own in self.shapes.items()
                }
                for name, shape in self.results.items()
            },
        )

    def _through_events(
        self, q: Vector, z: Vector, slopes: Array
    ) -> tuple[Array, Array]:
        """Return the results of the functions for a run with events, and their derivative by q."""
        p, states = self._plan.parameters(self._named(q, of_p=True)), self._plan.x.size
        moved = np.zeros((len(p), len(q)))
        for name, entry in self._parameters.items():
            moved[entry.start : entry.stop, self._places[name]] = np.eye(
                entry.stop - entry.start
            )
        parts = (z[:states], z[states:], p), (slopes[:states], slopes[states:], moved)
        rows, along = self._executor.run(self._instants, *parts)
        found = self._made(rows.T)
        seeds = np.moveaxis(along, 2, 0).reshape(-1, rows.shape[1]).T
        derivative = self._made.forward(len(q))(rows.T, found, seeds)
        return found.full(), derivative.full()

    def _named(self, q: Vector, *, of_p: bool) -> dict[str, Array]:
        """Return the varied parameters, or the varied initial states, by name."""
        names = [name for name in self.shapes if (name in self._parameters) == of_p]
        return {
            name: q[self._places[name]].reshape(self.shapes[name]) for name in names
        }

    def _start(self, q: Vector) -> Vector:
        """Return the initial x and d."""
        p = self._plan.parameters(self._named(q, of_p=True))
        return np.concatenate(self._plan.initial(p, self._named(q, of_p=False)))

    def _slopes(self, q: Vector, z: Vector) -> Vector:
        """Return the derivative of the initial x and d by q: exact, as they are affine functions of q."""
        columns = []
        for k, name in enumerate(
            n for n, shape in self.shapes.items() for _ in range(prod(shape))
        ):
            step = np.zeros(len(q))
            step[k] = (
                np.spacing(abs(q[k]) + 1.0) * 2.0**40
            )  # a power of two, so that differences of an affine function are not rounded
            once, twice = self._start(q + step) - z, self._start(q + 2.0 * step) - z
            if np.max(
                np.abs(twice - 2.0 * once), initial=0.0
            ) > AFFINITY_TOLERANCE * np.max(np.abs(twice), initial=0.0):
                raise SimulationError(
                    f"initial states are no affine function of '{name}', so they cannot be differentiated; "
                    "vary the initial states instead"
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
    return value["it"], derivatives["it"]


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


def _calendar(prepared: Prepared, ticks: int) -> tuple[Vector, Vector]:
    """Return the start, middle and end time of each tick [s], and the set of clocks due at its start."""
    times = np.arange(ticks + 1) * float(prepared.tick)
    begin, end = times[:-1], times[1:]
    middle = begin + prepared.tick_seconds / 2
    due = prepared.schedule.due(0, ticks)[None].astype(float)
    return np.array([begin, middle, np.nextafter(end, begin)]), due

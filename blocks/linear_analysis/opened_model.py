"""A diagram opened for linear analysis (inputs put in, wires cut, signals tapped), and its exact Jacobians."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cache, cached_property
from itertools import chain
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.external_inputs import External
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.signal_injection import injected, probed, readers
from trussflow.blocks.framework.system import Indices, System
from trussflow.blocks.linear_analysis.lifting import Jump, Pattern, pattern
from trussflow.blocks.linear_analysis.operating_point import (
    OperatingPoint,
    as_wired,
    completed,
    given_point,
)
from trussflow.blocks.linear_analysis.python_derivatives import (
    differences,
    offered,
    refuse_hidden,
)
from trussflow.blocks.linear_analysis.references import Named
from trussflow.blocks.simulation.block_instances import BlockCall
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.solver import Solver
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.call_checks import running_errors
from trussflow.blocks.tracing.evaluation import Evaluation
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.quantities import Quantity, derivative
from trussflow.blocks.tracing.quantities import outputs as values_of
from trussflow.blocks.tracing.sparsity import ColumnGroup, column_groups

RATES_AND_OUTPUTS = derivative().name
"""Name of the quantity made of dx/dt and then the values of ports."""


class OpenedModel:
    """One way of opening a diagram for linear analysis, traced.

    Parameters
    ----------
    system : System
        The flat diagram.
    inputs, outputs : sequence of Named
        Input and output ports.
    cuts : sequence of Named
        Inputs, or further wires, whose drivers are replaced.

    Attributes
    ----------
    plan, assembly : Plan, Prepared
        The plan of the opened diagram, with its clocks and Python blocks.
    programs : dict of str to Program
        The traced quantities, keyed by name.
    forward, written_out : callable
        Derivatives of the quantity of a name: along given directions, and by all of (x, d).
    groups : callable
        Groups of columns of the Jacobian of the quantity of a name by (x, d).
    instants : Pattern or None
        Schedule of the sampled blocks; None without any.
    input_columns : array of int
        Indices of the inputs in (x, d).
    output_rows : array of int
        Indices of the outputs in the quantity `RATES_AND_OUTPUTS`.
    """

    def __init__(
        self,
        system: System,
        inputs: Sequence[Named],
        outputs: Sequence[Named],
        cuts: Sequence[Named],
    ) -> None:
        self._wired = system
        refuse_hidden(system)
        _refuse_overlaps(
            cuts, [*inputs, *cuts, *(one for one in outputs if one.port.is_input)]
        )
        cut = {one.key for one in cuts}
        taps: list[Port] = []
        for one in outputs:
            system, tap = (
                # The driver of a cut input is replaced below. The probe keeps what
                # arrives there.
                probed(system, one.port) if one.key in cut else (system, one.leaf)
            )
            taps.append(tap)
        sources = dict[Any, tuple[str, Indices]]()
        for one in [*inputs, *cuts]:
            # A signal that is an input and cut has one source, its only driver.
            if one.key not in sources:
                system, path, elements = _put_in(system, one, cut=one.key in cut)
                sources[one.key] = path, elements
        self.plan = Plan(system)
        self._cut = [one.leaf for one in cuts]
        self._cut_columns = self._columns(sources[one.key] for one in cuts)
        self.input_columns = self._columns(sources[one.key] for one in inputs)

        def collect(evaluation: Evaluation) -> list[Array]:
            return derivative().collect(evaluation) + values_of(taps).collect(
                evaluation
            )

        self.assembly = Prepared(
            self.plan,
            [Quantity(RATES_AND_OUTPUTS, frozenset(), collect)],
            # Nothing is integrated, and a few evaluations do not pay for compilation.
            Solver(solver="RK45", backend="interpreted"),
        )
        self.programs = {p.name: p for p in self.assembly.programs}
        # One forward sweep for each direction needs less code and less time to build
        # than a Jacobian in expanded form.
        self.forward = cache(lambda name: self.programs[name].expanded.forward(1))
        self.written_out = cache(lambda name: self.programs[name].jacobian(1, 2))
        self.groups = cache(self._groups)
        self.instants: Pattern | None = pattern(self.assembly)
        self.output_rows = self.plan.x.size + _rows(taps)

    @cached_property
    def _unopened(self) -> Prepared:
        """The diagram in which operating points are completed.

        Without cuts and iterated loops it is the opened one: the injected signals are zero.
        """
        if self._cut or self.plan.guesses.size:
            return as_wired(self._wired)
        return self.assembly

    def complete(
        self, at: OperatingPoint | None, outputs: Mapping[str, Port]
    ) -> tuple[OperatingPoint, tuple[Vector, Vector, Vector]]:
        """Return a point with nothing left out, and its x, d and p.

        Parameters
        ----------
        at : OperatingPoint, optional
            Operating point; missing values are the initial ones.
        outputs : mapping
            Ports to keep in the point, by name.
        """
        for name in given_point(at).inputs:
            self._wired.source(name)
        point, values = completed(self._unopened, at, self._cut, outputs)
        x, d, p = point.vectors(self.plan)
        # Sources of cuts have the values of the closed diagram, so that the point is
        # the same with and without cuts. `hstack` needs at least one array.
        d[self._cut_columns - x.size] = np.hstack([np.zeros(0), *map(np.ravel, values)])
        return point, (x, d, p)

    def _groups(self, name: str) -> list[ColumnGroup]:
        """Return the groups of columns of the Jacobian of the quantity `name` by (x, d)."""
        function = self.programs[name].expanded
        parts = [function.jac_sparsity(0, argument) for argument in (1, 2)]
        return column_groups(ca.horzcat(*parts))

    def _columns(self, sources: Iterable[tuple[str, Indices]]) -> Indices:
        """Return where elements of the outputs of sources are in (x, d)."""
        parts = [
            self.plan.place(path, "y").start + elements for path, elements in sources
        ]
        return np.fromiter(chain.from_iterable(parts), np.int64)


class LocalJacobians:
    """Values and derivatives of what a plan computes at one time, in a run of its own.

    Use it in a ``with`` statement: Python blocks are open inside.

    Parameters
    ----------
    model : OpenedModel
        The opened diagram.
    t : float
        Time [s].
    p : Vector
        Parameters [units as declared].

    Attributes
    ----------
    derivatives : dict of str to str
        Method of differentiation of each Python block, keyed by path.
    """

    def __init__(self, model: OpenedModel, t: float, p: Vector) -> None:
        self.model, self.plan, self.t, self.p = model, model.plan, t, p
        self.continuous = model.assembly.python.continuous
        self.derivatives: dict[str, str] = {}
        self._errors: dict[str, float] = {}
        self.executor = model.assembly.open(p)

    def __enter__(self) -> LocalJacobians:
        return self

    def __exit__(self, *error: object) -> None:
        self.executor.close()

    def values(self, name: str, x: Vector, d: Vector) -> Vector:
        """Return the quantity of that `name` at `x`, `d` [as declared]; d is refreshed."""
        return self.executor.call(name, self.t, x, d, self.p)

    def matrix(self, name: str, x: Vector, d: Vector) -> Vector:
        """Return the derivatives of a quantity by (x, d), of shape (size, size of x and d).

        Parameters
        ----------
        name : str
            Quantity to differentiate.
        x, d : Vector
            The point [units as declared].
        """
        t, p, model = self.t, self.p, self.model
        active = next(q.active for q in model.assembly.quantities if q.name == name)
        # Derivatives hold at a solution of the algebraic loops; d may have guesses.
        d = self.plan.loops.put(t, x, d, p, active)
        number = x.size + d.size
        if not number:
            return np.zeros((model.programs[name].size, 0))
        groups = model.groups(name)
        many = len(groups)
        directions = np.zeros((number, many))
        for k, group in enumerate(groups):
            directions[group.columns, k] = 1.0
        # One direction for each group of elements of x and d, none for t and p.
        by_x, by_d = np.vsplit(directions, [x.size])
        seeds = np.zeros((1, many)), by_x, by_d, np.zeros((p.size, many))
        value = model.programs[name].expanded(t, x, d, p)
        slopes = model.forward(name).map(many)(t, x, d, p, value, *seeds).full()
        found = np.zeros((model.programs[name].size, number))
        for k, group in enumerate(groups):
            found[group.rows, group.places] = slopes[group.rows, k]
        bad = ~np.isfinite(found)
        if bad.any():
            # A sweep multiplies an infinite slope by a zero of the direction, which is
            # NaN. The expanded Jacobian is slow to build, but omits such products.
            found[bad] = model.written_out(name)(t, x, d, p).full()[bad]
        return np.asarray(found)

    def linear(self, x: Vector, d: Vector) -> tuple[Vector, Vector]:
        """Return the derivatives of dx/dt and of the outputs by (x, d).

        Parameters
        ----------
        x, d : Vector
            The point [units as declared].
        """
        # Before the traced rows: it updates outputs of continuous Python blocks in d.
        by_all = self.python_outputs(x, d)
        matrix = self.matrix(RATES_AND_OUTPUTS, x, d)
        for call, quantity in self.continuous:
            if call.size:
                _, matrix[call.states] = self.python(call, "derivative", quantity, x, d)
        matrix = self.substituted(matrix, by_all)
        return matrix[: x.size], matrix[self.model.output_rows]

    def python(
        self, call: BlockCall, kind: str, quantity: Quantity, x: Vector, d: Vector
    ) -> tuple[Vector, Vector]:
        """Return what an equation of a Python block returns, and its derivatives by (x, d).

        Parameters
        ----------
        call : BlockCall
            The block.
        kind : str
            The equation.
        quantity : Quantity
            The block's inputs.
        x, d : Vector
            The point [units as declared].
        """
        equations = self.executor.blocks.equations[call.path]
        u = self.values(quantity.name, x, d)
        p, modes = self.p[call.parameters], d[call.modes]
        needed = call.needed if kind == "output" else np.ones_like(call.needed)
        inputs = np.flatnonzero(needed)
        # As in a simulation, inputs without direct feedthrough are NaN for the outputs
        # of sampled blocks, which reveals undeclared dependence.
        others = u if call.block.continuous else np.full(u.size, np.nan)

        def split(z: Vector, others: Vector) -> tuple[Vector, Vector]:
            every = others.copy()
            every[inputs] = z[call.size :]
            return np.concatenate([z[: call.size], modes]), every

        def values(z: Vector) -> Vector:
            return call(equations, kind, self.t, *split(z, others), p)

        by_inputs = self.matrix(quantity.name, x, d)[inputs]
        # Places count in x for continuous blocks, and in d for sampled blocks.
        first = 0 if call.block.continuous else x.size
        states = np.arange(first + call.states.start, first + call.states.stop)
        z = np.concatenate([np.concatenate([x, d])[states], u[inputs]])
        at_z = values(z)
        own = offered(call.block, equations)
        if own is None or not z.size:
            slopes, error = differences(call.block, values, z)
            error = self._errors[call.path] = max(
                error, self._errors.get(call.path, 0.0)
            )
            self.derivatives[call.path] = f"differences, relative error {error:.1e}"
        else:
            slopes = np.zeros((at_z.size, z.size))
            here = np.float64(self.t), *call.signals(*split(z, others), p)
            for k, direction in enumerate(np.eye(z.size)):
                # Times zero: inputs that are hidden from the output stay NaN in the
                # direction, too.
                dx, du, _ = call.signals(*split(direction, 0.0 * others), p)
                with running_errors(call.block, "directional_derivative", self.t):
                    found = own(kind, *here, dx, du)
                    slopes[:, k] = call.flat(kind, found, z)
            self.derivatives[call.path] = "its own"
        # Chain rule: derivatives by (states, inputs) times those of these by (x, d).
        by_states = np.eye(x.size + d.size)[states]
        return at_z, slopes @ np.vstack([by_states, by_inputs])

    @property
    def python_places(self) -> Indices:
        """Indices of the outputs of continuous Python blocks in (x, d)."""
        first = self.plan.x.size
        parts = [first + np.r_[call.outputs] for call, _ in self.continuous]
        return np.fromiter(chain.from_iterable(parts), np.int64)

    def python_outputs(self, x: Vector, d: Vector) -> Vector:
        """Return the derivatives of the outputs of continuous Python blocks by all else in (x, d).

        Their columns for the outputs themselves are zero. The outputs in d become what the blocks return.

        Parameters
        ----------
        x, d : Vector
            The point [units as declared].
        """
        where = self.python_places
        rows = [np.zeros((0, x.size + d.size))]
        for call, quantity in self.continuous:
            rows.append(self.python(call, "output", quantity, x, d)[1])
        direct = np.vstack(rows)
        # The outputs are w = D_z z + D_w w. Without algebraic loops D_w is nilpotent,
        # so that 1 - D_w is invertible.
        by_all = np.asarray(
            np.linalg.solve(np.eye(where.size) - direct[:, where], direct), dtype=float
        )
        by_all[:, where] = 0.0
        return by_all

    def substituted(self, matrix: Vector, by_all: Vector) -> Vector:
        """Return derivatives by (x, d) through the outputs of continuous Python blocks.

        Parameters
        ----------
        matrix : Vector
            Derivatives, those by the outputs of these blocks apart [any].
        by_all : Vector
            Result of `python_outputs` [any].
        """
        where = self.python_places
        found = matrix + matrix[:, where] @ by_all
        found[:, where] = 0.0
        return np.asarray(found)

    def discrete_update(self, number: int, x: Vector, d: Vector) -> Jump:
        """Return the derivatives of (x, memory, held) after an instant, by before and by u.

        The chain rule, in the order of a run: at each stage `after` are the derivatives of (x, d) as
        it is then by (x, d) as it was before the instant, and a block that computes replaces its own rows.

        Parameters
        ----------
        number : int
            Number of the set of clocks.
        x, d : Vector
            States and discrete data, before the instant [units as declared].
        """
        plan = self.plan
        d = d.copy()
        where = self.python_places
        after = np.eye(x.size + d.size)
        sequence = self.model.assembly.python.ordered[number]
        for call, quantity in sequence:
            # Outputs are computed in sorted order: a block reads the outputs of earlier
            # blocks from d.
            if call.block.outputs():
                after[where] = self.python_outputs(x, d) @ after
                values, slopes = self.python(call, "output", quantity, x, d)
                after[x.size + call.outputs.start : x.size + call.outputs.stop] = (
                    slopes @ after
                )
                d[call.outputs] = values
        after[where] = self.python_outputs(x, d) @ after
        # Updates are simultaneous: all read the new outputs and the old states.
        staged = [
            (call.states, self.python(call, "update", quantity, x, d)[1] @ after)
            for call, quantity in sequence
            if call.size
        ]
        after[x.size :] = self.matrix(f"sample_{number}", x, d) @ after
        for states, rows in staged:
            after[x.size + states.start : x.size + states.stop] = rows
        inner = inner_places(plan)
        return after[np.ix_(inner, inner)], after[inner, x.size + plan.u_start :]


def inner_places(plan: Plan) -> Indices:
    """Return where (x, memory, held) of a `plan` are in (x, d): modes and events stay as they are."""
    size = plan.x.size
    sampled = plan.sampled
    return np.array(
        np.r_[:size, size + sampled.start : size + sampled.stop], dtype=np.int64
    )


def _put_in(system: System, one: Named, *, cut: bool) -> tuple[System, str, Indices]:
    """Return a system with a source at a signal, the path of the source, and the elements of its output.

    An input of the outermost block has its source already.
    """
    elements = one.port.elements().ravel()
    external = system.external.get(one.port.name)
    if external and one.port.block is system.root and one.port.is_input:
        return system, external.path, elements
    if not readers(system, one.port):
        raise LinearAnalysisError(
            f"nothing reads '{one.port.full_path}', so it cannot be an input or a cut"
        )
    source = External(one.port, f"into {one.port.full_path}", start=0.0)
    opened = injected(system, one.port, source, cut=cut)
    return opened, source.path, np.arange(elements.size)


def _refuse_overlaps(cuts: Sequence[Named], others: Sequence[Named]) -> None:
    """Refuse to cut a part of what is put in or read out, or more than that."""
    for cut in cuts:
        for other in others:
            if cut.key != other.key and cut.signals & other.signals:
                raise LinearAnalysisError(
                    f"'{cut.port.full_path}' is cut, but '{other.port.full_path}' is put in or "
                    "read out: name the same elements for both, such as 'block.port[0:3]'"
                )


def _rows(ports: Sequence[Port]) -> Indices:
    """Return which elements of the whole ports, one after the other, slices of them are."""
    places = zip(ports, spans(port.size for port in ports), strict=True)
    parts = [whole.start + port.elements().ravel() for port, whole in places]
    return np.fromiter(chain.from_iterable(parts), np.int64)

"""Linearize: exact Jacobians of a diagram between any ports, as a python-control system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.errors import LinearAnalysisError, NameLookupError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import Indices, flatten
from trussflow.blocks.linear_analysis.jacobians import LocalJacobians, inner_places
from trussflow.blocks.linear_analysis.lifting import Jump, lifted
from trussflow.blocks.linear_analysis.opened_model import OpenedModel
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import (
    Named,
    Reference,
    References,
    all_named,
    distinct_labels,
    label_of,
    layout_labels,
    named,
    split_index,
    state_places,
)
from trussflow.blocks.support.interrupts import interruptible
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import by_name, positive
from trussflow.blocks.tracing.plan import Plan

if TYPE_CHECKING:
    from trussflow.blocks.linear_analysis.linear_model import LinearModel

Amplitudes = Mapping[Any, float]
"""Amplitude of each signal or state, by `Reference`, whose describing function is wanted [unit of
it]."""


def linearize(
    item: Block,
    inputs: References = None,
    outputs: References = None,
    *,
    at: OperatingPoint | None = None,
    cut: References = (),
    amplitude: Amplitudes | None = None,
) -> LinearModel:
    r"""Return the linear model of a diagram or block around an operating point.

    .. math:: \dot x = A x + B u,\quad y = C x + D u

    with exact Jacobians from the graph. A diagram with sampled blocks becomes a discrete model
    at the common period of their clocks, its input held over the period, its output taken
    right after the first instant; the inter-sample motion is in it exactly.

    Parameters
    ----------
    item : Block
        A diagram, or a single block.
    inputs, outputs : Port, str or sequence of these, optional
        Input and output ports of any inner block, whole or sliced, as ports or
        as ``"block.port[0:3]"``. At a port that is driven, the input adds to the signal: at an
        input of a block for that block alone, at an output for all that read it, while the
        output itself is read without it. By default the ports that the diagram exposes, or
        those of the block.
    at : OperatingPoint, optional
        Operating point; by default the initial states with inputs at their start values.
    cut : Port, str or sequence of these
        Wires to cut. A cut signal among `inputs` is driven from there alone; any other is
        frozen at its value. An input of a block that is cut, among `outputs`, is what arrives.
    amplitude : mapping, optional
        Amplitude of states, inputs or wires into blocks: their columns are the describing
        functions for a sinusoid of that amplitude in one element at a time, instead of
        derivatives. For laws that have no derivative, such as :math:`|x|^{0.9}` at zero. In a
        loop amplitudes change with frequency: `frequency_response` finds them by itself.

    Returns
    -------
    LinearModel
        A ``control.StateSpace``. Elements are named ``block/port[i]``, or ``port[i]`` if the
        diagram exposes the port. Its `derivatives` says how those of Python blocks were found:
        by themselves, if they have a method ``directional_derivative`` (see
        `trussflow.blocks.linear_analysis.python_derivatives`), else by differences.

    Raises
    ------
    LinearAnalysisError
        If there is nothing to put in or read out, a derivative does not exist, or a describing
        function is asked of a diagram with sampled blocks.
    NameLookupError
        If there is no such block, port or state; the message lists those there are.

    Examples
    --------
    >>> from trussflow.blocks import Diagram, Gain, Integrator, linearize
    >>> loop = Diagram("loop")
    >>> integral, law = loop.add(integral=Integrator(), law=Gain(-2.0))
    >>> _ = integral >> law >> integral
    >>> model = linearize(loop, law.y, integral.y)
    >>> float(model.poles()[0].real)
    -2.0
    """
    return Linearizer(item, inputs, outputs, cut=cut).at(at, amplitude=amplitude)


class Linearizer:
    """A diagram made ready to be linearized, at any number of operating points.

    Other points, parameters and amplitudes need no new tracing. Arguments and errors are
    those of `linearize`.

    Parameters
    ----------
    item : Block
        A diagram, or a single block.
    inputs, outputs : Port, str or sequence of these, optional
        Input and output ports.
    cut : Port, str or sequence of these
        Wires to cut.
    """

    @interruptible()
    def __init__(
        self,
        item: Block,
        inputs: References = None,
        outputs: References = None,
        *,
        cut: References = (),
    ) -> None:
        self.item = item
        self._system = flatten(item, external=True)
        self._cuts = all_named(self._system, cut, [])
        self._inputs = all_named(self._system, inputs, item.inputs())
        self._outputs = all_named(self._system, outputs, item.outputs())
        cannot = f"cannot linearize '{item.name}'"
        self._input_labels = distinct_labels(cannot, "inputs", self._inputs)
        self._output_labels = distinct_labels(cannot, "outputs", self._outputs)
        self._models: dict[Any, OpenedModel] = {}
        self._plan = self._opened([]).plan

    def _opened(self, wires: list[Named]) -> OpenedModel:
        key = tuple(one.key for one in wires)
        if key not in self._models:
            self._models[key] = OpenedModel(
                self._system, self._inputs, self._outputs, self._cuts, wires
            )
        return self._models[key]

    def labels(self) -> tuple[list[str], list[str]]:
        """Return the names of all elements of the inputs and of the outputs."""
        return self._input_labels, self._output_labels

    def parameters(self) -> dict[str, Vector]:
        """Return the diagram's own parameters, by ``"block.parameter"``."""
        return self._plan.p.named(self._plan.parameters({}))

    def point(self, at: OperatingPoint | None = None) -> OperatingPoint:
        """Return an operating point in full: what it leaves out is as at the start.

        Parameters
        ----------
        at : OperatingPoint, optional
            The point; by default the initial states, inputs at their start values.
        """
        return self.opened(at)[1]

    @interruptible()
    def at(
        self, at: OperatingPoint | None = None, *, amplitude: Amplitudes | None = None
    ) -> LinearModel:
        """Return the linear model at an operating point.

        Parameters
        ----------
        at : OperatingPoint, optional
            Operating point.
        amplitude : mapping, optional
            Amplitudes of describing functions [unit of the state or signal].
        """
        amplitude = by_name("amplitudes", amplitude, str | Port)
        stored, wires = self._oscillating(amplitude)
        model, point, (x, d, p) = self.opened(at, [one for one, _ in wires])
        amplitudes: dict[int, float] = {}
        for reference, size in stored.items():
            places = self._places(model.plan, reference)
            assert places is not None
            amplitudes |= dict.fromkeys(places.tolist(), size)
        sizes = [size for one, size in wires for _ in one.labels()]
        amplitudes |= dict(zip(model.wire_columns.tolist(), sizes, strict=True))
        if amplitudes:
            model.refuse_harmonics(f"take describing functions of '{self.item.name}'")
        with model.at(point.time, p) as local:
            return self._model(model, local, point, (x, d), amplitudes)

    def opened(
        self, at: OperatingPoint | None = None, wires: Sequence[Named] = ()
    ) -> tuple[OpenedModel, OperatingPoint, tuple[Vector, Vector, Vector]]:
        """Return the diagram as it is opened, the point in full, and its x, d and p.

        Parameters
        ----------
        at : OperatingPoint, optional
            Operating point.
        wires : sequence of Named
            Wires that are closed by describing functions.
        """
        model = self._opened(list(wires))
        outputs = {one.label: one.leaf for one in self._outputs}
        return model, *model.complete(at, outputs)

    # -- describing functions -----------------------------------------------------------------

    def _oscillating(
        self, amplitude: Amplitudes
    ) -> tuple[dict[Reference, float], list[tuple[Named, float]]]:
        """Return the amplitudes of states and inputs from outside, and the wires that have amplitudes."""
        stored: dict[Reference, float] = {}
        wires = []
        for reference, size in amplitude.items():
            positive(LinearAnalysisError, **{f"amplitude of '{reference}'": size})
            if self._places(self._plan, reference) is not None:
                stored[reference] = size
                continue
            try:
                one = named(self._system, reference)
            except NameLookupError as error:
                states = ", ".join(f"{e.path}.{e.name}" for e in self._plan.x)
                raise NameLookupError(f"{error}; states: {states or 'none'}") from None
            if not one.port.is_input:
                raise LinearAnalysisError(
                    f"amplitude of '{one.port.full_path}': name a state, or the input of a block"
                )
            wires.append((one, size))
        return stored, wires

    def _places(self, plan: Plan, reference: Reference) -> Indices | None:
        """Return where a state or an input from outside is in (x, d); None if it is a wire."""
        external = self._system.external
        if isinstance(reference, str):
            name = split_index(reference)[0]
            outside = name in external
        else:
            outside = reference.block is self.item and reference.is_input
        if outside:
            port = named(self._system, reference).port
            start = plan.place(external[port.name].path, "y").start
            return np.asarray(start + port.elements().ravel())
        if not isinstance(reference, str) or name in self.item.ports:
            return None
        try:
            state_places(plan, [plan.x], name)
        except NameLookupError:
            return None
        return state_places(plan, [plan.x], reference)

    # -- models -------------------------------------------------------------------------------

    def _model(
        self,
        model: OpenedModel,
        local: LocalJacobians,
        point: OperatingPoint,
        vectors: tuple[Vector, Vector],
        amplitudes: dict[int, float],
    ) -> LinearModel:
        from trussflow.blocks.linear_analysis.linear_model import LinearModel

        x, d = vectors
        rates, rows = model.linear(local, x, d, amplitudes)
        columns, plan = model.input_columns, model.plan
        states = layout_labels(plan.x)
        inner = np.arange(x.size)
        dt = 0.0
        if model.instants is not None:
            states += layout_labels(plan.memory) + layout_labels(plan.held)
            inner = inner_places(plan)
        labels = [*states, *self._input_labels]
        flow = np.vstack([rates, np.zeros((inner.size - x.size, rates.shape[1]))])
        self._check_finite(np.vstack([flow, rows])[:, [*inner, *columns]], labels)
        A = flow[:, inner]
        B = flow[:, columns]
        C = rows[:, inner]
        D = rows[:, columns]
        if model.instants is not None:

            def jump(number: int) -> Jump:
                by_inner, by_u = local.discrete_update(number, x, d)
                found = by_inner, by_u[:, columns - x.size - plan.u_start]
                self._check_finite(np.hstack(found), labels)
                return found

            A, B, C, D = lifted(model.instants, (A, B), jump, (C, D))
            A, B, C, states = _without_dead_states(A, B, C, states)
            dt = float(model.instants.period)
        return LinearModel(
            A,
            B,
            C,
            D,
            dt,
            inputs=self._input_labels,
            outputs=self._output_labels,
            states=states,
            name=label_of(self.item.name).replace(" ", "_"),
            operating_point=point,
            derivatives=local.derivatives,
            input_units=[u for one in self._inputs for u in one.port.element_units()],
            output_units=[u for one in self._outputs for u in one.port.element_units()],
        )

    def _check_finite(self, matrix: Vector, labels: list[str]) -> None:
        """Refuse derivatives that do not exist, such as that of a root at zero."""
        names = [labels[j] for j in np.flatnonzero(~np.isfinite(matrix).all(axis=0))]
        if names:
            raise LinearAnalysisError(
                f"'{self.item.name}' has no finite derivative by {', '.join(names[:8])} at this "
                "point; give amplitude={...} for a describing function instead, or another point"
            )


def _without_dead_states(
    A: Vector, B: Vector, C: Vector, labels: list[str]
) -> tuple[Vector, Vector, Vector, list[str]]:
    """Drop states that nothing depends on, such as held outputs that are computed anew."""
    while True:
        alive = np.any(A != 0, axis=0) | np.any(C != 0, axis=0)
        if alive.all():
            return A, B, C, labels
        labels = [label for label, keep in zip(labels, alive, strict=True) if keep]
        A = A[np.ix_(alive, alive)]
        B = B[alive]
        C = C[:, alive]

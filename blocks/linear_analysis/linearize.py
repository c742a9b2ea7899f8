"""Linearize: exact Jacobians of a diagram between any ports, as a python-control system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.errors import LinearAnalysisError, NameLookupError
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.jacobians import LocalJacobians
from trussflow.blocks.linear_analysis.lifting import Jump, lifted
from trussflow.blocks.linear_analysis.linear_instants import linear_instant
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint, Surroundings
from trussflow.blocks.linear_analysis.references import (
    Named,
    Reference,
    label_of,
    layout_labels,
    named,
    split_index,
    state_elements,
)
from trussflow.blocks.linear_analysis.rewired_model import RewiredModel

if TYPE_CHECKING:
    from trussflow.blocks.linear_analysis.linear_model import LinearModel

References = Sequence[Reference] | Reference | None

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
        What is put in and read out: ports of any block within, whole or sliced, as ports or
        as ``"block.port[0:3]"``. At a port that is driven, the input adds to the signal: at an
        input of a block for that block alone, at an output for all that read it, while the
        output itself is read without it. By default the ports that the diagram exposes, or
        those of the block.
    at : OperatingPoint, optional
        Where; by default the initial states, inputs at their start values.
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
        What is put in and read out.
    cut : Port, str or sequence of these
        Wires to cut.
    """

    def __init__(
        self, item: Block, inputs: References = None, outputs: References = None, *, cut: References = ()
    ) -> None:
        self.item, self._system = item, flatten(item, external=True)
        self._surroundings = Surroundings(self._system)
        self._cuts = self._named(cut, [])
        self._inputs = self._named(inputs, item.inputs())
        self._outputs = self._named(outputs, item.outputs())
        for what, found in (("inputs", self._inputs), ("outputs", self._outputs)):
            labels = [label for one in found for label in one.labels()]
            twice = sorted({label for label in labels if labels.count(label) > 1})
            if not labels:
                raise LinearAnalysisError(
                    f"cannot linearize '{item.name}' without {what}: name ports with {what}=[...], "
                    "or expose some with diagram.expose(name=port)"
                )
            if twice:
                raise LinearAnalysisError(f"{what} name elements twice: {', '.join(twice)}")
        self._models: dict[Any, RewiredModel] = {}
        self._rewired([])

    def _named(self, given: References, default: Sequence[Reference]) -> list[Named]:
        references = default if given is None else given
        if isinstance(references, str) or not isinstance(references, Sequence):
            references = [references]
        return [named(self._system, r) for r in references]

    def _rewired(self, wires: list[Named]) -> RewiredModel:
        key = tuple(one.key for one in wires)
        if key not in self._models:
            self._models[key] = RewiredModel(self._system, self._inputs, self._outputs, self._cuts, wires)
        return self._models[key]

    def labels(self) -> tuple[list[str], list[str]]:
        """Return the names of all elements of the inputs and of the outputs."""
        inputs, outputs = (
            [label for one in found for label in one.labels()] for found in (self._inputs, self._outputs)
        )
        return inputs, outputs

    def point(self, at: OperatingPoint | None = None) -> OperatingPoint:
        """Return an operating point in full: what it leaves out is as at the start.

        Parameters
        ----------
        at : OperatingPoint, optional
            The point; by default the initial states, inputs at their start values.
        """
        outputs = {one.label: one.leaf for one in self._outputs}
        return self._surroundings.complete(at or OperatingPoint(), [], outputs)[0]

    def at(self, at: OperatingPoint | None = None, *, amplitude: Amplitudes | None = None) -> LinearModel:
        """Return the linear model at an operating point.

        Parameters
        ----------
        at : OperatingPoint, optional
            Where.
        amplitude : mapping, optional
            Amplitudes of describing functions [unit of the state or signal].
        """
        wires, sizes = self._wires(amplitude or {})
        model, point, (x, d, p) = self.rewired(at, wires)
        amplitudes = self._amplitudes(model, amplitude or {}, sizes)
        if amplitudes and model.instants is not None:
            raise LinearAnalysisError(
                f"cannot take describing functions of '{self.item.name}': it has sampled blocks; "
                "measure its response instead, with measured_response()"
            )
        if amplitudes and model.jacobians.assembly.continuous:
            raise LinearAnalysisError(
                f"cannot take describing functions of '{self.item.name}': it has continuous Python "
                "blocks; measure its response instead, with measured_response()"
            )
        with model.at(point.time, p) as local:
            rates, rows = model.linear(local, x, d, amplitudes)
            return self._model(model, local, point, (x, d), rates, rows)

    def rewired(
        self, at: OperatingPoint | None = None, wires: Sequence[Named] = ()
    ) -> tuple[RewiredModel, OperatingPoint, tuple[Vector, Vector, Vector]]:
        """Return the diagram as it is opened, the point in full, and its x, d and p.

        Parameters
        ----------
        at : OperatingPoint, optional
            Where.
        wires : sequence of Named
            Wires that are closed by describing functions.
        """
        model = self._rewired(list(wires))
        outputs = {one.label: one.leaf for one in self._outputs}
        replaced = [one.leaf for one in model.replaced]
        point, values = self._surroundings.complete(at or OperatingPoint(), replaced, outputs)
        return model, point, model.vectors(point, values)

    # -- describing functions -----------------------------------------------------------------

    def _wires(self, amplitude: Amplitudes) -> tuple[list[Named], list[float]]:
        """Return the wires within the diagram that have an amplitude, and the amplitudes."""
        wires, sizes = [], []
        for reference, size in amplitude.items():
            if not (np.isfinite(size) and size > 0):
                raise LinearAnalysisError(
                    f"amplitude of '{reference}' is {size}; it must be positive and finite"
                )
            if self._is_state(reference) or self._is_outside(reference):
                continue
            try:
                one = named(self._system, reference)
            except NameLookupError as error:
                states = ", ".join(f"{e.path}.{e.name}" for e in self._surroundings.plan.x)
                raise NameLookupError(f"{error}; states: {states or 'none'}") from None
            if not one.port.is_input:
                raise LinearAnalysisError(
                    f"amplitude of '{one.port.full_path}': name a state, or the input of a block"
                )
            wires.append(one)
            sizes.append(size)
        return wires, sizes

    def _is_state(self, reference: Reference) -> bool:
        if not isinstance(reference, str):
            return False
        name = split_index(reference)[0]
        if name in self.item.ports:
            return False
        try:
            state_elements([self._surroundings.plan.x], name)
        except NameLookupError:
            return False
        return True

    def _is_outside(self, reference: Reference) -> bool:
        if isinstance(reference, str):
            return split_index(reference)[0] in self._system.external
        return reference.block is self.item and reference.is_input

    def _amplitudes(self, model: RewiredModel, amplitude: Amplitudes, sizes: list[float]) -> dict[int, float]:
        """Return the amplitudes by column of (x, d)."""
        plan = model.plan
        found: dict[int, float] = {}
        for reference, size in amplitude.items():
            if isinstance(reference, str) and self._is_state(reference):
                _, entry, elements = state_elements([plan.x], reference)
                found |= {entry.start + int(e): size for e in elements}
            elif self._is_outside(reference):
                port = named(self._system, reference).port
                start = plan.place(self._system.external[port.name].path, "y").start
                found |= {start + int(e): size for e in port.elements().ravel()}
        columns, start = model.wire_columns, 0
        for one, size in zip(self._wires(amplitude)[0], sizes, strict=True):
            stop = start + one.port.elements().size
            found |= {int(c): size for c in columns[start:stop]}
            start = stop
        return found

    # -- models -------------------------------------------------------------------------------

    def _model(
        self,
        model: RewiredModel,
        local: LocalJacobians,
        point: OperatingPoint,
        vectors: tuple[Vector, Vector],
        rates: Vector,
        rows: Vector,
    ) -> LinearModel:
        from trussflow.blocks.linear_analysis.linear_model import LinearModel

        x, d = vectors
        columns, plan = model.input_columns, model.plan
        states, inputs = layout_labels(plan.x), self.labels()[0]
        if model.instants is None:
            used, dt = np.concatenate([np.arange(x.size), columns]), 0.0
            self._check_finite(np.vstack([rates, rows])[:, used], [*states, *inputs])
            A, B, C, D = rates[:, : x.size], rates[:, columns], rows[:, : x.size], rows[:, columns]
        else:
            inner = x.size + plan.u_start  # x, discrete states and held outputs; inputs follow
            states += layout_labels(plan.memory) + layout_labels(plan.held)
            used, labels = np.concatenate([np.arange(inner), columns]), [*states, *inputs]
            flow = np.vstack([rates, np.zeros((plan.u_start, rates.shape[1]))])
            self._check_finite(np.vstack([flow, rows])[:, used], labels)

            def jump(number: int) -> Jump:
                by_inner, by_u = linear_instant(local, number, x, d)
                found = by_inner, by_u[:, columns - inner]
                self._check_finite(np.hstack(found), labels)
                return found

            A, B, C, D = lifted(
                model.instants, (flow[:, :inner], flow[:, columns]), jump, (rows[:, :inner], rows[:, columns])
            )
            A, B, C, states = _without_dead_states(A, B, C, states)
            dt = float(model.instants.period)
        return LinearModel(
            A,
            B,
            C,
            D,
            dt,
            inputs=inputs,
            outputs=self.labels()[1],
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
        A, B, C = A[np.ix_(alive, alive)], B[alive], C[:, alive]

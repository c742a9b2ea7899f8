"""Linearize: exact Jacobians of a diagram between any ports, as a python-control system."""

from __future__ import annotations

from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.linear_analysis.lifting import Jump, lifted
from trussflow.blocks.linear_analysis.opened_model import (
    LocalJacobians,
    OpenedModel,
    inner_places,
)
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint
from trussflow.blocks.linear_analysis.references import (
    References,
    all_named,
    distinct_labels,
    label_of,
    layout_labels,
)
from trussflow.blocks.support.interrupts import interruptible
from trussflow.blocks.support.types import Vector

if TYPE_CHECKING:
    from trussflow.blocks.linear_analysis.linear_model import LinearModel


def linearize(
    item: Block,
    inputs: References = None,
    outputs: References = None,
    *,
    at: OperatingPoint | None = None,
    cut: References = (),
) -> LinearModel:
    r"""Return the linear model of a diagram or block around an operating point.

    .. math:: \dot x = A x + B u,\quad y = C x + D u

    with exact Jacobians from the graph. A diagram with sampled blocks becomes a discrete model
    at the common period of their clocks. Its input is held over the period, its output is taken
    right after the first instant, and the motion between samples is exact.

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
        Wires to cut. A cut signal among `inputs` is driven by this input only; any other is
        frozen at its value. A cut input of a block among `outputs` is the signal of the cut wire.

    Returns
    -------
    LinearModel
        A ``control.StateSpace``. Elements are named ``block/port[i]``, or ``port[i]`` if the
        diagram exposes the port. Its `derivatives` lists how Python blocks were differentiated:
        by their method ``directional_derivative`` (see
        `trussflow.blocks.linear_analysis.python_derivatives`), or else by differences.

    Raises
    ------
    LinearAnalysisError
        If there is no input or no output, or a derivative does not exist.
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
    return Linearizer(item, inputs, outputs, cut=cut).at(at)


class Linearizer:
    """A diagram prepared for linearization at any number of operating points.

    Other points and parameters need no new tracing. Arguments and errors are
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
        self._opened = OpenedModel(
            self._system, self._inputs, self._outputs, self._cuts
        )

    def labels(self) -> tuple[list[str], list[str]]:
        """Return the names of all elements of the inputs and of the outputs."""
        return self._input_labels, self._output_labels

    def parameters(self) -> dict[str, Vector]:
        """Return the diagram's own parameters, by ``"block.parameter"``."""
        plan = self._opened.plan
        return plan.p.named(plan.parameters({}))

    @interruptible()
    def at(self, at: OperatingPoint | None = None) -> LinearModel:
        """Return the linear model at an operating point.

        Parameters
        ----------
        at : OperatingPoint, optional
            Operating point; by default the initial states.
        """
        from trussflow.blocks.linear_analysis.linear_model import LinearModel

        model, point, (x, d, p) = self.opened(at)
        columns, plan = model.input_columns, model.plan
        states = layout_labels(plan.x)
        inner = np.arange(x.size)
        dt = 0.0
        if model.instants is not None:
            states += layout_labels(plan.memory) + layout_labels(plan.held)
            inner = inner_places(plan)
        labels = [*states, *self._input_labels]
        with LocalJacobians(model, point.time, p) as local:
            rates, rows = local.linear(x, d)
            # Discrete states and held outputs are constant between instants.
            flow = np.vstack([rates, np.zeros((inner.size - x.size, rates.shape[1]))])
            self._check_finite(np.vstack([flow, rows])[:, [*inner, *columns]], labels)
            A = flow[:, inner]
            B = flow[:, columns]
            C = rows[:, inner]
            D = rows[:, columns]
            if model.instants is not None:

                def jump(number: int) -> Jump:
                    by_inner, by_u = local.discrete_update(number, x, d)
                    # `columns` counts in (x, d), `by_u` from the first input on.
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
        )

    def opened(
        self, at: OperatingPoint | None = None
    ) -> tuple[OpenedModel, OperatingPoint, tuple[Vector, Vector, Vector]]:
        """Return the diagram as it is opened, the point in full, and its x, d and p.

        Parameters
        ----------
        at : OperatingPoint, optional
            Operating point; by default the initial states.
        """
        outputs = {one.label: one.leaf for one in self._outputs}
        return self._opened, *self._opened.complete(at, outputs)

    def _check_finite(self, matrix: Vector, labels: list[str]) -> None:
        """Raise `LinearAnalysisError` for derivatives that do not exist, such as that of a root at zero."""
        names = [labels[j] for j in np.flatnonzero(~np.isfinite(matrix).all(axis=0))]
        if names:
            raise LinearAnalysisError(
                f"'{self.item.name}' has no finite derivative by {', '.join(names[:8])} at this "
                "point; linearize at another point, or replace the block by one with the intended "
                "gain, such as a Gain of control.describing_function(f, amplitude)"
            )


def _without_dead_states(
    A: Vector, B: Vector, C: Vector, labels: list[str]
) -> tuple[Vector, Vector, Vector, list[str]]:
    """Remove states without effect, such as held outputs that are recomputed before they are read."""
    while True:
        # Column j contains all that depends on state j. Without this state, others may
        # lose their last reader, so that the search repeats.
        alive = np.any(A != 0, axis=0) | np.any(C != 0, axis=0)
        if alive.all():
            return A, B, C, labels
        labels = list(compress(labels, alive))
        A = A[np.ix_(alive, alive)]
        B = B[alive]
        C = C[:, alive]

"""A diagram opened for linear analysis: inputs put in, wires cut, signals tapped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, cached_property
from typing import Any

import numpy as np

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.external_inputs import External
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.signal_injection import injected, probed, readers
from trussflow.blocks.framework.system import Indices, System
from trussflow.blocks.linear_analysis.jacobians import (
    RATES_AND_OUTPUTS,
    LocalJacobians,
    Tangents,
    prepared,
)
from trussflow.blocks.linear_analysis.lifting import Pattern, pattern
from trussflow.blocks.linear_analysis.operating_point import (
    OperatingPoint,
    as_wired,
    completed,
    given_point,
)
from trussflow.blocks.linear_analysis.python_derivatives import refuse_hidden
from trussflow.blocks.linear_analysis.references import Named
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.plan import Plan


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
    plan : Plan
        The plan of the opened diagram.
    taps : list of Port
        The ports of the outputs, after opening.
    programs : dict of str to Program
        The traced quantities, keyed by name.
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
                probed(system, one.port) if one.key in cut else (system, one.leaf)
            )
            taps.append(tap)
        sources: dict[Any, str] = {}
        for one in [*inputs, *cuts]:
            if one.key not in sources:
                system, sources[one.key] = _put_in(system, one, cut=one.key in cut)
        self.plan = Plan(system)
        self.taps = taps
        self._cut = [one.leaf for one in cuts]
        self._cut_columns = self._columns([(one, sources[one.key]) for one in cuts])
        self.input_columns = self._columns([(one, sources[one.key]) for one in inputs])
        self._assembly = prepared(self.plan, taps)
        self.programs = {p.name: p for p in self._assembly.programs}
        self._tangents = cache(lambda name: Tangents(self.programs[name]))
        self.instants: Pattern | None = pattern(self._assembly)
        self.output_rows = self.plan.x.size + _rows(taps)

    @cached_property
    def _unopened(self) -> Prepared:
        """The diagram in which operating points are completed.

        Without cuts and iterated loops it is the opened one: the injected signals are zero.
        """
        if self._cut or self.plan.guesses.size:
            return as_wired(self._wired)
        return self._assembly

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
        d[self._cut_columns - x.size] = np.hstack([np.zeros(0), *map(np.ravel, values)])
        return point, (x, d, p)

    def _columns(self, found: list[tuple[Named, str]]) -> Indices:
        """Return where the elements of inputs are in (x, d)."""
        parts = [np.zeros(0, dtype=np.int64)]
        for one, path in found:
            place = self.plan.place(path, "y")
            elements = one.port.elements().ravel()
            if _outside(self.plan.system, one) is None:
                # a source of its own, for these elements
                elements = np.arange(elements.size)
            parts.append(place.start + elements)
        return np.concatenate(parts)

    def at(self, t: float, p: Vector) -> LocalJacobians:
        """Return values and derivatives at time `t` [s] with parameters `p` [as declared]."""
        return LocalJacobians(self._assembly, self._tangents, t, p)

    def linear(
        self, local: LocalJacobians, x: Vector, d: Vector
    ) -> tuple[Vector, Vector]:
        """Return the derivatives of dx/dt and of the outputs by (x, d).

        Parameters
        ----------
        local : LocalJacobians
            Result of `at`.
        x, d : Vector
            The point [units as declared].
        """
        # Before the traced rows: it brings the outputs of continuous Python blocks in d up to date.
        by_all = local.python_outputs(x, d)
        matrix = local.matrix(RATES_AND_OUTPUTS, x, d)
        for call, quantity in local.assembly.python.continuous:
            if call.size:
                matrix[call.states] = local.python(call, "derivative", quantity, x, d)[
                    1
                ]
        matrix = local.substituted(matrix, by_all)
        return matrix[: x.size], matrix[self.output_rows]


def _put_in(system: System, one: Named, *, cut: bool) -> tuple[System, str]:
    """Return a system with a source at a signal, and the path of the source."""
    if (external := _outside(system, one)) is not None:
        return system, external.path
    if not readers(system, one.port):
        raise LinearAnalysisError(
            f"nothing reads '{one.port.full_path}', so nothing can be put in or cut there"
        )
    source = External(one.port, f"into {one.port.full_path}", start=0.0)
    return injected(system, one.port, source, cut=cut), source.path


def _outside(system: System, one: Named) -> External | None:
    """Return what drives an input of the outermost block, which needs no other source."""
    at_root = one.port.block is system.root and one.port.is_input
    return system.external.get(one.port.name) if at_root else None


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
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])

"""Result of `trim`: element by element, with units and conditions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.declarations import State
from trussflow.blocks.framework.units import per_element
from trussflow.blocks.linear_analysis.references import Named
from trussflow.blocks.support.summary import Described, Description
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.plan import Plan

Bounds = tuple[Any, Any]
"""Quantity of the lower and the upper bound of each variable."""


@dataclass(frozen=True, slots=True)
class TrimLine:
    """One element of what `trim` found.

    Attributes
    ----------
    kind : str
        ``"state"``, ``"mode"``, ``"discrete state"``, ``"held output"``, ``"input"`` or ``"output"``.
    name : str
        Name for references, such as ``"plant.x[0]"``.
    value : float
        Its value [unit].
    unit : str
        The unit; empty without one.
    role : str
        ``"free"``, ``"free, at its lower bound"``, ``"free, at its upper bound"``, ``"fixed"`` or, of an
        output, ``"wanted"``; empty for an output that nothing was asked of.
    lower, upper : float
        Bounds of a free one [unit].
    rate : float
        Its rate of change if it is a continuous state [unit/s], else not a number.
    residual : float
        Residual of the condition of the element: rate, change at an instant or output, minus the required
        value [unit of the condition]; NaN without a condition.
    """

    kind: str
    name: str
    value: float
    unit: str
    role: str
    lower: float = -math.inf
    upper: float = math.inf
    rate: float = math.nan
    residual: float = math.nan

    def _text(self, tolerance: float) -> str:
        """Return the summary in one line."""
        unit = f" {self.unit}" if self.unit else ""
        parts = [f"{self.value:.6g}{unit}"]
        if self.role:
            bounded = math.isfinite(self.lower) or math.isfinite(self.upper)
            parts.append(
                self.role
                + f", within {self.lower:.6g} to {self.upper:.6g}{unit}" * bounded
            )
        if not math.isnan(self.rate):
            parts.append(f"rate {self.rate:.2g} {self.unit or '1'}/s")
        if not math.isnan(self.residual) and self.residual != self.rate:
            sampled = self.kind in ("discrete state", "held output")
            parts.append(
                f"{'changes at an instant by' if sampled else 'off by'} {self.residual:.2g}"
            )
        parts += ["VIOLATED"] if abs(self.residual) > tolerance else []
        return "; ".join(parts)


@dataclass(frozen=True, slots=True, repr=False)
class TrimReport(Described):
    """Result of `trim`; it prints as a table, as does ``pandas.DataFrame(report.lines)``.

    Attributes
    ----------
    name : str
        Name of the trimmed diagram.
    time : float
        At which time [s].
    tolerance : float
        Allowed violation of each condition [SI unit of it].
    residual : float
        Largest violation of a condition [SI unit of it].
    lines : tuple of TrimLine
        States, inputs and outputs.
    """

    name: str
    time: float
    tolerance: float
    residual: float
    lines: tuple[TrimLine, ...]

    @property
    def met(self) -> bool:
        """Whether all conditions are met."""
        return self.residual <= self.tolerance

    def _described(self) -> Description:
        outcome = "all conditions met" if self.met else "CONDITIONS VIOLATED"
        title = f"trim of {self.name} at {self.time:g} s: {outcome}, largest residual {self.residual:.2g}"
        return Description(
            title,
            {
                f"{line.kind} {line.name}": line._text(self.tolerance)
                for line in self.lines
            },
        )


def variable_lines(
    plan: Plan,
    labels: Sequence[str],
    values: Vector,
    free: NDArray[np.bool_],
    bounds: Bounds,
    at_bounds: Bounds,
    rates: Vector,
    residuals: Vector,
) -> Iterator[TrimLine]:
    """Return the line of each variable of `trim`; all arrays are in the order of (x, d).

    Parameters
    ----------
    plan : Plan
        The plan they are laid out by.
    labels : sequence of str
        Their names.
    values : Vector
        Their values [as declared].
    free : array of bool
        Whether each element is free.
    bounds, at_bounds : tuple
        Their bounds [as declared], and which are there.
    rates : Vector
        Rates of the continuous states [as declared].
    residuals : Vector
        Residual of the condition of each, not a number if it has none [as declared].
    """
    kinds = ("state", "mode", "discrete state", "held output", "input")
    for kind, layout in zip(kinds, (*plan.stored, plan.held, plan.u), strict=True):
        for e in layout:
            place = plan.place(e.path, e.name)
            block = plan.system.blocks[e.path]
            if kind == "held output" and block.sample_time is None:
                continue  # of a continuous Python block: it follows at once, and is no variable
            states = block.declared(State)
            unit = states[e.name].unit if e.name in states else block.port(e.name).unit
            units = per_element(unit, place.stop - place.start)
            for i, each in zip(range(place.start, place.stop), units, strict=True):
                role = "fixed"
                if free[i]:
                    role = "free" + ", at its lower bound" * bool(at_bounds[0][i])
                    role += ", at its upper bound" * bool(at_bounds[1][i])
                yield TrimLine(
                    kind=kind,
                    name=labels[i].replace("/", "."),
                    value=float(values[i]),
                    unit=each or "",
                    role=role,
                    lower=float(bounds[0][i]),
                    upper=float(bounds[1][i]),
                    rate=float(rates[i]) if i < plan.x.size else math.nan,
                    residual=float(residuals[i]),
                )


def output_lines(
    outputs: Iterable[Named], values: Mapping[str, Array], off: Mapping[str, float]
) -> Iterator[TrimLine]:
    """Return the line of each element of the `outputs` with these `values` [as declared].

    Those that are wanted are `off` by so much, by label [as declared].
    """
    for one in outputs:
        for label, value, unit in zip(
            one.labels(),
            np.ravel(values[one.label]),
            one.port.element_units(),
            strict=True,
        ):
            yield TrimLine(
                kind="output",
                name=label.replace("/", "."),
                value=float(value),
                unit=unit or "",
                role="wanted" if label in off else "",
                residual=float(off.get(label, math.nan)),
            )

"""Trim: states and inputs of an equilibrium, or of a motion with given rates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from trussflow.blocks.errors import LinearAnalysisError, TrimError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import State
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import Indices, flatten
from trussflow.blocks.framework.units import per_element
from trussflow.blocks.linear_analysis.opened_model import (
    RATES_AND_OUTPUTS,
    LocalJacobians,
    OpenedModel,
    inner_places,
)
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint, as_named
from trussflow.blocks.linear_analysis.python_derivatives import hiding
from trussflow.blocks.linear_analysis.references import (
    all_labels,
    all_named,
    label_places,
    plan_labels,
)
from trussflow.blocks.support.interrupts import interruptible
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import by_name, finite_array, positive

MOST_LISTED = 8
"""Equations or variables that a message names."""

KINDS = "state", "mode", "discrete state", "held output", "input"
"""Kinds of variables in the report, in the order of (x, d)."""

AT_BOUND = 1e-8
"""Distance from a bound within which a variable counts as at the bound, relative or, near zero,
absolute. The solver stays inside of the bounds by round-off."""


@dataclass(frozen=True, slots=True)
class Free:
    """A variable that `trim` may choose.

    Attributes
    ----------
    start : array_like, optional
        Initial guess; by default the value of the starting point [unit of the variable].
    lower, upper : array_like
        Bounds [unit of the variable].
    """

    start: npt.ArrayLike | None = None
    lower: npt.ArrayLike = -np.inf
    upper: npt.ArrayLike = np.inf


Conditions = Mapping[str, Any]
"""Values, or `Free`, by reference: ``"plant.x[0:3]"`` or the name of an input or output."""


@interruptible()
def trim(
    item: Block,
    *,
    states: Conditions | None = None,
    inputs: Conditions | None = None,
    outputs: Conditions | None = None,
    rates: Conditions | None = None,
    at: OperatingPoint | None = None,
    tolerance: float = 1e-9,
) -> OperatingPoint:
    r"""Find an operating point.

    Solves, for the free states and inputs,

    .. math:: \dot x = r, \quad y = y_{wanted}

    and, for sampled blocks, constant states and held outputs at all instants. The method is
    bounded nonlinear least squares with exact Jacobians. If there are many solutions, the result
    is one near the start. For strongly nonlinear equations, success may depend on the start.

    Parameters
    ----------
    item : Block
        A diagram, or a single block.
    states : mapping, optional
        Values of states that are fixed, or `Free` with bounds; all others are free.
    inputs : mapping, optional
        Values of inputs from outside, or `Free`; all others keep their starting value.
    outputs : mapping, optional
        Values wanted of outputs, of the item or of any block within.
    rates : mapping, optional
        Rates of change wanted of continuous states [unit of the state/s]; None leaves one
        alone. By default zero.
    at : OperatingPoint, optional
        Starting values of free variables, and values of all others, parameters and time; by default the
        initial states.
    tolerance : float
        Allowed violation of each equation [its SI unit].

    Returns
    -------
    OperatingPoint
        With its `residual`, and a `report`: a table with a row for each state, input and output.

    Raises
    ------
    TrimError
        If no point is found that meets all conditions; the message names the equations that are
        violated and the variables in them that are fixed or at a bound. `best` is the point with
        the least violation, with its `report`.
    LinearAnalysisError
        If a bound is invalid, or an equation is not finite during the iteration.
    ParameterError
        If a value or bound is no number, or has the wrong shape.
    NameLookupError
        If there is no such state, input or output; the message lists those there are.
    """
    positive(LinearAnalysisError, tolerance=tolerance)
    given = {"states": states, "inputs": inputs, "outputs": outputs, "rates": rates}
    states, inputs, outputs, rates = (
        by_name(what, each, str | Port) for what, each in given.items()
    )
    problem = _Problem(item, states, inputs, outputs, rates, at)
    return problem.solve(tolerance)


class _Problem:
    """Variables z = (x, discrete states, held outputs, inputs) and the equations on them."""

    def __init__(
        self,
        item: Block,
        states: Conditions,
        inputs: Conditions,
        outputs: Conditions,
        rates: Conditions,
        at: OperatingPoint | None,
    ) -> None:
        system = flatten(item, external=True)
        for block in hiding(system):
            raise LinearAnalysisError(
                f"cannot trim: Python block '{block.path}' ({type(block).__name__}) keeps "
                "something besides its declared states"
            )
        self._outputs = all_named(system, list(outputs), [])
        self._model = OpenedModel(system, [], self._outputs, [])
        plan = self._plan = self._model.plan
        self._point, (x, d, self._p) = self._model.complete(at, {})
        self._z = np.concatenate([x, d])
        size = self._z.size
        self._free = np.zeros(size, dtype=bool)
        self._free[inner_places(plan)] = True
        self._lower, self._upper = np.full(size, -np.inf), np.full(size, np.inf)
        self._labels = plan_labels(plan)
        stored = self._labels[: x.size + plan.memory.span.stop]
        for reference, value in states.items():
            where = label_places(stored, reference)
            self._set(where, f"state '{reference}'", value)
        first = x.size + plan.u_start
        for reference, value in inputs.items():
            where = first + label_places(self._labels[first:], reference)
            self._set(where, f"input '{reference}'", value)
        self._wanted_rates = np.zeros(x.size)
        for reference, value in rates.items():
            where = label_places(self._labels[: x.size], reference)
            self._wanted_rates[where] = (
                np.nan
                if value is None
                else finite_array(f"rate of '{reference}'", value, where.shape)
            )
        wanted = [
            finite_array(f"output '{r}'", v, one.port.elements().shape).ravel()
            for (r, v), one in zip(outputs.items(), self._outputs, strict=True)
        ]
        self._wanted = np.concatenate([np.zeros(0), *wanted])
        instants = (
            self._model.instants.instants if self._model.instants is not None else []
        )
        self._sets = sorted({number for _, number in instants if number})
        stays = self._labels[x.size :][plan.sampled]
        self._names = [
            *(f"d({label})/dt" for label in self._labels[: x.size]),
            *all_labels(self._outputs),
            *(
                f"change of {label} at an instant"
                for _ in self._sets
                for label in stays
            ),
        ]

    def _set(self, where: Indices, what: str, value: Any) -> None:
        """Fix variables at a value, or free them."""
        free = value if isinstance(value, Free) else None
        given = value if free is None else free.start
        if given is not None:
            self._z[where] = finite_array(what, given, where.shape)
        self._free[where] = free is not None
        if free is None:
            return
        lower, upper = (
            finite_array(f"bound of {what}", bound, where.shape, infinite=True)
            for bound in (free.lower, free.upper)
        )
        if not np.all(lower < upper):
            raise LinearAnalysisError(
                f"{what}: the lower bound must be below the upper one"
            )
        self._lower[where], self._upper[where] = lower, upper
        self._z[where] = np.clip(self._z[where], lower, upper)

    # -- the equations ------------------------------------------------------------------------

    def _residual(self, local: LocalJacobians, z: Vector) -> Vector:
        size = self._plan.x.size
        # A copy, as the evaluation writes outputs of continuous Python blocks into d.
        x, d = (z[:size], z[size:].copy())
        model = local.values(RATES_AND_OUTPUTS, x, d)
        wanted = self._wanted_rates
        # A rate of None is NaN in `wanted`: its equation is always met.
        parts = [np.where(np.isnan(wanted), 0.0, model[:size] - wanted)]
        outputs = model[self._model.output_rows]
        parts.append(outputs - self._wanted)
        for number in self._sets:
            # At rest, no instant changes discrete states and held outputs. An instant
            # writes into its argument, hence the copy.
            after = local.executor.instant(number, local.t, x, d.copy(), self._p)
            parts.append((after - d)[self._plan.sampled])
        return np.concatenate(parts)

    def _jacobian(self, local: LocalJacobians, z: Vector) -> Vector:
        plan = self._plan
        size = self._plan.x.size
        x, d = z[:size], z[size:]
        rates, outputs = local.linear(x, d.copy())
        rates = np.where(np.isnan(self._wanted_rates)[:, None], 0.0, rates)
        parts = [rates, outputs]
        for number in self._sets:
            by_inner, by_u = local.discrete_update(number, x, d)
            inner = inner_places(plan)
            change = np.zeros((inner.size - size, z.size))
            change[:, inner], change[:, size + plan.u_start :] = (
                by_inner[size:],
                by_u[size:],
            )
            # The equation is after - d = 0.
            change -= np.eye(z.size)[inner[size:]]
            # Outputs of continuous Python blocks are functions of the other variables,
            # so that they have no equation of their own.
            change[local.python_places - size - plan.sampled.start] = 0.0
            parts.append(change)
        return np.vstack(parts)

    # -- the solution -------------------------------------------------------------------------

    def solve(self, tolerance: float) -> OperatingPoint:
        """Return the point, or raise a TrimError that says what is violated."""
        from scipy.optimize import least_squares

        free = self._free

        def full(part: Vector) -> Vector:
            z = self._z.copy()
            z[free] = part
            return z

        def residual_of(part: Vector) -> Vector:
            residual = self._residual(local, full(part))
            self._check_finite(residual, "value")
            return residual

        def jacobian_of(part: Vector) -> Vector:
            jacobian = self._jacobian(local, full(part))[:, free]
            # The sum of a row is finite only if all of its elements are.
            self._check_finite(jacobian.sum(axis=1), "derivative")
            return jacobian

        best = self._z
        with LocalJacobians(self._model, self._point.time, self._p) as local:
            if free.any():
                found = least_squares(
                    residual_of,
                    best[free],
                    jac=jacobian_of,
                    bounds=(self._lower[free], self._upper[free]),
                    method="trf",
                    # The solver stops where it makes no progress, as `tolerance` is for
                    # residuals and is checked afterwards.
                    ftol=1e-15,
                    xtol=1e-15,
                    gtol=1e-15,
                    max_nfev=200,
                )
                best = full(found.x)
            residual = self._residual(local, best)
            complaint = ""
            # Not `>`, so that NaN is no solution.
            if not np.abs(residual).max(initial=0.0) <= tolerance:
                complaint = self._complaint(local, best, residual, tolerance)
            size = self._plan.x.size
            rates = local.values(RATES_AND_OUTPUTS, best[:size], best[size:].copy())
        # Only now, as some FMUs allow one instance in a process.
        point = self._as_point(best, residual, rates)
        if complaint:
            error = TrimError(complaint)
            error.best = point
            raise error
        return point

    def _check_finite(self, values: Vector, what: str) -> None:
        bad = [self._names[i] for i in np.flatnonzero(~np.isfinite(values))]
        if bad:
            raise LinearAnalysisError(
                f"cannot trim: {', '.join(bad[:MOST_LISTED])} has no finite {what} on the way; "
                "give a start or bounds that avoid this region"
            )

    def _as_point(self, z: Vector, residual: Vector, rates: Vector) -> OperatingPoint:
        """Return a point with its report: a table of the variables and of the outputs."""
        import pandas as pd  # takes a while to import

        plan = self._plan
        size = plan.x.size
        everything = all_named(plan.system, plan.system.root.outputs(), [])
        outputs = {one.label: one for one in [*everything, *self._outputs]}
        found: dict[str, Any] = as_named(plan, z[:size], z[size:])
        violation = float(np.abs(residual).max(initial=0.0))
        point, _ = self._model.complete(
            replace(self._point, residual=violation, **found),
            {label: one.leaf for label, one in outputs.items()},
        )
        rate, own = np.full((2, z.size), np.nan)
        rate[:size] = rates[:size]
        own[:size] = np.where(np.isnan(self._wanted_rates), np.nan, residual[:size])
        wanted = all_labels(self._outputs)
        if self._sets:  # of several sets of clocks, the worst
            changes = residual[size + len(wanted) :].reshape(len(self._sets), -1)
            worst = np.abs(changes).argmax(0)
            own[inner_places(plan)[size:]] = changes[worst, np.arange(worst.size)]
        kinds = np.full(z.size, "", dtype=object)
        units = kinds.copy()
        for kind, layout in zip(KINDS, (*plan.stored, plan.held, plan.u), strict=True):
            for e in layout:
                block = plan.system.blocks[e.path]
                if kind == "held output" and block.sample_time is None:
                    # Outputs of continuous Python blocks are no variables.
                    continue
                place = plan.place(e.path, e.name)
                declared = block.declared(State).get(e.name) or block.port(e.name)
                kinds[place] = kind
                units[place] = per_element(declared.unit, place.stop - place.start)
        variables = pd.DataFrame(
            {
                "kind": kinds,
                "value": z,
                "unit": units,
                "role": self._roles(z),
                "lower": self._lower,
                "upper": self._upper,
                "rate": rate,
                "residual": own,
            },
            self._labels,
        )
        off = dict(zip(wanted, residual[size:], strict=False))
        shown = all_labels(outputs.values())
        values = [np.ravel(point.outputs[label]) for label in outputs]
        results = pd.DataFrame(
            {
                "kind": "output",
                "value": np.concatenate([np.zeros(0), *values]),
                "unit": [
                    u for one in outputs.values() for u in one.port.element_units()
                ],
                "role": ["wanted" if label in off else "" for label in shown],
                "residual": [off.get(label, np.nan) for label in shown],
            },
            shown,
        )
        table = pd.concat([variables[kinds != ""], results]).fillna({"unit": ""})
        report = table.rename(lambda label: label.replace("/", "."))
        object.__setattr__(point, "report", report)
        return point

    def _roles(self, z: Vector) -> NDArray[np.object_]:
        """Return for each variable whether it is fixed, free, or free and at a bound."""
        roles = np.where(self._free, "free", "fixed").astype(object)
        for side, bound in (("lower", self._lower), ("upper", self._upper)):
            at_bound = np.isclose(z, bound, rtol=AT_BOUND, atol=AT_BOUND)
            roles[self._free & at_bound] += f", at its {side} bound"
        return roles

    def _complaint(
        self, local: LocalJacobians, z: Vector, residual: Vector, tolerance: float
    ) -> str:
        worst = np.argsort(-np.abs(residual))
        worst = worst[np.abs(residual[worst]) > tolerance]
        # Variables with a nonzero derivative in a violated equation.
        acting = np.abs(self._jacobian(local, z)[worst]).max(axis=0, initial=0.0) > 0
        fixed = [
            f"{label} = {z[i]:.4g} ({role})"
            for i, (label, role) in enumerate(
                zip(self._labels, self._roles(z), strict=True)
            )
            if acting[i] and role != "free"
        ]
        text = "found no operating point that meets all conditions:" + _listed(
            [f"{self._names[i]} is off by {residual[i]:.3g}" for i in worst]
        )
        if fixed:
            return (
                f"{text}\nfixed variables that act on them:{_listed(fixed)}\n"
                "free one of these, or remove a condition"
            )
        return text + (
            "\nno variable that acts on them is fixed or at a bound: remove a condition, or try another start"
        )


def _listed(lines: list[str]) -> str:
    """Return the first lines, indented, and the number of the others."""
    more = len(lines) - MOST_LISTED
    shown = lines[:MOST_LISTED] + [f"and {more} more"] * (more > 0)
    return "".join(f"\n  {line}" for line in shown)

"""Check of the exact derivatives of a block against differences."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.linear_analysis.python_derivatives import offered
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing import block_check
from trussflow.blocks.tracing.call_checks import running_errors
from trussflow.blocks.tracing.kernels import to_expression
from trussflow.blocks.tracing.program import lower

if TYPE_CHECKING:
    from trussflow.blocks.testing.check_block import Bench

DIFFERENCE_STEP = 1e-6
"""Step of differences, relative to numbers above one [-]."""

DERIVATIVE_TOLERANCE = 1e-4
"""Tolerance of derivatives, relative to the largest one of the same output or state, or to one [-]."""


def derivative_fault(bench: Bench) -> str:
    """Return the first derivative by states or inputs that differs from the differences; empty if none does.

    Differences count only where those of a step ten times as long agree, so not at kinks.

    Parameters
    ----------
    bench : Bench
        The block and its random points.
    """
    kinds = [kind for kind in bench.kinds if kind in ("output", "update", "derivative")]
    names = [
        f"{letter}.{n}"
        for letter, s in zip("xu", bench.shapes, strict=False)
        for n in s
    ]
    exact = _exact_jacobian(bench, kinds)
    for point in bench.points[: block_check.RANDOM_POINTS]:
        keys = [
            (key, v.size)
            for key, v in bench.values(bench.opened(), kinds, point).items()
        ]
        ends = np.cumsum([size for _, size in keys], dtype=int)
        columns = (
            (i, k) for i in range(1, 1 + len(names)) for k in range(point[i].size)
        )
        for (i, k), found in zip(columns, exact(point).T, strict=True):
            step = DIFFERENCE_STEP * max(1.0, abs(point[i].flat[k]))
            try:
                expected, wide = (
                    _difference(bench, kinds, point, (i, k), h)
                    for h in (step, 10.0 * step)
                )
            except SimulationError:  # at the edge of what it takes
                continue
            with np.errstate(all="ignore"):
                wrong = block_check.differing(
                    found, expected, ends, DERIVATIVE_TOLERANCE
                )
                wrong &= ~block_check.differing(
                    wide, expected, ends, DERIVATIVE_TOLERANCE
                )
                wrong &= np.isfinite(found + expected)
            if wrong.any():
                worst = int(np.argmax(wrong))
                kind, name = keys[int(np.searchsorted(ends, worst, side="right"))][0]
                return (
                    f"{kind}(): the derivative of '{name}' by {names[i - 1]} is {found[worst]:.6g}, by "
                    f"differences {expected[worst]:.6g}; look at directional_derivative(), or at rounding"
                )
    return ""


def _difference(
    bench: Bench, kinds: list[str], point: list[Array], place: tuple[int, int], h: float
) -> Vector:
    """Return the central difference of all values by an element of an array of a point, at a distance `h`."""
    i, k = place
    ends = []
    for change in (-h, h):
        moved = point[i].copy()
        moved.flat[k] += change
        values = bench.values(
            bench.opened(), kinds, [*point[:i], moved, *point[i + 1 :]]
        )
        ends.append(np.concatenate([np.zeros(0), *map(np.ravel, values.values())]))
    with np.errstate(all="ignore"):
        slope: Vector = (ends[1] - ends[0]) / (2.0 * h)
    return slope


def _exact_jacobian(bench: Bench, kinds: list[str]) -> Callable[[list[Array]], Array]:
    """Return the function of a point that is the exact Jacobian of equations of those `kinds`."""
    if not bench.block.traced:
        return partial(_offered_jacobian, bench, kinds)
    (t, x, u, fired, p), values, trace = block_check.trace_alone(bench.block)
    leaves = [
        to_expression(v)
        for v in (t, *x.values(), *u.values(), *fired.values(), *p.values())
    ]
    results = [to_expression(v) for kind in kinds for v in values[kind].values()]
    program = lower("slopes", leaves, ca.vertcat(ca.SX(0, 1), *results), trace)
    jacobian = program.jacobian(*range(1, 1 + len(x) + len(u)))
    return lambda point: np.asarray(
        jacobian(abs(point[0]), *map(np.ravel, [*point[1:], *bench.p.values()]))
    )


def _offered_jacobian(bench: Bench, kinds: list[str], point: list[Array]) -> Array:
    """Return the Jacobian at a point by the directional derivatives of the block itself."""
    own = offered(bench.block, bench.opened())
    assert own is not None
    t, x, u, p, _ = bench.arguments(point)
    keys = [*bench.values(bench.opened(), kinds, point)]
    columns = []
    for i in range(1, 1 + len(x) + len(u)):
        for k in range(point[i].size):
            along = [np.zeros_like(v) for v in point]
            along[i].flat[k] = 1.0
            with running_errors(bench.block, "directional_derivative", float(t)):
                values = {
                    kind: own(kind, t, x, u, p, *bench.arguments(along)[1:3])
                    for kind in kinds
                }
                parts = [
                    np.asarray(values[kind][name], dtype=float).ravel()
                    for kind, name in keys
                ]
            columns.append(np.concatenate([np.zeros(0), *parts]))
    return np.array(columns).T

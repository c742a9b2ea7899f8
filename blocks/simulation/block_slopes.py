"""The derivatives of a block on the bench: exact ones, against differences of its numbers."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import casadi as ca
import numpy as np

from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.simulation.block_bench import Bench, FaultError, NotApplicableError, near
from trussflow.blocks.tracing import block_check
from trussflow.blocks.tracing.calling import running_errors
from trussflow.blocks.tracing.kernels import to_expression
from trussflow.blocks.tracing.program import lower

DIFFERENCE_STEP = 1e-6
"""Step of differences, relative to numbers above one [-]."""

SLOPE_TOLERANCE = 1e-4
"""Tolerance of derivatives against differences, relative to the largest derivative [-].

That is of each output or state by itself: a large one must not hide the others.
"""

Places = list[tuple[int, int]]
"""Variable of the derivative: number of an array of a point, and of an element in it."""


def derivatives(bench: Bench) -> str:
    """See whether exact derivatives by states and inputs are those of the numbers."""
    block, own = bench.block, bench.opened()
    kinds = [kind for kind in bench.kinds if kind in ("output", "update", "derivative")]
    names = [f"{letter}.{n}" for letter, s in zip("xu", bench.shapes, strict=False) for n in s]
    places = [(i, k) for i in range(1, 1 + len(names)) for k in range(bench.points[0][i].size)]
    offered = getattr(own, "directional_derivative", None) or getattr(block, "directional_derivative", None)
    exact: Callable[[list[Array]], Array]
    if block.traced:
        exact = _traced(bench, kinds)
    elif offered is not None:
        exact = partial(_offered, bench, offered, kinds, places)
    else:
        raise NotApplicableError(
            "linear models take differences, or directional_derivative() of a Python block"
        )
    for point in bench.points[: block_check.RANDOM_POINTS]:
        values = bench.values(bench.opened(), kinds, point)
        ends = np.cumsum([v.size for v in values.values()], dtype=int)[:-1]
        for (i, k), slopes in zip(places, exact(point).T, strict=True):
            step = DIFFERENCE_STEP * max(1.0, abs(point[i].flat[k]))
            try:
                a, b, c, d = (_moved(bench, kinds, point, i, k, n * step) for n in (-10.0, -1.0, 1.0, 10.0))
            except SimulationError:  # at the edge of what it takes
                continue
            with np.errstate(all="ignore"):
                found, wide = (c - b) / (2.0 * step), (d - a) / (20.0 * step)
                parts = zip(*(np.split(v, ends) for v in (found, wide, slopes)), strict=True)
                wrong = np.concatenate(
                    [near(w, f, SLOPE_TOLERANCE) & ~near(s, f, SLOPE_TOLERANCE) for f, w, s in parts]
                )
                wrong &= np.isfinite(slopes + found)
            if wrong.any():
                worst = int(np.argmax(wrong))
                kind, name = [key for key, v in values.items() for _ in range(v.size)][worst]
                raise FaultError(
                    f"{kind}(): the derivative of '{name}' by {names[i - 1]} is {slopes[worst]:.6g}, by "
                    f"differences {found[worst]:.6g}; look at directional_derivative(), or at rounding"
                )
    return ""


def _moved(bench: Bench, kinds: list[str], point: list[Array], i: int, k: int, h: float) -> Vector:
    """Return all values where element k of array i of a point is moved by `h`."""
    there = point[i].copy()
    there.flat[k] += h
    values = bench.values(bench.opened(), kinds, [*point[:i], there, *point[i + 1 :]])
    return np.concatenate([np.zeros(0), *map(np.ravel, values.values())])


def _traced(bench: Bench, kinds: list[str]) -> Callable[[list[Array]], Array]:
    """Return the function of a point that is the exact Jacobian of the traced equations."""
    (t, x, u, fired, p), values, trace = block_check.trace_alone(bench.block)
    leaves = [to_expression(v) for v in (t, *x.values(), *u.values(), *fired.values(), *p.values())]
    results = [to_expression(v) for kind in kinds for v in values[kind].values()]
    program = lower("slopes", leaves, ca.vertcat(ca.SX(0, 1), *results), trace)
    jacobian = program.jacobian(*range(1, 1 + len(x) + len(u)))
    return lambda point: np.asarray(jacobian(abs(point[0]), *map(np.ravel, [*point[1:], *bench.p.values()])))


def _offered(
    bench: Bench,
    offered: Callable[..., dict[str, Array]],
    kinds: list[str],
    places: Places,
    point: list[Array],
) -> Array:
    """Return the Jacobian that the block offers."""
    t, x, u, p, _ = bench.arguments(point)
    keys, columns = [*bench.values(bench.opened(), kinds, point)], []
    for i, k in places:
        along = [np.zeros_like(v) for v in point]
        along[i].flat[k] = 1.0
        with running_errors(bench.block, "directional_derivative", float(t)):
            values = {kind: offered(kind, t, x, u, p, *bench.arguments(along)[1:3]) for kind in kinds}
            parts = [np.asarray(values[kind][name], dtype=float).ravel() for kind, name in keys]
        columns.append(np.concatenate([np.zeros(0), *parts]))
    return np.array(columns).T

r"""Bounded weighted least squares, in NumPy and for traced arrays.

.. math:: \min_{l \le q \le h} \; (B q - f)^T C^{-1} (B q - f) + \sum_k w_k^2 (q_k - p_k)^2

The dual problem has one unknown per row and no limits. With :math:`A = B W^{-1}`, the solution q for
the multipliers y is :math:`q(y) = \mathrm{clip}(p + W^{-1} A^T y, l, h)`, and y solves

.. math:: F(y) = C y + A W q(y) - f = 0,

the gradient of a convex, once differentiable, piecewise quadratic function. Newton's method uses
:math:`C + A_F A_F^T` as its derivative, where F is the set of unknowns strictly within their limits.
It starts with all unknowns in F. An exact line search ends each step at the smallest value along it.
Each step decreases the function, and a full step in the piece with the minimum reaches the minimum.
Hence no full step starts twice from the same F, and the number of steps is finite. Active limits
cannot make :math:`C + A_F A_F^T` singular, even if many are active or equal.

References
----------
Li, Swetits (1997), *A new algorithm for solving strictly convex quadratic programs*, SIAM Journal on
Optimization 7 (3), for Newton's method on the piecewise quadratic dual.
Nocedal, Wright (2006), *Numerical Optimization*, 2nd ed., ch. 16, for the conditions of optimality.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.c_function import NumPyFunction, c_kernel
from trussflow.blocks.tracing.kernels import (
    Kernel,
    call_kernel,
    from_expression,
    is_traced,
    shape_of,
    to_expression,
)
from trussflow.blocks.tracing.linear_algebra import block_diagonal
from trussflow.blocks.tracing.operations import c_file

MAX_STEPS = 100
"""Largest number of Newton steps [-], as in bounded_least_squares.h; the last iterate is then returned."""

MAX_DIRECT_COST_RATIO = 1e3
"""Largest cost of the error, relative to that of the unknowns [-], at which the first step is accepted."""


def bounded_least_squares(
    matrix: Array,
    spread: Array,
    target: Array,
    weights: Array,
    preferred: Array,
    lower: Array,
    upper: Array,
) -> tuple[Array, Array]:
    """Return the bounded weighted least-squares solution q and its residual f - B q.

    Both are NaN if a weight or a diagonal element of C is not positive, a lower limit exceeds its upper
    limit, or an argument contains NaN.

    Parameters
    ----------
    matrix : array, shape (m, n)
        B [any].
    spread : array, shape (m, m)
        C [any], symmetric; its inverse weights the residual.
    target : array, shape (m,)
        f [any].
    weights, preferred, lower, upper : array, shape (n,)
        w, p, l, h [any]; limits may be infinite.
    """
    m, n = shape_of(matrix)
    rows, columns = -m % 4, -n % 4  # padding: the C code uses vectors of four numbers
    padded = [
        block_diagonal(matrix, np.zeros((rows, columns))),
        block_diagonal(spread, np.eye(rows)),
        np.concatenate([target, np.zeros(rows)]),
        np.concatenate([weights, np.ones(columns)]),
        *(
            np.concatenate([each, np.zeros(columns)])
            for each in (preferred, lower, upper)
        ),
    ]
    flat = np.concatenate([np.reshape(each, (-1,)) for each in padded])
    if is_traced(flat):
        call = call_kernel(_kernel(m + rows, n + columns), to_expression(flat))
        found = from_expression(call.symbols, (call.symbols.numel(),))
    else:
        found = _value(m + rows, n + columns, np.asarray(flat, dtype=float))
    return found[:n], found[n + columns : n + columns + m]


@cache  # keeps the callbacks alive, as CasADi does not
def _kernel(m: int, n: int) -> Kernel:
    header = c_file("bounded_least_squares.h", __package__)
    return c_kernel(
        _Solution(m, n), header, f"tf_bounded_least_squares({m}, {n}, in, out);"
    )


def _parts(m: int, n: int, values: Vector) -> list[Vector]:
    """Split `values`, one column or several, into B, C, f, w, p, l and h."""
    ends = np.cumsum([m * n, m * m, m, n, n, n])
    b, c, *others = np.split(values, ends)
    several = values.shape[1:]
    return [b.reshape(m, n, *several), c.reshape(m, m, *several), *others]


@np.errstate(all="ignore")
def _value(m: int, n: int, values: Vector) -> Vector:
    """Return q, f - B q and y; the same algorithm as in bounded_least_squares.h."""
    b, c, f, w, preferred, lower, upper = _parts(m, n, values)
    a = b / w
    y, drift, was = np.zeros(m), np.zeros(n), np.zeros(0, dtype=bool)
    z, free = preferred, lower < upper
    q = np.where(free, z, lower)
    ended = False
    good = bool((w > 0).all() and (lower <= upper).all() and (np.diag(c) > 0).all())
    for rounds in range(MAX_STEPS):
        if ended or not good:
            break
        gradient = f - c @ y - a @ (w * (q - drift))
        known, was = np.array_equal(free, was), free
        try:
            factor = np.linalg.cholesky(c + a[:, free] @ a[:, free].T)
        except np.linalg.LinAlgError:
            good = False
            break
        step = np.linalg.solve(factor.T, np.linalg.solve(factor, gradient))
        along, slope = step @ gradient, step @ a / w - drift
        good = bool(np.isfinite(along))
        after, kept = np.where(free, z + slope, q), np.clip(z + slope, lower, upper)
        # If a full step leaves F unchanged up to round-off, it ends in the minimum of this piece.
        same = bool(
            np.all(np.abs(after - kept) <= 1e-13 * (np.abs(after) + np.abs(kept)))
        )
        gain = (w * slope) ** 2
        # The first step is exact for F = all unknowns, but rounded if the error dominates the cost.
        small = rounds == 0 and along <= MAX_DIRECT_COST_RATIO * np.sum(gain[free])
        ended = same and (known or bool(small))
        t = 1.0
        if rounds and not same:
            t = _lowest(
                -float(along), float(step @ c @ step), gain, z, slope, lower, upper
            )
        y = y + t * step
        of_y = preferred + y @ a / w
        z = np.where(free, z + t * slope, of_y)
        q, free = np.clip(z, lower, upper), (z > lower) & (z < upper)
        # Round-off of q(y), which the next residual compensates: y may be much larger than W (q - p).
        drift = np.where(free, z - of_y, 0.0)
    error = f - a @ (w * q)
    result = np.concatenate([q, error, y])
    return result if good else np.full_like(result, np.nan)


def _lowest(
    rate: float,
    curve: float,
    gain: Vector,
    z: Vector,
    slope: Vector,
    lower: Vector,
    upper: Vector,
) -> float:
    """Return the step length that minimizes the dual function along a direction (exact line search).

    The slope of the function is `rate` at 0. It rises at the rate `curve`, plus the `gain` of each unknown
    while that unknown is between its limits.
    """
    enter, leave = np.sort([(lower - z) / slope, (upper - z) / slope], axis=0)
    t = 0.0
    while True:
        events = np.concatenate([enter, leave])
        rise = curve + np.sum(gain[(enter <= t) & (t < leave)])
        following, to = np.min(events[events > t], initial=np.inf), t - rate / rise
        if not to > following:
            return float(to)
        rate, t = rise * (following - to), following


def _slope(
    m: int, n: int, values: Vector, results: Vector, directions: Vector
) -> Vector:
    """Return the derivatives along directions, for an unchanged set of unknowns at their limits."""
    b, c, _, w, _, lower, upper = _parts(m, n, values)
    db, dc, df, dw, dp, dl, dh = _parts(m, n, directions)
    q, y = results[:n], results[n + m : n + 2 * m]
    free = (lower < q) & (q < upper)
    if not np.isfinite(q).all():
        return np.full((results.size, directions.shape[1]), np.nan)
    a = b / w
    own = w[:, None] ** 2  # second derivative of the cost by q
    moved = dp + (np.einsum("mkd,m->kd", db, y) - 2.0 * (y @ a)[:, None] * dw) / own
    moved = np.where(free[:, None], moved, np.where((q <= lower)[:, None], dl, dh))
    known = np.einsum("mkd,k->md", db, q)
    right = df - np.einsum("ijd,j->id", dc, y) - known - b @ moved
    dy = np.linalg.solve(c + a[:, free] @ a[:, free].T, right)
    dq = moved + np.where(free[:, None], a.T @ dy / w[:, None], 0.0)
    return np.vstack([dq, df - known - b @ dq, dy])


class _Solution(NumPyFunction):
    """Callback of CasADi for q, f - B q and y, with derivatives."""

    def __init__(self, m: int, n: int) -> None:
        super().__init__("bounded_least_squares", m * n + m * m + m + 4 * n, n + 2 * m)
        self._sizes = m, n
        self._slopes = cache(partial(_Slopes, m, n, *self._shape))

    def value(self, argument: Vector) -> Vector:
        return _value(*self._sizes, argument)

    def uses_output(self) -> bool:
        return True

    def has_forward(self, _: int) -> bool:
        return True

    def get_forward(self, count: int, *_: Any) -> ca.Function:
        return self._slopes(count)


class _Slopes(ca.Callback):
    """Callback of CasADi for the derivatives along a number of directions."""

    def __init__(
        self, m: int, n: int, arguments: int, results: int, count: int
    ) -> None:
        super().__init__()
        self._sizes = m, n
        self._shapes = (arguments, 1), (results, 1), (arguments, count)
        # CasADi caches derivatives by name, so the name must contain the number of directions.
        self.construct(f"bounded_least_squares_slope_{count}", {})

    def get_n_in(self) -> int:
        return 3

    def get_sparsity_in(self, number: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._shapes[number])

    def get_sparsity_out(self, _: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._shapes[1][0], self._shapes[2][1])

    def eval(self, values: Sequence[ca.DM]) -> list[Any]:
        argument, results, directions = (v.full() for v in values)
        return [_slope(*self._sizes, argument.ravel(), results.ravel(), directions)]

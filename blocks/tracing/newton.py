r"""Solution of algebraic loops, by an expression or by Newton's method.

.. math:: r(z, s) = f(z, s) - z = 0

If f is linear in z and has few unknowns, the solution is an expression. Otherwise it is a kernel, which
iterates by Newton's method with the exact derivative of r:

.. math:: z \leftarrow z - a\, d, \qquad d = \left(\frac{\partial r}{\partial z}\right)^{-1} r

with the largest a of 1, 1/2, 1/4, ... that decreases the norm of r, with each element scaled by its terms
and d. Expressions that do not depend on z are computed once. The iteration ends if a step changes z by less
than 1e-12 of it, or if no step decreases r because of round-off. The solution is NaN if d is then not small
relative to z, the step before, or the round-off of the terms of r.

The derivative of a solution is that of the last Newton step (implicit function theorem). For derivatives,
the kernel is therefore replaced by one Newton step from an initial guess that is the solution already.

References
----------
Nocedal, Wright (2006), *Numerical Optimization*, 2nd ed., ch. 11. Christianson (1994), *Reverse
accumulation and attractive fixed points*, for the derivative by the last step.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache, partial

import casadi as ca
import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.c_function import NumPyFunction, c_kernel
from trussflow.blocks.tracing.codegen import straight_line
from trussflow.blocks.tracing.instructions import instructions_of
from trussflow.blocks.tracing.kernels import (
    KERNEL_NAME,
    Kernel,
    KernelCall,
    call_kernel,
    symbols_of,
)
from trussflow.blocks.tracing.operations import c_file

MAX_STEPS = 60
"""Largest number of Newton steps [-], as in newton.h."""

PIVOT_TOLERANCE = 4e-15
"""Largest pivot, relative to its terms times the number of unknowns, that counts as round-off [-]."""

MAX_ITERATED_UNKNOWNS = 128
"""Largest number of unknowns of an iteration [-]; the C code has its matrices on the stack."""

MAX_DIRECT_UNKNOWNS = 8
"""Largest number of unknowns solved by an expression [-], whose size grows with the cube of this number."""

DISCONTINUOUS_OPERATIONS = {
    getattr(ca, f"OP_{name}")
    for name in (
        "LT",
        "LE",
        "EQ",
        "NE",
        "SIGN",
        "FLOOR",
        "CEIL",
        "FMOD",
        "REMAINDER",
        "COPYSIGN",
    )
}
"""Operations whose results may be discontinuous."""


def solve(residual: ca.SX, unknown: ca.SX, start: ca.SX) -> tuple[ca.SX, bool]:
    """Return the values of unknowns at which a residual is zero, and whether this needs an iteration.

    The values are NaN if there is no solution or it is not unique.

    Parameters
    ----------
    residual, unknown : casadi.SX
        r = f(z) - z, and its symbols z [any].
    start : casadi.SX
        Initial guess of an iteration [unit of z].
    """
    n, own = unknown.numel(), symbols_of(unknown)
    slope = ca.densify(ca.jacobian(residual, unknown))
    both = ca.vertcat(residual, ca.vec(slope.T))
    # Expressions of other symbols only are constant in the iteration; they are computed
    # once, before it, and are inputs of the kernel.
    others = ca.vertcat(*(s for s in ca.symvar(both) if s.element_hash() not in own))
    apart, symbols, hoisted = ca.extract_parametric(
        both, others, {"extract_trivial": True}
    )
    outputs = [apart[:n], apart[n:]]
    equations = ca.Function(
        "loop", [unknown, ca.vertcat(ca.SX(0, 1), *symbols)], outputs, {"cse": True}
    )
    # Comparisons left in the equations depend on z, so f may be discontinuous despite a constant Jacobian.
    jumps = any(
        each.operation in DISCONTINUOUS_OPERATIONS
        for each in instructions_of(equations)
    )
    # A constant Jacobian: r(z) = r(0) + J z is zero at z = -J^-1 r(0).
    if n <= MAX_DIRECT_UNKNOWNS and not jumps and not symbols_of(slope) & own:
        return -ca.substitute(_step(residual, slope), unknown, ca.SX.zeros(n)), False
    return call_kernel(_kernel(equations), ca.vertcat(start, *hoisted)).symbols, True


def _step(residual: ca.SX, slope: ca.SX) -> ca.SX:
    """Return the step d, NaN if the Jacobian is singular up to round-off: `_eliminated` as an expression."""
    n = residual.numel()
    if ca.sprank(ca.sparsify(slope)) < n:
        return ca.SX([np.nan] * n)
    # J = df/dz - 1: on the diagonal the terms are |df/dz| and 1, elsewhere |df/dz|.
    terms = ca.fabs(slope) + ca.diag(
        1.0 + ca.fabs(ca.diag(slope) + 1.0) - ca.fabs(ca.diag(slope))
    )
    columns = [ca.mmax(terms[:, j]) for j in range(n)]
    weights = [1.0 / ca.mmax(terms[i, :] / ca.horzcat(*columns)) for i in range(n)]
    # Columns of each row: the Jacobian up to n, residual at n, weight at n + 1, terms
    # from n + 2 on.
    rows = [
        ca.horzcat(slope[i, :], residual[i], weights[i], terms[i, :]) for i in range(n)
    ]
    sound = ca.SX(1)
    for k in range(n):
        for i in range(k + 1, n):
            if rows[i][k].is_zero():
                continue
            # Row exchange without a branch, as expressions have none.
            better = (
                ca.fabs(rows[i][k]) * rows[i][n + 1]
                > ca.fabs(rows[k][k]) * rows[k][n + 1]
            )
            rows[k], rows[i] = (
                ca.if_else(better, rows[i], rows[k]),
                ca.if_else(better, rows[k], rows[i]),
            )
        sound = ca.logic_and(
            sound, ca.fabs(rows[k][k]) > PIVOT_TOLERANCE * n * rows[k][n + 2 + k]
        )
        for i in range(k + 1, n):
            if not rows[i][k].is_zero():
                taken = rows[i][k] / rows[k][k] * rows[k][k : n + 1]
                rows[i][k : n + 1] -= taken
                rows[i][n + 2 + k :] += ca.fabs(taken[:-1])
    step = ca.SX.zeros(n)
    for k in reversed(range(n)):
        step[k] = (
            rows[k][n] - sum(rows[k][j] * step[j] for j in range(k + 1, n))
        ) / rows[k][k]
    return ca.if_else(sound, step, np.nan)


def _terms(slope: Vector) -> Vector:
    """Return the sum of the magnitudes of the terms of each element of a Jacobian: that of f, and -1."""
    return np.where(
        np.eye(len(slope), dtype=bool), 1.0 + np.abs(slope + 1.0), np.abs(slope)
    )


def _eliminated(slope: Vector, residual: Vector) -> Vector:
    """Return the step d by Gaussian elimination with row exchanges; NaN if a pivot is only round-off.

    Rows and columns are scaled for the choice of pivots, so the result does not depend on units. A pivot is
    valid if it exceeds the round-off of the terms of which it is the sum.
    """
    from scipy.linalg import lu, solve_triangular  # imported late, as it takes 0.15 s

    n, terms = residual.size, _terms(slope)
    weights = 1.0 / np.max(terms / np.max(terms, axis=0), axis=1)
    scaled = weights[:, None] * np.column_stack([slope, residual, terms])
    places, lower, upper = lu(scaled[:, :n], p_indices=True, check_finite=False)
    scaled = scaled[np.argsort(places)]
    pivots = np.abs(np.diag(upper))
    # Magnitudes of all products that elimination has subtracted from each pivot.
    eliminated = np.einsum("kj,jk->k", np.abs(lower), np.abs(upper)) - pivots
    if not (pivots > PIVOT_TOLERANCE * n * (scaled.diagonal(n + 1) + eliminated)).all():
        return np.full(n, np.nan)
    v = solve_triangular(lower, scaled[:, n], lower=True, check_finite=False)
    return np.asarray(solve_triangular(upper, v, check_finite=False))


def residual_left(calls: Iterable[KernelCall]) -> float:
    """Return the largest residual of the iterations among kernel `calls` that failed in the last call [any].

    It is zero if only round-off is left.
    """
    kernels = (call.kernel.function for call in calls)
    return max((k.left for k in kernels if isinstance(k, _Iteration)), default=0.0)


def _kernel(equations: ca.Function) -> Kernel:
    """Return the kernel that solves the equations ``(z, s) -> (residual, slope)`` for z."""
    n = equations.size1_in(0)
    body = straight_line(equations, ("z", "s"), ("residual", "slope"))
    declarations = f"""{c_file("newton.h")}
static __attribute__((noinline))
void {KERNEL_NAME}_equations(const double* z, const double* s, double* residual, double* slope) {{
{body}
}}"""
    call = f"tf_newton({n}, {KERNEL_NAME}_equations, in, out);"
    near = cache(partial(_near, equations))
    return c_kernel(_Iteration(equations), declarations, call, near)


def _near(equations: ca.Function) -> ca.Function:
    """Return the function of one Newton step from the initial guess in the input of the kernel."""
    n, given = (
        equations.size1_in(0),
        ca.SX.sym("given", equations.size1_in(0) + equations.size1_in(1)),
    )
    residual, slope = equations(given[:n], given[n:])
    step = _step(residual, ca.reshape(slope, n, n).T)
    return ca.Function("near", [given], [given[:n] - step])


class _Iteration(NumPyFunction):
    """Newton's method for CasADi's interpreter; the same algorithm as in ``newton.h``.

    Parameters
    ----------
    equations : casadi.Function
        ``(z, s) -> (residual, slope)``.

    Attributes
    ----------
    left : float
        Largest residual if the last call failed, zero if it succeeded or only round-off is left
        [unit of the signal].
    """

    def __init__(self, equations: ca.Function) -> None:
        self._equations, self.left = equations, 0.0
        self._unknowns, others = equations.size1_in(0), equations.size1_in(1)
        super().__init__("algebraic_loop", self._unknowns + others, self._unknowns)

    @np.errstate(all="ignore")
    def value(self, argument: Vector) -> Vector:
        """Return the solution, or NaN."""
        z, s = np.split(argument, [self._unknowns])
        step, residual, terms = self._step(z, s)
        solved, ended, last = False, False, np.zeros(z.size)
        for _ in range(MAX_STEPS):
            moved, size = np.abs(step), np.abs(z)
            close = bool(np.all(moved <= 1e-12 * size))
            # The step is small enough for a solution if round-off prevents further progress.
            rough = bool(np.all(moved <= 1e-10 * (size + last) + 1e-13 * terms))
            unit = np.where(terms + moved > 0.0, terms + moved, 1.0)
            left, part = np.sum((residual / unit) ** 2), 1.0
            while True:
                new_step, new_residual, new_terms = self._step(z - part * step, s)
                now = np.sum((new_residual / unit) ** 2)
                if now < left:
                    last, z = part * moved, z - part * step
                    step, residual, terms, left = new_step, new_residual, new_terms, now
                    break
                if rough or not part > 1e-9:
                    ended = True
                    break
                part /= 2
            solved = rough or left == 0.0
            if ended or close or left == 0.0:
                break
        if solved and np.isfinite(step).all():
            self.left = 0.0
            return z
        round_off = bool(np.all(np.abs(residual) <= 1e-13 * terms))
        self.left = 0.0 if round_off else float(np.max(np.abs(residual)))
        return np.full(z.size, np.nan)

    def _step(self, z: Vector, s: Vector) -> tuple[Vector, Vector, Vector]:
        """Return the Newton step at z, NaN if there is none; the residual, and the magnitude of its terms."""
        residual, flat = (each.full().ravel() for each in self._equations(z, s))
        slope = flat.reshape(z.size, z.size)
        return _eliminated(slope, residual), residual, _terms(slope) @ np.abs(z)

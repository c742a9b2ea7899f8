"""Linear algebra that exploits structural zeros and equal blocks when traced."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import casadi as ca
import numpy as np

from trussflow.blocks.support.types import Array
from trussflow.blocks.tracing.kernels import (
    from_expression,
    is_traced,
    repeated,
    shape_of,
    to_expression,
)

PIVOT_TOLERANCE = 1e-11
"""Smallest pivot, relative to the diagonal element, that is not round-off of a singular matrix."""

Blocks = tuple[list[int], list[list[int]]]
"""Rows of the border, and rows of each diagonal block."""


def solve_positive_definite(matrix: Array, right_hand_side: Array) -> Array:
    r"""Solve :math:`A x = b` for a symmetric positive definite :math:`A`.

    NumPy arrays are solved by Cholesky factorization. Traced ones use a sparse :math:`L D L^T`
    factorization without operations on structural zeros. If A consists of diagonal blocks of one size
    with a border, such as the mass matrix of a body with several equal arms, one kernel eliminates the
    blocks. Traced code does not check A: it also solves an indefinite system. If a pivot is zero up to
    round-off, it returns NaN, but it does not check the pivots of such diagonal blocks.

    Parameters
    ----------
    matrix : array, shape (n, n)
        Symmetric positive definite [any]; only the lower triangle is read.
    right_hand_side : array, shape (n,) or (n, k)
        b [any].

    Returns
    -------
    array, shape (n,) or (n, k)
        x [unit of b / unit of A].

    Raises
    ------
    numpy.linalg.LinAlgError
        If a numeric `matrix` is not positive definite, or singular up to round-off.
    """
    if not is_traced(matrix) and not is_traced(right_hand_side):
        # raises if the matrix is not positive definite
        factor = np.linalg.cholesky(matrix)
        if np.any(np.diagonal(factor) ** 2 < PIVOT_TOLERANCE * np.diagonal(matrix)):
            raise np.linalg.LinAlgError("Matrix is singular")
        return np.linalg.solve(factor.T, np.linalg.solve(factor, right_hand_side))
    shape = shape_of(right_hand_side)
    n = shape[0]
    flat = to_expression(right_hand_side)
    # Elements are row-major, CasADi's reshape is column-major: the transpose converts.
    columns = flat if len(shape) == 1 else ca.reshape(flat, shape[1], n).T
    # Mirroring the lower triangle removes all expressions that only the upper triangle uses.
    dense = ca.tril2symm(ca.tril(ca.reshape(to_expression(matrix), n, n).T))
    found = _bordered(ca.sparsify(dense).sparsity())
    if found is not None:
        solution = _solve_bordered(dense, columns, found)
    else:
        d, lt, order = ca.ldl(ca.sparsify(dense), True)
        pivots = ca.if_else(
            ca.fabs(d) > PIVOT_TOLERANCE * ca.fabs(ca.diag(dense)[order]), d, np.nan
        )
        solution = ca.densify(ca.ldl_solve(columns, pivots, lt, order))
    return from_expression(solution if len(shape) == 1 else ca.vec(solution.T), shape)


def weighted_gramian(matrix: Array, weights: Array) -> Array:
    r"""Return :math:`A\, \mathrm{diag}(w)\, A^T`.

    When traced, structural zeros need no operations, and columns with nonzeros in the same rows form a
    group. One kernel computes several groups of one shape.

    Parameters
    ----------
    matrix : array, shape (m, n)
        A [any].
    weights : array, shape (n,)
        w [any].

    Returns
    -------
    array, shape (m, m)
        Symmetric.
    """
    if not is_traced(matrix):
        return (matrix * weights) @ matrix.T
    m, n = shape_of(matrix)
    dense, w = _matrix(matrix, (m, n)), to_expression(weights)
    pattern = ca.sparsify(dense).sparsity()
    # Columns with equal rows of nonzeros add to the same submatrix of the result.
    by_rows: dict[tuple[int, ...], list[int]] = {}
    for column, (start, stop) in enumerate(pairwise(pattern.colind())):
        if start < stop:
            by_rows.setdefault(tuple(pattern.row()[start:stop]), []).append(column)
    by_shape: dict[tuple[int, int], list[tuple[list[int], list[int]]]] = {}
    for rows, columns in by_rows.items():
        by_shape.setdefault((len(rows), len(columns)), []).append((list(rows), columns))
    total = ca.SX(m, m)
    for (height, _), groups in by_shape.items():
        parts = [(_array(dense[r, c]), _array(w[c])[:, 0]) for r, c in groups]
        grams = (
            repeated(_gramian, parts) if height > 2 else [_gramian(*p) for p in parts]
        )
        for (filled, _), (part,) in zip(groups, grams, strict=True):
            total[filled, filled] += _matrix(part, (height, height))
    return _array(total)


def block_diagonal(first: Array, second: Array) -> Array:
    """Return the block-diagonal matrix of two matrices.

    Parameters
    ----------
    first, second : array, shape (m, n) and (k, l)
        The matrices [any]; k and l may be 0.
    """
    (m, n), (k, width) = shape_of(first), shape_of(second)
    wide = np.hstack([first, np.zeros((m, width))]) if width else first
    return np.vstack([wide, np.hstack([np.zeros((k, n)), second])]) if k else wide


def _gramian(block: Array, weights: Array) -> tuple[Array]:
    """Return a weighted Gramian whose two triangles share their expressions."""
    n = shape_of(block)[0]
    product = _matrix((block * weights) @ block.T, (n, n))
    return (_array(_mirrored(product)),)


def _mirrored(matrix: ca.SX) -> ca.SX:
    """Return the symmetric matrix with the lower triangle of a matrix."""
    i, j = np.indices(matrix.shape)
    lower = np.maximum(i, j) + len(i) * np.minimum(i, j)
    return ca.reshape(ca.vec(matrix)[lower.ravel().tolist()], matrix.shape)


def _bordered(pattern: ca.Sparsity) -> Blocks | None:
    """Return the smallest border of dense rows, and the diagonal blocks of one size left by it, if any."""
    entries = np.diff(pattern.colind())
    # A border consists of the rows with the most entries, so each count is tried as the threshold.
    for fewest in sorted(set(entries.tolist()), reverse=True):
        border, inner = (
            np.flatnonzero(entries >= fewest),
            np.flatnonzero(entries < fewest),
        )
        if inner.size == 0:
            break
        # The pattern is symmetric: strongly connected components are blocks.
        inside, _ = pattern.sub(inner.tolist(), inner.tolist())
        count, order, starts = inside.scc()
        blocks = [sorted(inner[order[a:b]].tolist()) for a, b in pairwise(starts)]
        if count > 1 and len(blocks[0]) > 1 and len({len(b) for b in blocks}) == 1:
            return border.tolist(), blocks
    return None


def _solve_bordered(matrix: ca.SX, right: ca.SX, found: Blocks) -> ca.SX:
    """Eliminate the diagonal blocks, solve for the border, and substitute back."""
    border, blocks = found
    m, k, size = len(border), right.size2(), len(blocks[0])
    beside = [ca.horzcat(matrix[b, border], right[b, :]) for b in blocks]
    eliminated = repeated(
        partial(_eliminate, m),
        [
            (_array(matrix[b, b]), _array(c))
            for b, c in zip(blocks, beside, strict=True)
        ],
    )
    folded = [_matrix(update, (m, m + k)) for _, _, update in eliminated]
    # Only the border is left: its Schur complement is dense and small.
    schur = matrix[border, border] - sum(f[:, :m] for f in folded)
    d, lt, order = ca.ldl(schur, False)
    reduced = right[border, :] - sum(f[:, m:] for f in folded)
    on_border = ca.densify(ca.ldl_solve(reduced, d, lt, order))
    substituted = repeated(
        partial(_substitute, m),
        [(factor, scaled, _array(on_border)) for factor, scaled, _ in eliminated],
    )
    solution = ca.SX(matrix.size1(), k)
    solution[border, :] = on_border
    for b, (part,) in zip(blocks, substituted, strict=True):
        solution[b, :] = _matrix(part, (size, k))
    return solution


def _array(matrix: ca.SX) -> Array:
    """Return a CasADi matrix as an array."""
    return from_expression(ca.vec(ca.densify(matrix).T), matrix.shape)


def _matrix(array: Array, shape: tuple[int, int]) -> ca.SX:
    """Return an array as a CasADi matrix."""
    return ca.reshape(to_expression(array), shape[1], shape[0]).T


def _eliminate(border: int, block: Array, beside: Array) -> tuple[Array, Array, Array]:
    r"""Factorize a diagonal block A, and eliminate the columns B = [C, b] next to it.

    With :math:`A = L D L^T`, return L without its diagonal of ones, :math:`Y = D^{-1} L^{-1} B`
    and :math:`C^T A^{-1} B`, which is subtracted from the border (Schur complement).
    """
    n, width = shape_of(beside)
    both = ca.horzcat(_matrix(block, (n, n)), _matrix(beside, (n, width)))
    rows, inverse, lower = (
        ca.SX(0, n + width),
        ca.SX(1, 0),
        list[ca.SX](),
    )  # L^-1 [A, B]
    for i in range(n):
        factors = rows[:, i].T * inverse
        rows = ca.vertcat(rows, both[i, :] - factors @ rows)
        inverse = ca.horzcat(inverse, 1.0 / rows[i, i])
        lower.append(factors.T)
    forward = rows[:, n:]
    scaled = ca.vertcat(*(forward[i, :] * inverse[i] for i in range(n)))
    update = forward[:, :border].T @ scaled
    update[:, :border] = _mirrored(update[:, :border].T)
    strict = ca.vertcat(*lower)
    return from_expression(strict, (strict.numel(),)), _array(scaled), _array(update)


def _substitute(
    border: int, lower: Array, scaled: Array, on_border: Array
) -> tuple[Array]:
    """Return the unknowns of a diagonal block from those of the border (back substitution)."""
    n, width = shape_of(scaled)
    right = _matrix(
        scaled[:, border:] - scaled[:, :border] @ on_border, (n, width - border)
    )
    entries = to_expression(lower)
    # The strict lower triangle is packed by rows, and row i has i elements.
    start = [i * (i - 1) // 2 for i in range(n)]
    found = ca.SX(0, width - border)  # from the last row upwards
    for i in reversed(range(n)):
        below = entries[[start[r] + i for r in reversed(range(i + 1, n))]]
        found = ca.vertcat(
            found, right[i, :] - ca.reshape(below, 1, found.size1()) @ found
        )
    return (_array(found[::-1, :]),)

"""Linear equations whose structure the tracer exploits."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import casadi as ca
import numpy as np

from trussflow.blocks.framework.types import Array
from trussflow.blocks.tracing.tracing import from_expression, is_traced, repeated, shape_of, to_expression

SINGULAR = 1e-11
"""Pivot of a matrix, relative to the element on its diagonal, below which nothing but round-off is left."""

Blocks = tuple[list[int], list[list[int]]]
"""Rows of the border, and rows of each diagonal block."""


def solve_positive_definite(matrix: Array, right_hand_side: Array) -> Array:
    r"""Solve :math:`A x = b` for a symmetric positive definite :math:`A`.

    NumPy arrays are solved by Cholesky factors. Traced ones become a sparse
    :math:`L D L^T` whose structural zeros cost nothing. If A consists of equal diagonal blocks
    with a border, as the mass matrix of a body with several equal arms does, the blocks
    are eliminated by one kernel. Traced code does not check A: it solves an indefinite one too,
    and returns NaN if a pivot is zero, where there are no such blocks but for round-off.

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
        If a numeric `matrix` is not positive definite, beyond round-off.
    """
    if not is_traced(matrix) and not is_traced(right_hand_side):
        factor = np.linalg.cholesky(matrix)  # refuses a matrix that is not positive definite
        if np.any(np.diagonal(factor) ** 2 < SINGULAR * np.diagonal(matrix)):
            raise np.linalg.LinAlgError("Matrix is singular")
        return np.linalg.solve(factor.T, np.linalg.solve(factor, right_hand_side))
    shape = shape_of(right_hand_side)
    n = shape[0]
    flat = to_expression(right_hand_side)
    columns = flat if len(shape) == 1 else ca.reshape(flat, shape[1], n).T
    # What only the upper triangle needs is then not even computed.
    dense = ca.tril2symm(ca.tril(ca.reshape(to_expression(matrix), n, n).T))
    found = _bordered(ca.sparsify(dense).sparsity())
    if found is not None:
        solution = _solve_bordered(dense, columns, found)
    else:
        d, lt, order = ca.ldl(ca.sparsify(dense), True)
        pivots = ca.if_else(ca.fabs(d) > SINGULAR * ca.fabs(ca.diag(dense)[order]), d, np.nan)
        solution = ca.densify(ca.ldl_solve(columns, pivots, lt, order))
    return from_expression(solution if len(shape) == 1 else ca.vec(solution.T), shape)


def weighted_gramian(matrix: Array, weights: Array) -> Array:
    r"""Return :math:`A\, \mathrm{diag}(w)\, A^T`.

    Traced, structural zeros cost nothing, and columns that fill the same rows are taken
    together; if there are several such groups of one shape, one kernel does them all.

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
        grams = repeated(_gramian, parts) if height > 2 else [_gramian(*p) for p in parts]
        for (filled, _), (part,) in zip(groups, grams, strict=True):
            total[filled, filled] += _matrix(part, (height, height))
    return _array(total)


def block_diagonal(first: Array, second: Array) -> Array:
    """Return the matrix with two matrices on its diagonal.

    Parameters
    ----------
    first, second : array, shape (m, n) and (k, l)
        The matrices [any]; k and l may be 0.
    """
    (m, n), (k, width) = shape_of(first), shape_of(second)
    wide = np.hstack([first, np.zeros((m, width))]) if width else first
    return np.vstack([wide, np.hstack([np.zeros((k, n)), second])]) if k else wide


def _gramian(block: Array, weights: Array) -> tuple[Array]:
    """Return a weighted Gramian; both halves are the same expressions."""
    n = shape_of(block)[0]
    product = _matrix((block * weights) @ block.T, (n, n))
    return (_array(_mirrored(product)),)


def _mirrored(matrix: ca.SX) -> ca.SX:
    """Return a matrix with the elements of its lower triangle on both sides."""
    i, j = np.indices(matrix.shape)
    lower = np.maximum(i, j) + len(i) * np.minimum(i, j)
    return ca.reshape(ca.vec(matrix)[lower.ravel().tolist()], matrix.shape)


def _bordered(pattern: ca.Sparsity) -> Blocks | None:
    """Find the smallest border of dense rows that leaves diagonal blocks of one size."""
    entries = np.diff(pattern.colind())
    for fewest in sorted(set(entries.tolist()), reverse=True):
        border, inner = np.flatnonzero(entries >= fewest), np.flatnonzero(entries < fewest)
        if inner.size == 0:
            break
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
        [(_array(matrix[b, b]), _array(c)) for b, c in zip(blocks, beside, strict=True)],
    )
    folded = [_matrix(update, (m, m + k)) for _, _, update in eliminated]
    schur = matrix[border, border] - sum(f[:, :m] for f in folded)
    d, lt, order = ca.ldl(schur, False)
    reduced = right[border, :] - sum(f[:, m:] for f in folded)
    on_border = ca.densify(ca.ldl_solve(reduced, d, lt, order))
    substituted = repeated(
        partial(_substitute, m), [(factor, scaled, _array(on_border)) for factor, scaled, _ in eliminated]
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
    r"""Factorize a diagonal block A and fold what is beside it, B = [C, b], into the border.

    With :math:`A = L D L^T`, return L (its diagonal of ones left out), :math:`Y = D^{-1} L^{-1} B`
    and :math:`C^T A^{-1} B`, which the border loses.
    """
    n, width = shape_of(beside)
    matrix, right = _matrix(block, (n, n)), _matrix(beside, (n, width))
    unscaled = ca.SX(n, 0)  # L D; what stands above the diagonal is not taken
    lower, inverse, forward, scaled = list[ca.SX](), ca.SX(1, 0), ca.SX(0, width), ca.SX(0, width)
    for i in range(n):
        row = unscaled[i, :] * inverse
        column = matrix[:, i] - unscaled @ row.T
        solved = right[i, :] - row @ forward
        unscaled, inverse = ca.horzcat(unscaled, column), ca.horzcat(inverse, 1.0 / column[i])
        forward, scaled = ca.vertcat(forward, solved), ca.vertcat(scaled, solved * inverse[i])
        lower.append(row.T)
    update = forward[:, :border].T @ scaled
    update[:, :border] = _mirrored(update[:, :border].T)
    strict = ca.vertcat(*lower)
    return from_expression(strict, (strict.numel(),)), _array(scaled), _array(update)


def _substitute(border: int, lower: Array, scaled: Array, on_border: Array) -> tuple[Array]:
    """Return the unknowns of a diagonal block, given those of the border."""
    n, width = shape_of(scaled)
    right = _matrix(scaled[:, border:] - scaled[:, :border] @ on_border, (n, width - border))
    entries = to_expression(lower)
    start = [i * (i - 1) // 2 for i in range(n)]
    found = ca.SX(0, width - border)  # from the last row upwards
    for i in reversed(range(n)):
        below = entries[[start[r] + i for r in reversed(range(i + 1, n))]]
        found = ca.vertcat(found, right[i, :] - ca.reshape(below, 1, found.size1()) @ found)
    return (_array(found[::-1, :]),)

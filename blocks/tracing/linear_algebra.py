"""Linear equations whose structure the tracer exploits."""

from __future__ import annotations

from collections.abc import Sequence
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
    scaled, n = block * weights, shape_of(block)[0]
    lower = [[scaled[i] @ block[j] for j in range(i + 1)] for i in range(n)]
    return (_stack([[lower[max(i, j)][min(i, j)] for j in range(n)] for i in range(n)]),)


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
    unscaled: list[list[Array]] = [[] for _ in range(n)]  # L D, row by row
    lower: list[list[Array]] = []
    inverse: list[Array] = []
    for i in range(n):
        lower.append([u * d for u, d in zip(unscaled[i], inverse, strict=True)])
        for r in range(i, n):
            unscaled[r].append(block[r, i] - _dot(unscaled[r][:i], lower[i]))
        inverse.append(1.0 / unscaled[i][i])
    forward: list[list[Array]] = []
    for i in range(n):
        forward.append([beside[i, c] - _dot(lower[i], [f[c] for f in forward]) for c in range(width)])
    scaled = [[f * d for f in row] for row, d in zip(forward, inverse, strict=True)]
    columns = list(zip(*scaled, strict=True))
    update: list[list[Array]] = []
    for a, ahead in enumerate(list(zip(*forward, strict=True))[:border]):
        mirrored = [update[c][a] for c in range(a)]
        update.append(mirrored + [_dot(ahead, columns[c]) for c in range(a, width)])
    strict = [entry for row in lower for entry in row]
    return np.stack(strict), _stack(scaled), _stack(update)


def _substitute(border: int, lower: Array, scaled: Array, on_border: Array) -> tuple[Array]:
    """Return the unknowns of a diagonal block, given those of the border."""
    n, width = shape_of(scaled)
    right = scaled[:, border:] - scaled[:, :border] @ on_border
    start = [i * (i - 1) // 2 for i in range(n)]
    found: list[list[Array]] = []  # from the last row upwards
    for i in reversed(range(n)):
        below = [lower[start[r] + i] for r in reversed(range(i + 1, n))]
        found.append([right[i, c] - _dot(below, [f[c] for f in found]) for c in range(width - border)])
    return (_stack(found[::-1]),)


def _dot(first: Sequence[Array], second: Sequence[Array]) -> Array:
    return sum((a * b for a, b in zip(first, second, strict=True)), start=0.0)


def _stack(rows: Sequence[Sequence[Array]]) -> Array:
    return np.stack([np.stack(list(row)) for row in rows])

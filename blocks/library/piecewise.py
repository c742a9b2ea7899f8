"""Limits and piecewise polynomials that can be traced."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array, shown

# Finite, as parameters must be, and as 0 * inf in a derivative would be NaN.
NO_LIMIT = 1e300
"""Magnitude of limits without effect [any]."""


def row_for_each(owner: str, **table: npt.ArrayLike) -> tuple[Vector, Vector]:
    """Return the two checked columns of a table.

    Parameters
    ----------
    owner : str
        Name of the block, for messages.
    **table : array_like
        Columns from the user by argument name: at least two increasing points, then a number or a row
        for each point [any].

    Raises
    ------
    BlockError
        If the points do not increase, or the values do not match them.
    """
    (at, points), (what, values) = [
        (n, finite_array(f"{n} of {owner}", v)) for n, v in table.items()
    ]
    if points.ndim != 1 or points.size < 2 or not np.all(np.diff(points) > 0):
        raise BlockError(
            f"{owner} needs at least two increasing {at}; got {shown(points.tolist())}"
        )
    if values.ndim not in (1, 2) or len(values) != points.size:
        raise BlockError(
            f"{owner} has {points.size} {at}, but {what} of shape {values.shape}; give a number, or a "
            "row, for each"
        )
    return points, values


def limited(x: Array, lower: Array, upper: Array) -> Array:
    """Return `x` limited to a range; NaN stays NaN.

    In CasADi's interpreter, `np.clip` would replace NaN by one of the limits.

    Parameters
    ----------
    x : array
        Array to limit [any].
    lower, upper : array
        The limits [unit of x].
    """
    # Comparisons with NaN are false, so that the last branch returns it.
    return np.where(x < lower, lower, np.where(x > upper, upper, x))


def piece(x: Array, starts: Vector, tables: Sequence[Vector]) -> list[Array]:
    """Return the row of each table for the piece that contains `x`.

    Parameters
    ----------
    x : array, shape ()
        Independent variable [any].
    starts : Vector, shape (k,)
        Increasing start points of the pieces [unit of x]; the first piece also covers smaller `x`.
    tables : sequence of Vector, shape (k, ...)
        One row for each piece [any].
    """
    # Of all pieces that start at or before x, the last replaces the others. Traced code
    # has no data-dependent index, so that the cost is linear in the number of pieces.
    rows: list[Array] = [table[0] for table in tables]
    for k in range(1, len(starts)):
        inside = x >= starts[k]
        rows = [
            np.where(inside, table[k], row)
            for table, row in zip(tables, rows, strict=True)
        ]
    return rows


def polynomial(x: Array, coefficients: Sequence[Array]) -> Array:
    """Return the value of a polynomial, lowest power first.

    Parameters
    ----------
    x : array
        Independent variable [any].
    coefficients : sequence of array
        Coefficients of 1, x, x^2, ... [any].
    """
    value = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        value = value * x + coefficient
    return value

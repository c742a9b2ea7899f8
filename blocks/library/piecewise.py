"""Limits and piecewise polynomials, written so that they can be traced."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trussflow.blocks.framework.types import Array, Vector


def limited(x: Array, lower: Array, upper: Array) -> Array:
    """Return `x` between two limits, and NaN where it is NaN.

    In CasADi's interpreter, `np.clip` would turn NaN into one of the limits.

    Parameters
    ----------
    x : array
        What to limit [any].
    lower, upper : array
        The limits [unit of x].
    """
    return np.where(x < lower, lower, np.where(x > upper, upper, x))


def piece(x: Array, starts: Vector, tables: Sequence[Vector]) -> list[Array]:
    """Return, from each table, the row of the piece in which `x` lies.

    Parameters
    ----------
    x : array, shape ()
        Where to look [any].
    starts : Vector, shape (k,)
        Where the pieces start, increasing [unit of x]; the first also serves all before it.
    tables : sequence of Vector, shape (k, ...)
        One row for each piece [any].
    """
    rows: list[Array] = [table[0] for table in tables]
    for k in range(1, len(starts)):
        inside = x >= starts[k]
        rows = [np.where(inside, table[k], row) for table, row in zip(tables, rows, strict=True)]
    return rows


def polynomial(x: Array, coefficients: Sequence[Array]) -> Array:
    """Return the value of a polynomial, lowest power first.

    Parameters
    ----------
    x : array
        Where to evaluate [any].
    coefficients : sequence of array
        Coefficients of 1, x, x^2, ... [any].
    """
    value = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        value = value * x + coefficient
    return value

"""NumPy functions that CasADi lacks, or that differ for NaN, infinite numbers, ties, or signed zeros.

Each is composed of functions that CasADi evaluates as NumPy does. Results must not depend on the single
rounding of a fused multiply-add: `np.fmod` and `np.floor` take and return rounded numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.support.types import Array

MIN_ALL_INTEGERS = 2.0**52
"""Smallest magnitude from which on every floating-point number is an integer [-]."""


def _isnan(x: Array) -> Array:
    return np.logical_not(np.abs(x) <= np.inf)  # CasADi simplifies x == x to true


def _rest(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the remainder of a division with the sign of `a`, and whether its sign differs from `b`."""
    rest = np.fmod(a, b)
    return rest, np.where(np.greater(b, 0.0), rest < 0.0, rest > 0.0)


def _mod(a: Array, b: Array) -> Array:
    rest, wrong = _rest(a, b)
    return np.where(wrong, rest + b, rest)


def _floor_divide(a: Array, b: Array) -> Array:
    rest, wrong = _rest(a, b)
    nearly = np.subtract(a, rest) / b - np.where(wrong, 1.0, 0.0)
    # The quotient without the remainder is an integer up to round-off.
    return np.where(np.equal(b, 0.0), np.divide(a, b), np.floor(nearly + 0.5))


def _rint(x: Array) -> Array:
    # distance from the nearest integer, ties to even
    rest = x._binop(1.0, ca.remainder)
    return np.where(np.abs(x) < MIN_ALL_INTEGERS, np.floor(x - rest + 0.5), x)


def _round(a: Array, decimals: int = 0) -> Array:
    factor = 10.0 ** abs(decimals)
    return (
        np.rint(a * factor) / factor if decimals > 0 else np.rint(a / factor) * factor
    )


def _interp(x: Array, xp: Array, fp: Array, *_: None, **_named: None) -> Array:
    # left and right are None here: other values are refused before.
    # From the right, so that of all points beyond x the leftmost determines the piece.
    found = fp[-1]
    for i in reversed(range(len(xp) - 1)):
        slope = (fp[i + 1] - fp[i]) / (xp[i + 1] - xp[i])
        found = np.where(x < xp[i + 1], fp[i] + (x - xp[i]) * slope, found)
    found = np.where(x < xp[0], fp[0], found)
    return np.where(np.isnan(x), x, found)


NUMPY_REPLACEMENTS: dict[Callable[..., Any], Callable[..., Any]] = {
    np.isnan: _isnan,
    np.isfinite: lambda x: np.abs(x) < np.inf,
    np.isinf: lambda x: np.equal(np.abs(x), np.inf),
    np.signbit: lambda x: np.copysign(1.0, x) < 0.0,
    np.remainder: _mod,
    np.floor_divide: _floor_divide,
    np.rint: _rint,
    np.round: _round,
    np.around: _round,
    np.interp: _interp,
}
"""Traced implementation of each NumPy function, used instead of that of CasADi."""

REFUSED_FUNCTIONS = (
    *(np.fmax, np.fmin, np.nanmax, np.nanmin, np.nansum, np.nanprod, np.nancumsum),
    *(np.isposinf, np.isneginf, np.modf, np.heaviside, np.logaddexp, np.logaddexp2),
    *(np.nan_to_num, np.isclose, np.divmod, np.digitize),
)
"""NumPy functions for which CasADi returns other numbers, mostly for NaN and infinite numbers."""

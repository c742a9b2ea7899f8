"""How each operation of a CasADi expression is written in C, on numbers and on vectors of them."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass

import casadi as ca

ALL_LANES = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "{m[0]}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_INV: "1.0 / {0}",
}
"""Operations that are written alike, and round alike, on numbers and on vectors of lanes; {m[0]} is the first
operand with the other sign."""

SERIES = {
    ca.OP_SIN: "{w}sin({0})",
    ca.OP_COS: "{w}cos({0})",
    ca.OP_EXP: "{w}exp({0})",
    ca.OP_LOG: "{w}log({0})",
    ca.OP_POW: "{w}pow({0}, {1})",
    ca.OP_CONSTPOW: "{w}pow({0}, {1})",
}
"""Functions that are done in all lanes at once by the series of ``lanes.h``, which round otherwise than C's;
{w} is the prefix of the vector's own functions, empty for numbers."""

# The functions that C has under the names that CasADi gives its operations.
_OF_ONE = (
    *("sqrt", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("log1p", "expm1", "erf", "floor", "ceil"),
)
_OF_TWO = ("fmod", "copysign", "atan2", "hypot", "remainder")

ONE_LANE = {
    **{getattr(ca, f"OP_{name.upper()}"): f"{name}({{0}})" for name in _OF_ONE},
    **{getattr(ca, f"OP_{name.upper()}"): f"{name}({{0}}, {{1}})" for name in _OF_TWO},
}
"""Operations written once for each lane."""

CHOICES = {
    ca.OP_FABS: "fabs({0})",
    ca.OP_LT: "{0} < {1}",
    ca.OP_LE: "{0} <= {1}",
    ca.OP_EQ: "{0} == {1}",
    ca.OP_NE: "{0} != {1}",
    ca.OP_NOT: "!{0}",
    ca.OP_AND: "{0} && {1}",
    ca.OP_OR: "{0} || {1}",
    ca.OP_SIGN: "({0} < 0 ? -1 : {0} > 0 ? 1 : {0})",
    ca.OP_IF_ELSE_ZERO: "{0} ? {1} : 0",
    ca.OP_FMIN: "({0} < {1} || {0} != {0} ? {0} : {1})",  # NaN stays NaN, as in np.minimum
    ca.OP_FMAX: "({0} > {1} || {0} != {0} ? {0} : {1})",
}
"""Comparisons and choices, on numbers."""

BY_MASK = {
    ca.OP_FABS: "{w}fabs({0})",
    ca.OP_LT: "{w}one({0} < {1})",
    ca.OP_LE: "{w}one({0} <= {1})",
    ca.OP_EQ: "{w}one({0} == {1})",
    ca.OP_NE: "{w}one({0} != {1})",
    ca.OP_NOT: "{w}one({0} == {w}all(0.0))",
    ca.OP_AND: "{w}one(({0} != {w}all(0.0)) & ({1} != {w}all(0.0)))",
    ca.OP_OR: "{w}one(({0} != {w}all(0.0)) | ({1} != {w}all(0.0)))",
    ca.OP_SIGN: "{w}where({0} < {w}all(0.0), {w}all(-1.0), {w}where({0} > {w}all(0.0), {w}all(1.0), {0}))",
    ca.OP_IF_ELSE_ZERO: "{w}where({0} != {w}all(0.0), {1}, {w}all(0.0))",
    ca.OP_FMIN: "{w}where(({0} < {1}) | ({0} != {0}), {0}, {1})",
    ca.OP_FMAX: "{w}where(({0} > {1}) | ({0} != {0}), {0}, {1})",
}
"""The same on vectors: a comparison makes a mask of bits, by which lanes are chosen."""

OF_PRODUCTS = {-1: "{w}fma({0}, {1}, {2})", -2: "{w}fma({0}, {1}, {m[2]})", -3: "{w}fma({m[0]}, {1}, {2})"}
"""Operations that CasADi has not: a b + c, a b - c, and c - a b, rounded once; on numbers and vectors."""

FUSED = {(ca.OP_ADD, 0): -1, (ca.OP_ADD, 1): -1, (ca.OP_SUB, 0): -2, (ca.OP_SUB, 1): -3}
"""Which of them an operation becomes whose operand of that number is a product."""


@dataclass(frozen=True, slots=True)
class Numbers:
    """How C calls what it computes with: numbers, or vectors of as many as there are lanes.

    Attributes
    ----------
    lanes : int
        Numbers side by side [-]; 1 for numbers.
    series : bool
        Whether functions are done in all lanes at once, by series; else each lane calls C's own, so that
        it rounds as a number does.
    """

    lanes: int = 1
    series: bool = False

    @property
    def type(self) -> str:
        """Their type."""
        return "double" if self.lanes == 1 else f"tf_lanes{self.lanes}"

    def of_one(self, text: str) -> str:
        """Return what has in all lanes the number that C writes so."""
        return text if self.lanes == 1 else f"tf_{self.lanes}_all({text})"

    def computed(self, operation: int, operands: Sequence[str], sums: Container[str] = ()) -> str:
        """Return what CasADi's `operation` [-] makes of `operands` of this type; `sums` are made by fma."""
        minus = [f"-{o}" for o in operands]
        if self.lanes == 1:
            # Compilers write -(a b + c) as -a b - c, by which an exact zero has the other sign.
            minus = [f"tf_minus({o})" if o in sums else m for o, m in zip(operands, minus, strict=True)]
            return str(FORMULAS[operation].format(*operands, w="", m=minus))
        if operation in ONE_LANE or (operation in SERIES and not self.series):
            lanes = ([f"{o}[{i}]" for o in operands] for i in range(self.lanes))
            return f"({self.type}){{{', '.join(FORMULAS[operation].format(*each, w='') for each in lanes)}}}"
        return str(ON_VECTORS[operation].format(*operands, w=f"tf_{self.lanes}_", m=minus))


FORMULAS = ALL_LANES | SERIES | OF_PRODUCTS | ONE_LANE | CHOICES
"""All operations, as they are written on numbers."""

ON_VECTORS = FORMULAS | BY_MASK
"""The same, as they are written on vectors, but where each lane is written by itself."""

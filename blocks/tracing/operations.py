"""C expressions of CasADi's operations, for numbers and for vectors; C functions in files."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass

import casadi as ca

from trussflow.blocks.support.texts import package_text

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
"""Operations with the same C expression and rounding for numbers and vectors; {m[0]} is a negated operand."""

SERIES_FUNCTIONS = {
    ca.OP_SIN: "{w}sin({0})",
    ca.OP_COS: "{w}cos({0})",
    ca.OP_EXP: "{w}exp({0})",
    ca.OP_LOG: "{w}log({0})",
    ca.OP_POW: "{w}pow({0}, {1})",
    ca.OP_CONSTPOW: "{w}pow({0}, {1})",
}
"""Functions that ``lanes.h`` computes by series in all lanes at once, with other rounding than the C library.

{w} is the prefix of the vector functions, empty for numbers.
"""

# Functions of the C library with the names of CasADi's operations.
_OF_ONE = (
    *(
        "sqrt",
        "tan",
        "asin",
        "acos",
        "atan",
        "sinh",
        "cosh",
        "tanh",
        "asinh",
        "acosh",
        "atanh",
    ),
    *("log1p", "expm1", "erf", "floor", "ceil"),
)
_OF_TWO = ("fmod", "copysign", "atan2", "hypot", "remainder")

ONE_LANE = {
    **{getattr(ca, f"OP_{name.upper()}"): f"{name}({{0}})" for name in _OF_ONE},
    **{getattr(ca, f"OP_{name.upper()}"): f"{name}({{0}}, {{1}})" for name in _OF_TWO},
}
"""Operations that are computed lane by lane, with functions of the C library."""

SCALAR_CHOICES = {
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
"""Comparisons and selections for numbers."""

MASKED_CHOICES = {
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
"""Comparisons and selections for vectors: the bit mask of a comparison selects lanes."""

FUSED_FORMULAS = {
    -1: "{w}fma({0}, {1}, {2})",
    -2: "{w}fma({0}, {1}, {m[2]})",
    -3: "{w}fma({m[0]}, {1}, {2})",
}
"""Fused operations, which CasADi lacks: a b + c, a b - c, c - a b, rounded once; for numbers and vectors."""

FUSED_OPERATIONS = {
    (ca.OP_ADD, 0): -1,
    (ca.OP_ADD, 1): -1,
    (ca.OP_SUB, 0): -2,
    (ca.OP_SUB, 1): -3,
}
"""Fused operation that replaces an operation whose operand with this index is a product."""


@dataclass(frozen=True, slots=True)
class Numbers:
    """C type of numbers: scalars, or vectors with one number per lane.

    Attributes
    ----------
    lanes : int
        Vector length [-]; 1 for scalars.
    series : bool
        Whether series compute functions in all lanes at once. If not, each lane calls the C library, and
        rounds as a scalar does.
    """

    lanes: int = 1
    series: bool = False

    @property
    def type(self) -> str:
        """Name of the C type."""
        return "double" if self.lanes == 1 else f"tf_lanes{self.lanes}"

    def of_one(self, text: str) -> str:
        """Return the C expression of a vector with the scalar `text` in all lanes."""
        return text if self.lanes == 1 else f"tf_{self.lanes}_all({text})"

    def computed(
        self, operation: int, operands: Sequence[str], sums: Container[str] = ()
    ) -> str:
        """Return the C expression of CasADi's `operation` [-] on `operands`; `sums` are results of fma."""
        minus = [f"-{o}" for o in operands]
        if self.lanes == 1:
            # Compilers turn -(a b + c) into -a b - c, which changes the sign of an exact zero.
            minus = [
                f"tf_minus({o})" if o in sums else m
                for o, m in zip(operands, minus, strict=True)
            ]
            return str(FORMULAS[operation].format(*operands, w="", m=minus))
        if operation in ONE_LANE or (operation in SERIES_FUNCTIONS and not self.series):
            lanes = ([f"{o}[{i}]" for o in operands] for i in range(self.lanes))
            return f"({self.type}){{{', '.join(FORMULAS[operation].format(*each, w='') for each in lanes)}}}"
        return str(
            VECTOR_FORMULAS[operation].format(*operands, w=f"tf_{self.lanes}_", m=minus)
        )


FORMULAS = ALL_LANES | SERIES_FUNCTIONS | FUSED_FORMULAS | ONE_LANE | SCALAR_CHOICES
"""C expressions of all operations on numbers."""

VECTOR_FORMULAS = FORMULAS | MASKED_CHOICES
"""C expressions of operations on vectors, for those that are not computed lane by lane."""


def c_file(name: str, package: str = "trussflow.blocks.tracing") -> str:
    """Return the text of the file with that `name` in the folder of a `package`."""
    return package_text(name, package)

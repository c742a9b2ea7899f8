"""Blocks of port arithmetic: sum junctions, and one block for all other functions of NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Parameter, Signals
from trussflow.blocks.framework.port import INFERRED, Input, Output, Port, Shape
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.support.call_site import call_site
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import (
    as_shape,
    finite_array,
    one_sign_each,
    shown,
)

SUM_SIGNS = {np.add: "++", np.subtract: "+-", np.negative: "-"}
"""Signs of the sum junction for each operation that becomes one if all operands are signals."""

UNIT_PRESERVING = (
    *SUM_SIGNS,
    np.maximum,
    np.minimum,
    np.absolute,
    np.hypot,
    np.remainder,
    np.rint,
)
"""Operations on signals of one unit whose result has the same unit."""

COMPARISONS = (
    np.less,
    np.less_equal,
    np.greater,
    np.greater_equal,
    np.equal,
    np.not_equal,
)
"""Operations on signals of one unit whose result is 0 or 1."""

RESULT_UNITS = {
    np.multiply: "{}*{}",
    np.divide: "{}/{}",
    np.sqrt: "{}**0.5",
    np.square: "{}**2",
}
"""Unit of the result of other operations, if each operand has a unit."""

SIGNS = {
    "add": "+",
    "subtract": "−",
    "divide": "/",
    "power": "^",
    "matmul": "@",
    "greater": ">",
    "greater_equal": "≥",
    "less": "<",
    "less_equal": "≤",
}
"""Signs of operations by the name of their function; others are written as a call."""


class Sum(Block):
    r"""Add and subtract signals of one shape, unit and frame.

    .. math:: y = \sum_i \pm u_i

    Port arithmetic builds it: ``(a.y - b.y) >> c.u``.

    Parameters
    ----------
    signs : str
        One ``+`` or ``-`` for each input; the inputs are named ``u1``, ``u2``, ...

    Raises
    ------
    BlockError
        If `signs` contains other characters.
    """

    y = Output(
        INFERRED, unit=INFERRED, frame=INFERRED, meaning="signed sum of the inputs"
    )

    def __init__(self, signs: str = "++") -> None:
        one_sign_each("Sum", signs, "+-", "signs such as '++-'")
        self.signs = self.computes = signs
        self.extra_ports = {
            f"u{i}": Input(
                INFERRED, unit=INFERRED, frame=INFERRED, meaning=f"counts {sign}"
            )
            for i, sign in enumerate(signs, 1)
        }
        super().__init__()

    @property
    def _symbol(self) -> Symbol:
        return Symbol(outline="circle", pins=self.signs.replace("-", "−"))

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the signed sum."""
        total = u.u1 if self.signs[0] == "+" else -u.u1
        for i, sign in enumerate(self.signs[1:], 2):
            total = total + u[f"u{i}"] if sign == "+" else total - u[f"u{i}"]
        return {"y": total}


class Operation(Block):
    r"""Apply a function of NumPy to one or two signals, y = f(u1, u2).

    Port arithmetic builds it: ``(2.0 * a.y / b.y) >> c.u``, ``M @ a.y``, ``a.y > 1.0``, ``np.sin(a.y)``.
    Comparisons and logical functions return 0 or 1. Shapes broadcast as in NumPy.

    Parameters
    ----------
    function : numpy.ufunc
        Universal function of NumPy of one or two arrays, such as ``np.maximum`` or ``np.logical_and``.
    *operands : Input or array_like
        Operands in order: an `Input` for each signal, named ``u1`` or ``u2`` by its position. One of two may
        be a number or an array instead, the parameter ``constant`` [as the other operand, or none]. By
        default, all operands are signals of one shape, inferred from the connections.

    Raises
    ------
    BlockError
        If there is no such function, or the operands do not match it.
    ParameterError
        If the constant is not numeric.

    Examples
    --------
    >>> import numpy as np
    >>> from trussflow.blocks import Input, Operation
    >>> Operation(np.greater, Input(3, unit="m"), 0.5).u1
    <input 'Operation.u1' (shape (3,), unit m)>
    """

    def __init__(self, function: np.ufunc, *operands: Input | npt.ArrayLike) -> None:
        known: object = function
        if not isinstance(known, np.ufunc) or known.nout != 1 or known.nin > 2:
            raise BlockError(
                f"Operation has no function {shown(function)}; give a universal function of NumPy of one or "
                "two arrays, such as np.maximum. For other functions, use Function"
            )
        self.function = known
        given = operands or (Input(INFERRED),) * known.nin
        inputs = {
            f"u{i}": each for i, each in enumerate(given, 1) if isinstance(each, Input)
        }
        if len(given) != known.nin or not inputs:
            raise BlockError(
                f"Operation '{known.__name__}' takes {known.nin} operands, at least one of them an "
                f"Input(...), not {shown(operands)}"
            )
        numbers = [
            finite_array("the constant operand", each)
            for each in given
            if not isinstance(each, Input)
        ]
        if numbers:
            self._declared = {
                "constant": Parameter(
                    shape=None, meaning="the number among the operands"
                )
            }
        shape = _shape(
            known,
            [
                each.shape if isinstance(each, Input) else numbers[0].shape
                for each in given
            ],
        )
        # A constant factor or divisor has no unit, so the result has the unit of the signal.
        keeps = known in UNIT_PRESERVING or (known is np.multiply and bool(numbers))
        keeps = keeps or (known is np.divide and "u2" not in inputs)
        # If the operation keeps or compares units, its operands must have the same one.
        shared = INFERRED if keeps or known in COMPARISONS else None
        units = [each.unit for each in inputs.values()]
        result = None
        if (
            known in RESULT_UNITS
            and not numbers
            and all(isinstance(unit, str) for unit in units)
        ):
            result = RESULT_UNITS[known].format(
                # Brackets keep the order of operations: N/m divided by s is (N/m)/(s).
                *(u if u.isalnum() else f"({u or 1})" for u in map(str, units))
            )
        self.extra_ports = {
            **{
                n: Input(each.shape, unit=shared or each.unit, frame=shared)
                for n, each in inputs.items()
            },
            "y": Output(
                shape,
                unit=INFERRED if keeps else result,
                frame=INFERRED if keeps else None,
            ),
        }
        self.computes = known, [*inputs], [number.tolist() for number in numbers]
        super().__init__(**dict(zip(["constant"], numbers, strict=False)))
        # The ports above infer their unit, so a declared one is fixed
        # here, for all of them.
        if shared and units[0] not in (None, INFERRED):
            self.port("u1" if "u1" in inputs else "u2").inferable_unit.fix(
                units[0], call_site(), own=True
            )
        # With an array as constant, the open shape of the signal must be its shape.
        if shape is INFERRED and numbers and numbers[0].ndim:
            self.inferred_shape.fix(numbers[0].shape, call_site(), own=True)

    @property
    def _symbol(self) -> Symbol:
        name, single = self.function.__name__, len(self.inputs()) == 1
        if self.function is np.multiply:
            return (
                Symbol("{constant}", outline="triangle")
                if single
                else Symbol("×", outline="circle")
            )
        operands = [
            "u" * single or each if each in self.ports else "{constant}"
            for each in ("u1", "u2")[: self.function.nin]
        ]
        if name in SIGNS:
            return Symbol(f" {SIGNS[name]} ".join(operands))
        return Symbol(f"{name}({', '.join(operands)})")

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the function of the operands."""
        operands = [
            u.get(f"u{i}", p.get("constant")) for i in range(1, self.function.nin + 1)
        ]
        result = self.function(*operands)
        truth = self.function in COMPARISONS or self.function.__name__.startswith(
            "logical"
        )
        return {"y": np.where(result, 1.0, 0.0) if truth else result}


def _shape(function: np.ufunc, shapes: list[Any]) -> Shape:
    """Return the shape of the result of a function for arrays of these shapes; `INFERRED` if one is open."""
    if INFERRED in shapes:
        # Elementwise functions keep the shape; matmul has a signature, and its result
        # depends on both shapes.
        if function.signature is None:
            return INFERRED
        raise BlockError(
            f"'{function.__name__}' needs operands of known shape: connect them first"
        )
    try:
        # NumPy applies its own rules of broadcasting, or raises.
        found: tuple[int, ...] = np.shape(
            function(*(np.ones(as_shape("Operation", s)) for s in shapes))
        )
        return found
    except ValueError as error:
        raise BlockError(
            f"'{function.__name__}' of shapes {' and '.join(map(str, shapes))}: {error}"
        ) from None


def operation(function: np.ufunc, operands: Sequence[Any]) -> Sum | Operation:
    """Return the block that applies a `function` to the `operands`, ports and numbers.

    Raises
    ------
    BlockError
        If an operand is a bool, such as the result of ``a == b`` for ports.
    """
    if any(isinstance(each, bool | np.bool_) for each in operands):
        raise BlockError(
            "True and False are not signals. `==` and `!=` compare the ports themselves; "
            "write np.equal(a, b) or np.not_equal(a, b) to compare their signals"
        )
    if function in SUM_SIGNS and all(isinstance(each, Port) for each in operands):
        return Sum(SUM_SIGNS[function])
    shapes = [port.shape for port in operands if isinstance(port, Port)]

    def declared(port: Port) -> Input:
        shape = (
            INFERRED
            if port.shape is None or (None in shapes and port.shape)
            else port.shape
        )
        # A function of a vector with different units has no unit.
        units = {port.unit} if port.shape is None else {*port.element_units()}
        return Input(shape, unit=units.pop() if len(units) == 1 else None)

    return Operation(
        function,
        *(declared(each) if isinstance(each, Port) else each for each in operands),
    )

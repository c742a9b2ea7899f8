"""What port arithmetic builds: sum junctions, and one block for all other operations of NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.call_site import call_site
from trussflow.blocks.framework.declarations import Parameter, Signals
from trussflow.blocks.framework.errors import BlockError
from trussflow.blocks.framework.port import INFERRED, Input, Output, Port, Shape
from trussflow.blocks.framework.types import Array
from trussflow.blocks.framework.validation import as_shape, finite_array, one_sign_each, shown

SYMBOLS: dict[str, np.ufunc] = {
    **{"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "**": np.power, "@": np.matmul},
    **{"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal},
    **{"==": np.equal, "!=": np.not_equal, "and": np.logical_and, "or": np.logical_or},
    **{"xor": np.logical_xor, "not": np.logical_not, "min": np.minimum, "max": np.maximum},
}
"""NumPy's functions by what people write for them."""

SIGNS = {np.add: "++", np.subtract: "+-", np.negative: "-"}
"""The operations that are sum junctions where no number takes part."""

KEEPS = (*SIGNS, np.maximum, np.minimum, np.absolute, np.hypot, np.remainder, np.rint)
"""Operations on signals of one unit that give a signal of that unit."""

COMPARES = (np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal)
"""Operations on signals of one unit that give 0 or 1."""

UNITS = {np.multiply: "{}*{}", np.divide: "{}/{}", np.sqrt: "{}**0.5", np.square: "{}**2"}
"""Units of what others give, where each operand has one."""


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
        If `signs` holds anything else.
    """

    y = Output(INFERRED, unit=INFERRED, frame=INFERRED, meaning="signed sum of the inputs")

    def __init__(self, signs: str = "++") -> None:
        one_sign_each("Sum", signs, "+-", "signs such as '++-'")
        self.signs = self.computes = signs
        self.extra_ports = {
            f"u{i}": Input(INFERRED, unit=INFERRED, frame=INFERRED, meaning=f"counts {sign}")
            for i, sign in enumerate(signs, 1)
        }
        super().__init__()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the signed sum."""
        total = u.u1 if self.signs[0] == "+" else -u.u1
        for i, sign in enumerate(self.signs[1:], 2):
            total = total + u[f"u{i}"] if sign == "+" else total - u[f"u{i}"]
        return {"y": total}


class Operation(Block):
    r"""Compute with one or two signals as NumPy does: :math:`y = f(u_1, u_2)`.

    Port arithmetic builds it: ``(2.0 * a.y / b.y) >> c.u``, ``M @ a.y``, ``a.y > 1.0``, ``np.sin(a.y)``.
    What compares, and logic, gives 0 or 1. Shapes broadcast as in NumPy.

    Parameters
    ----------
    function : str or numpy.ufunc
        One of ``+ - * / ** @ < <= > >= == != and or xor not min max``, or a function of NumPy that works
        element by element.
    *operands : Input or array_like
        In order: for each signal an `Input`, named ``u1`` or ``u2`` by its place. One of two may be a number
        or an array instead, the parameter ``constant`` [as the other operand, or none]. By default all are
        signals of one shape, as the wires say.

    Raises
    ------
    BlockError
        If there is no such function, or the operands do not fit it.
    ParameterError
        If the constant is not numeric.

    Examples
    --------
    >>> from trussflow.blocks import Input, Operation
    >>> Operation(">", Input(3, unit="m"), 0.5).u1
    <input 'Operation.u1' (shape (3,), unit m)>
    """

    def __init__(self, function: str | np.ufunc, *operands: Input | npt.ArrayLike) -> None:
        known = SYMBOLS.get(function) if isinstance(function, str) else function
        if not isinstance(known, np.ufunc) or known.nout != 1 or known.nin > 2:
            raise BlockError(
                f"Operation knows no {shown(function)}; give one of {' '.join(SYMBOLS)}, or a function of "
                "NumPy that takes one or two arrays. For all else there is Function"
            )
        self.function, given = known, operands or (Input(INFERRED),) * known.nin
        inputs = {f"u{i}": each for i, each in enumerate(given, 1) if isinstance(each, Input)}
        if len(given) != known.nin or not inputs:
            raise BlockError(
                f"Operation '{known.__name__}' takes {known.nin} operands, at least one of them an "
                f"Input(...), not {shown(operands)}"
            )
        numbers = [
            finite_array("what is computed with", each) for each in given if not isinstance(each, Input)
        ]
        if numbers:
            self._declared = {"constant": Parameter(shape=None, meaning="the number among the operands")}
        shape = _shape(known, [each.shape if isinstance(each, Input) else numbers[0].shape for each in given])
        keeps = known in KEEPS or (known is np.multiply and bool(numbers))
        keeps = keeps or (known is np.divide and "u2" not in inputs)
        shared = INFERRED if keeps or known in COMPARES else None
        units = [each.unit for each in inputs.values()]
        result = None
        if known in UNITS and not numbers and all(isinstance(unit, str) for unit in units):
            result = UNITS[known].format(*(u if u.isalnum() else f"({u or 1})" for u in map(str, units)))
        self.extra_ports = {
            **{n: Input(each.shape, unit=shared or each.unit, frame=shared) for n, each in inputs.items()},
            "y": Output(shape, unit=INFERRED if keeps else result, frame=INFERRED if keeps else None),
        }
        self.computes = known, [*inputs], [number.tolist() for number in numbers]
        super().__init__(**dict(zip(["constant"], numbers, strict=False)))
        if shared and units[0] not in (None, INFERRED):
            self.port("u1" if "u1" in inputs else "u2").inferable_unit.fix(units[0], call_site(), own=True)
        if shape is INFERRED and numbers and numbers[0].ndim:
            self.inferred_shape.fix(numbers[0].shape, call_site(), own=True)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return what the function makes of the operands."""
        operands = [u.get(f"u{i}", p.get("constant")) for i in range(1, self.function.nin + 1)]
        result = self.function(*operands)
        truth = self.function in COMPARES or self.function.__name__.startswith("logical")
        return {"y": np.where(result, 1.0, 0.0) if truth else result}


def _shape(function: np.ufunc, shapes: list[Any]) -> Shape:
    """Return the shape of the result of a function of arrays of these shapes, some of them open."""
    if INFERRED in shapes:
        if function.signature is None:
            return INFERRED
        raise BlockError(f"'{function.__name__}' needs operands of known shape: wire them first")
    try:
        found: tuple[int, ...] = np.shape(function(*(np.ones(as_shape("Operation", s)) for s in shapes)))
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
        If an operand is a bool, as ``a == b`` of ports gives it.
    """
    if any(isinstance(each, bool | np.bool_) for each in operands):
        raise BlockError(
            "True and False are not signals. `==` and `!=` compare the ports themselves; "
            "write np.equal(a, b) or np.not_equal(a, b) to compare their signals"
        )
    if function in SIGNS and all(isinstance(each, Port) for each in operands):
        return Sum(SIGNS[function])
    shapes = [port.shape for port in operands if isinstance(port, Port)]

    def declared(port: Port) -> Input:
        shape = INFERRED if port.shape is None or (None in shapes and port.shape) else port.shape
        units = {port.unit} if port.shape is None else {*port.element_units()}
        return Input(shape, unit=units.pop() if len(units) == 1 else None)

    return Operation(function, *(declared(each) if isinstance(each, Port) else each for each in operands))

"""Signal operators: arithmetic with ports and blocks, which adds a block for each operation."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.errors import WiringError
from trussflow.blocks.support.call_site import call_site

if TYPE_CHECKING:
    from trussflow.blocks.framework.diagram import Diagram
    from trussflow.blocks.framework.port import Port


def _of(function: np.ufunc, *, swapped: bool = False) -> Callable[..., Port]:
    """Return the operator that adds the block of a `function`, with its operands in order or `swapped`."""

    def operator(*operands: Any) -> Port:
        # Python calls b.__radd__(a) for a + b if a is a number.
        given = operands[::-1] if swapped else operands
        found: Port = (
            operands[0]
            .wiring_diagram()
            .add_operation(function, given, where=call_site())
        )
        return found

    return operator


class Wired:
    """Base of ports and blocks: Python's operators, and NumPy's functions of one or two arrays.

    An operator on a block uses its only output.
    """

    __slots__ = ()

    def wiring_diagram(self) -> Diagram:
        """Return the diagram in which the port or block can be connected."""
        raise NotImplementedError

    def _refused(self, *_others: Any, **_more: Any) -> Any:
        what, name = type(self).__name__, getattr(self, "path", "")
        raise WiringError(
            f"cannot compute with the {what} '{name}' in this way: it is not a number   [{call_site()}]\n  "
            "connections are source >> target; a + b, 2 * a, a / b, M @ a, a[0:3], a > 1 and functions of "
            "NumPy such as np.sin(a) add a block; for other operations use Function, or @as_block"
        )

    # Otherwise Python or NumPy would report an unrelated TypeError, or
    # build an object array.
    __lshift__ = __rlshift__ = __float__ = __int__ = __array_function__ = _refused

    __add__, __radd__ = _of(np.add), _of(np.add, swapped=True)
    __sub__, __rsub__ = _of(np.subtract), _of(np.subtract, swapped=True)
    __mul__, __rmul__ = _of(np.multiply), _of(np.multiply, swapped=True)
    __truediv__, __rtruediv__ = _of(np.divide), _of(np.divide, swapped=True)
    __matmul__, __rmatmul__ = _of(np.matmul), _of(np.matmul, swapped=True)
    __pow__, __rpow__ = _of(np.power), _of(np.power, swapped=True)
    __mod__, __rmod__ = _of(np.remainder), _of(np.remainder, swapped=True)
    __floordiv__, __rfloordiv__ = (
        _of(np.floor_divide),
        _of(np.floor_divide, swapped=True),
    )
    __and__, __rand__ = _of(np.logical_and), _of(np.logical_and, swapped=True)
    __or__, __ror__ = _of(np.logical_or), _of(np.logical_or, swapped=True)
    # Not == and !=: ports are compared by identity, which sets and dictionaries need.
    __lt__, __le__, __gt__, __ge__ = map(
        _of, (np.less, np.less_equal, np.greater, np.greater_equal)
    )
    __neg__, __abs__, __invert__ = map(_of, (np.negative, np.absolute, np.logical_not))

    def __array_ufunc__(
        self, function: np.ufunc, method: str, *operands: Any, **more: Any
    ) -> Any:
        """Add the block of a function of NumPy; an array on the left of ``>>`` raises `WiringError`."""
        # NumPy handles `array >> port` itself, before Python calls __rrshift__.
        if function is np.right_shift:
            return getattr(self, "__rrshift__", self._refused)(operands[0])
        if method != "__call__" or more or function.nout != 1 or function.nin > 2:
            return self._refused()
        return self.wiring_diagram().add_operation(
            function, operands, where=call_site()
        )

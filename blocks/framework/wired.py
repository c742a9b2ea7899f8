"""What is wired, ports and blocks, is no number: operators that mean nothing say what to do."""

from __future__ import annotations

from typing import Any

import numpy as np

from trussflow.blocks.framework.call_site import call_site
from trussflow.blocks.framework.errors import WiringError


class Wired:
    """Base of ports and blocks: it refuses all operators; those that mean something are overridden."""

    __slots__ = ()

    def _no_sum(self, *_others: Any, **_more: Any) -> Any:
        what, name = type(self).__name__, getattr(self, "path", "")
        raise WiringError(
            f"cannot compute with the {what} '{name}': it is no number   [{call_site()}]\n  wires are "
            "source >> target, sums and differences port + port and port - port, parts port[0:3], with ports "
            "such as block.y; for all else use a block: Gain, MatrixGain, Product, Function"
        )

    __add__ = __radd__ = __sub__ = __rsub__ = __neg__ = __getitem__ = __lshift__ = __rlshift__ = _no_sum
    __mul__ = __rmul__ = __truediv__ = __rtruediv__ = __matmul__ = __rmatmul__ = __pow__ = __rpow__ = _no_sum
    __mod__ = __rmod__ = __floordiv__ = __rfloordiv__ = __and__ = __rand__ = __or__ = __ror__ = _no_sum
    __lt__ = __le__ = __gt__ = __ge__ = __abs__ = __float__ = __int__ = _no_sum

    def __array_ufunc__(self, function: np.ufunc, _method: str, first: Any, *others: Any, **more: Any) -> Any:
        """Refuse NumPy's functions; an array on the left of a wire is refused as a number is there."""
        rshift = getattr(self, "__rrshift__", self._no_sum)
        return rshift(first) if function is np.right_shift else self._no_sum(first, *others, **more)

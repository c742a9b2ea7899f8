"""Python functions as blocks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array
from trussflow.blocks.library.signals import declared_ports, named_results


class PythonFunction(Block):
    """Call any Python function at each sample and hold what it returns.

    The function is called as it is, never traced, so it may use ``if``, libraries, files.
    It costs some microseconds for each sample, and the diagram cannot become C code. It
    should keep nothing between calls: a second run would start from there.

    Parameters
    ----------
    function : callable
        Takes the inputs in order of declaration, as NumPy arrays, and returns one array, or
        a tuple of arrays where there are several outputs.
    sample_time : float
        Time between calls [s].
    inputs, outputs : mapping of str to Input or Output
        The ports.
    offset : float
        First call [s]; the outputs are zero before.

    Raises
    ------
    BlockError
        If ports or sample time are wrong, or the function returns something else.
    """

    traced: ClassVar[bool] = False

    def __init__(
        self,
        function: Callable[..., Any],
        sample_time: float,
        *,
        inputs: Mapping[str, Input],
        outputs: Mapping[str, Output],
        offset: float = 0.0,
    ) -> None:
        self._function = function
        self.extra_ports = declared_ports("PythonFunction", inputs, outputs)
        super().__init__()
        self.sampled(sample_time, offset)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return what the function returns."""
        results = self._function(*(u[port.name] for port in self.inputs()))
        return named_results(f"'{self.path}'", [port.name for port in self.outputs()], results)

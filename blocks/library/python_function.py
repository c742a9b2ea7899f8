"""Python functions as blocks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.library.signals import WrappedFunction


class PythonFunction(WrappedFunction):
    """Call any Python function at each sample and hold what it returns.

    The function is called as it is, never traced, so it may use ``if``, libraries, files.
    It costs some microseconds for each sample, and the diagram cannot become C code. It
    should keep nothing between calls: a second run would start from there. What needs memory that is
    fresh in each run is a block with states, or one whose `open` returns a `Running`.

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
        super().__init__(function, inputs, outputs)
        self.sampled(sample_time, offset)

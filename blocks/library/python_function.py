"""Python functions as blocks."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import update_wrapper
from typing import Any, ClassVar

import numpy as np

from trussflow.blocks.errors import BlockError, Explained, WiringError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.port import INFERRED, Input, Output, is_port
from trussflow.blocks.library.algebra import Function
from trussflow.blocks.library.signals import WrappedFunction
from trussflow.blocks.support.call_site import call_site
from trussflow.blocks.support.validation import shown


class PythonFunction(WrappedFunction):
    """Call any Python function, at each sample with a held result, or in continuous time.

    The function is not traced, so it may use ``if``, libraries and files. A call takes some microseconds,
    and the diagram cannot become C code. In continuous time, the function is called at every stage of the
    solver, four times in a step of RK4. Steps are then taken in Python: some 100 µs each, compared with
    less than 1 µs for a small compiled diagram. The function should have no internal state, which a
    second run would not reset. For internal state, use a block with states, or a block whose `open` returns a
    `Running`.

    Parameters
    ----------
    function : callable
        Takes the inputs in order of declaration, as NumPy arrays, and returns one array, or
        a tuple of arrays if there are several outputs.
    sample_time : float, optional
        Time between calls [s]; by default the function computes in continuous time.
    inputs, outputs : mapping of str to Input or Output
        The ports.
    offset : float
        First call [s], of a sampled one; the outputs are zero before.

    Raises
    ------
    BlockError
        If ports or sample time are wrong, or the function returns something else.
    """

    traced: ClassVar[bool] = False

    def __init__(
        self,
        function: Callable[..., Any],
        sample_time: float | None = None,
        *,
        inputs: Mapping[str, Input],
        outputs: Mapping[str, Output],
        offset: float = 0.0,
    ) -> None:
        super().__init__(function, inputs, outputs)
        if sample_time is not None or offset:
            # NaN makes `sampled` raise its error, as an offset needs a sample time.
            self.sampled(math.nan if sample_time is None else sample_time, offset)


def as_block(
    function: Any = None,
    *,
    traced: bool = True,
    sample_time: float | None = None,
    **ports: Input | Output,
) -> Any:
    """Convert a function to a constructor of blocks: a decorator.

    The decorated function returns a block. If it is called with ports, or with blocks that have one output,
    it adds the block to their diagram and connects them to its inputs in order:
    ``law(sensor.y, 2.0 * b.y) >> motor.u``.

    Parameters
    ----------
    function : callable
        Takes the inputs in order and returns one array, or a tuple of arrays, as for `Function`.
    traced : bool
        Whether the block is a `Function`, which is traced, or a `PythonFunction`.
    sample_time : float, optional
        Time between calls [s]; by default the block is continuous.
    **ports : Input or Output
        Declarations of the inputs, by the names of the arguments, and of the outputs. The default output is
        ``y``, or ``value`` if an argument is y. Default shapes are those of the ports in the call. Shapes
        that are still open are equal, and inferred from the wires.

    Returns
    -------
    callable
        Returns a new block at each call.

    Raises
    ------
    BlockError
        If the ports are declared wrongly.

    Examples
    --------
    >>> import numpy as np
    >>> from trussflow.blocks import Constant, Diagram, Input, Output, as_block
    >>> @as_block(force=Input(3, unit="N"), velocity=Input(3, unit="m/s"), power=Output(unit="W"))
    ... def power(force, velocity):
    ...     return force @ velocity
    >>> diagram = Diagram("power")
    >>> f, v = diagram.add(f=Constant([1.0, 2.0, 3.0], unit="N"), v=Constant(np.ones(3), unit="m/s"))
    >>> power(f, v).power
    <output 'power_1.power' (shape (), unit W)>
    """
    if function is None:
        settings: dict[str, Any] = {
            "traced": traced,
            "sample_time": sample_time,
            **ports,
        }
        return lambda function: as_block(function, **settings)
    if not callable(function):
        raise BlockError(
            f"as_block makes blocks of functions, not of {shown(function)}"
        )
    arguments, name = (
        inspect.signature(function).parameters.values(),
        getattr(function, "__name__", ""),
    )
    name = name if name.isidentifier() else "function"
    # Arguments with a default value keep it, unless a port is declared for them.
    inputs = {a.name: Input(INFERRED) for a in arguments if a.default is a.empty}
    inputs |= {
        name: port for name, port in ports.items() if not isinstance(port, Output)
    }
    outputs = {
        name: port for name, port in ports.items() if isinstance(port, Output)
    } or {"value" if "y" in inputs else "y": Output(INFERRED)}

    def new(*sources: Any) -> WrappedFunction:
        given = [
            each.only_output() if isinstance(each, Block) else each for each in sources
        ]
        if given and (len(given) != len(inputs) or not all(map(is_port, given))):
            raise WiringError(
                f"{name} takes {len(inputs)} ports ({', '.join(inputs)}), or none, not {shown(sources)}   "
                f"[{call_site()}]\n  wire a constant with the block Constant(value)"
            )
        if not traced:
            block: WrappedFunction = PythonFunction(
                function, sample_time, inputs=inputs, outputs=outputs
            )
        else:
            shapes = [port.shape for port in given if port.shape is not None]
            # With all input shapes known, one call gives the shape of the output.
            # Otherwise, all open shapes are inferred as equal.
            known = given and not ports and len(shapes) == len(given)
            block = Function(
                function,
                *(_declared(function, inputs, shapes) if known else (inputs, outputs)),
            )
            if sample_time is not None:
                block.sampled(sample_time)
        if given:
            given[0].wiring_diagram().add_wired(
                name, block, dict(zip(inputs, given, strict=True)), where=call_site()
            )
        return block

    made = update_wrapper(new, function)
    function.__qualname__ += ".__wrapped__"  # the name under which pickle finds it
    return made


def _declared(
    function: Callable[..., Any],
    names: Iterable[str],
    shapes: Sequence[tuple[int, ...]],
) -> tuple[dict[str, Input], dict[str, Output]]:
    """Return the ports of a function of arrays of these shapes; a call gives the shape of the output."""
    some = np.random.default_rng(0).random  # arrays of ones would be singular matrices
    with (
        np.errstate(all="ignore"),
        Explained(
            lambda error: BlockError(
                f"{function.__name__} of arrays of shapes {shapes}: {error}"
            )
        ),
    ):
        result = np.shape(function(*(np.asarray(some(shape)) for shape in shapes)))
    inputs = dict(zip(names, map(Input, shapes), strict=True))
    return inputs, {"value" if "y" in inputs else "y": Output(result)}

"""Base classes of library blocks: signals of one shape, wrapped functions; units of rates."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError, ParameterError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.symbol import Symbol, equations, wrapped
from trussflow.blocks.framework.units import Unit, check_declared
from trussflow.blocks.support.call_site import call_site
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import as_shape, by_name, shown

ShapeLike = int | tuple[int, ...] | None
"""A size, a shape, or None for a shape inferred from the wires."""


class Shaped(Block):
    """Base of blocks whose signals have one shape: that of the parameters, or that of the wires.

    Parameters
    ----------
    shape : int, tuple of int or None
        Shape from the user; None takes it from the parameters, or else from the wires.
    **parameters : array_like
        Parameters of the block; those that are not scalars have one value per element.

    Raises
    ------
    ParameterError
        If the shape of a parameter differs from that of the user, or of another parameter.
    """

    def __init__(self, shape: ShapeLike = None, **parameters: object) -> None:
        super().__init__(**parameters)
        wanted = None if shape is None else as_shape(type(self).__name__, shape)
        said_by = "the argument 'shape'"
        for name, value in self.parameters.items():
            if not value.ndim:
                continue
            if wanted is not None and value.shape != wanted:
                raise ParameterError(
                    f"parameter '{name}' of {type(self).__name__} has shape {value.shape}, but "
                    f"{said_by} is {wanted}; give one value for all elements, or one for each"
                )
            wanted, said_by = value.shape, f"the shape of parameter '{name}'"
        if wanted is not None:
            self.inferred_shape.fix(wanted, call_site(), own=True)

    def check_parameters(self, p: Signals) -> None:
        """Check that no element of a parameter ``lower`` exceeds that of ``upper``, if there are these."""
        if not {"lower", "upper"} <= p.keys():
            return
        if p.lower.shape and p.upper.shape and p.lower.shape != p.upper.shape:
            # They cannot be compared here; the check of the shapes reports the error.
            return  # refused by shape
        if np.any(p.lower > p.upper):
            raise ParameterError(
                f"parameter 'lower' of {p.owner} is {p.lower.tolist()}, but 'upper' is "
                f"{p.upper.tolist()}; the lower limit must not exceed the upper one"
            )


def per_time(unit: Unit, power: int = 1) -> Unit:
    """Return the unit of a time derivative.

    Parameters
    ----------
    unit : str, tuple of str or None
        Unit of the quantity, or one per element.
    power : int
        Order of the time derivative [-].

    Examples
    --------
    >>> per_time(("m", "rad"), 2)
    ('m/s**2', 'rad/s**2')
    """
    check_declared("a signal", unit)
    if unit is None:
        return None
    time = "s" if power == 1 else f"s**{power}"
    rates = tuple(
        # An element without unit is dimensionless, and its rate is in 1/s.
        f"{each or '1'}/{time}"
        for each in (unit if isinstance(unit, tuple) else (unit,))
    )
    return rates if isinstance(unit, tuple) else rates[0]


VELOCITY_UNIT, ACCELERATION_UNIT = (
    Attribute("velocity_unit"),
    Attribute("acceleration_unit"),
)
"""Units of ports, which `set_motion_units` sets."""


def set_motion_units(block: Block, unit: Unit) -> None:
    """Set the attributes of a block with the units of a position and its rates, to which ports refer.

    Parameters
    ----------
    block : Block
        The block, before it is constructed.
    unit : str, tuple of str or None
        Unit of the position, or one per element.
    """
    block.unit, block.velocity_unit, block.acceleration_unit = (
        unit,
        per_time(unit),
        per_time(unit, 2),
    )


class WrappedFunction(Block):
    """Base of blocks that call a function.

    Parameters
    ----------
    function : callable
        Takes the inputs in order of declaration and returns one array, or a tuple of arrays
        if there are several outputs.
    inputs, outputs : mapping of str to Input or Output
        The ports.

    Raises
    ------
    BlockError
        If there is no output, two ports have the same name, a declaration is not a port, or the function
        has another number of arguments.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        inputs: Mapping[str, Input],
        outputs: Mapping[str, Output],
    ) -> None:
        owner = type(self).__name__
        if not callable(function):
            raise BlockError(
                f"{owner} needs a function that it can call, not {shown(function)}"
            )
        inputs, outputs = (
            by_name(f"ports of {owner}", declared) for declared in (inputs, outputs)
        )
        for kind, declared in ((Input, inputs), (Output, outputs)):
            for name, port in declared.items():
                if not isinstance(port, kind):
                    what = f"{kind.__name__.lower()} '{name}' must be an {kind.__name__}(...)"
                    raise BlockError(f"{owner}: {what}, not {shown(port)}")
        if both := sorted(set(inputs) & set(outputs)):
            raise BlockError(
                f"{owner}: '{both[0]}' is declared as an input and as an output"
            )
        if not outputs:
            raise BlockError(f"{owner} needs at least one output")
        self._function = function
        self._names = tuple(inputs), tuple(outputs)
        self.extra_ports = {**inputs, **outputs}
        super().__init__()
        try:
            # The number of arguments is checked here, with the line of the user's
            # function, before a run calls it.
            inspect.signature(function).bind(*inputs)
        except TypeError as error:
            raise BlockError(
                f"{owner}: the function {_described(function)} is called with the inputs, "
                f"({', '.join(inputs)}): {error}; time is no argument, and inputs= declares more inputs"
            ) from None
        except ValueError:  # a function of NumPy without a signature
            pass

    @property
    def _symbol(self) -> Symbol:
        name = getattr(self._function, "__name__", "f").replace("<lambda>", "f")
        call = f"{name}({', '.join(port.name for port in self.inputs())})"
        return Symbol("\n".join(equations(self._function) or wrapped(call)))

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the results of the function by output."""
        arguments, names = self._names
        results = self._function(*(u[name] for name in arguments))
        if len(names) == 1:
            return {names[0]: results}
        if not isinstance(results, tuple) or len(results) != len(names):
            got = (
                f"{len(results)}"
                if isinstance(results, tuple)
                else f"one {type(results).__name__}"
            )
            raise BlockError(
                f"the function of '{self.path}' must return a tuple of {len(names)} arrays, for: "
                f"{', '.join(names)}; it returned {got}"
            )
        return dict(zip(names, results, strict=True))


def _described(function: Callable[..., Any]) -> str:
    """Return the name of a function, and its file and line."""
    name, code = (
        getattr(function, "__name__", repr(function)),
        getattr(function, "__code__", None),
    )
    return (
        name if code is None else f"{name} ({code.co_filename}:{code.co_firstlineno})"
    )


def structural(
    owner: str,
    name: str,
    value: npt.ArrayLike,
    shape: tuple[int, ...] = (),
    **bounds: Any,
) -> Vector:
    """Return a checked number or array that determines the structure of a block, so is no parameter.

    Parameters
    ----------
    owner, name : str
        Names of the block and of the value, for messages.
    value : array_like
        Value from the user [any].
    shape : tuple of int
        Its shape [-].
    **bounds : float
        Bounds, as for `Parameter` [the same].

    Raises
    ------
    ParameterError
        If it is not a number, not finite, of the wrong shape or out of bounds.
    """
    declaration = Parameter(**bounds)
    declaration.name = name
    return declaration.convert(value, shape, owner)


def finite(owner: str, name: str, value: float, **bounds: Any) -> float:
    """Return a checked structural number; see `structural` for the arguments.

    Parameters
    ----------
    owner, name : str
        Names of the block and of the number.
    value : float
        Value from the user [any].
    **bounds : float
        Bounds [the same].
    """
    return float(structural(owner, name, value, **bounds))

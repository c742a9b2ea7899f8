"""What the library's blocks share: the shape of their signals, and units of rates."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isfinite

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.errors import BlockError, ParameterError
from trussflow.blocks.framework.port import Input, Output, call_site
from trussflow.blocks.framework.types import Array
from trussflow.blocks.framework.units import Unit

ShapeLike = int | tuple[int, ...] | None
"""A size, a shape, or None where wires decide."""


def as_shape(shape: int | tuple[int, ...]) -> tuple[int, ...]:
    """Return a size as a shape."""
    return tuple(shape) if isinstance(shape, tuple) else (shape,)


def settle_shape(block: Block, shape: ShapeLike = None) -> None:
    """Fix the inferred shape of a block, if the user or a parameter says what it is.

    Parameters
    ----------
    block : Block
        The block, constructed. Its parameters that are not scalars have one value per element.
    shape : int, tuple of int or None
        What the user asked for; None leaves it to the parameters, or else to the wires.

    Raises
    ------
    ParameterError
        If a parameter has another shape than the user, or another parameter, says.
    """
    wanted = None if shape is None else as_shape(shape)
    said_by = "the shape asked for"
    for name, value in block.parameters.items():
        if not value.ndim:
            continue
        if wanted is not None and value.shape != wanted:
            raise ParameterError(
                f"parameter '{name}' of {type(block).__name__} has shape {value.shape}, but "
                f"{said_by} is {wanted}; give one value for all elements, or one for each"
            )
        wanted, said_by = value.shape, f"the shape of parameter '{name}'"
    if wanted is not None:
        block.inferred_shape.fix(wanted, call_site())


def per_time(unit: Unit, power: int = 1) -> Unit:
    """Return the unit of a time derivative.

    Parameters
    ----------
    unit : str, tuple of str or None
        Unit of the quantity, or one per element.
    power : int
        How often it is derived.

    Examples
    --------
    >>> per_time(("m", "rad"), 2)
    ('m/s**2', 'rad/s**2')
    """
    if unit is None:
        return None
    if isinstance(unit, tuple):
        return tuple(_per_time(u, power) for u in unit)
    return _per_time(unit, power)


def _per_time(unit: str, power: int) -> str:
    return f"{unit or '1'}/s" if power == 1 else f"{unit or '1'}/s**{power}"


def declared_ports(
    owner: str, inputs: Mapping[str, Input], outputs: Mapping[str, Output]
) -> dict[str, Input | Output]:
    """Return the ports of a block that wraps a function, checked.

    Parameters
    ----------
    owner : str
        What the block is called in error messages.
    inputs, outputs : dict
        What the user declares, by name.

    Raises
    ------
    BlockError
        If there is no output, a name stands for two ports, or something else is declared.
    """
    for kind, declared in ((Input, inputs), (Output, outputs)):
        for name, port in declared.items():
            if not isinstance(port, kind):
                what = f"{kind.__name__.lower()} '{name}' must be an {kind.__name__}(...)"
                raise BlockError(f"{owner}: {what}, not {port!r}")
    if both := sorted(set(inputs) & set(outputs)):
        raise BlockError(f"{owner}: '{both[0]}' is declared as an input and as an output")
    if not outputs:
        raise BlockError(f"{owner} needs at least one output")
    return {**inputs, **outputs}


def named_results(owner: str, names: list[str], results: Array | tuple[Array, ...]) -> Values:
    """Return by port name what a wrapped function returned: one array, or a tuple of them.

    Parameters
    ----------
    owner : str
        What the block is called in error messages.
    names : list of str
        The output ports, in order.
    results : Array, or tuple of Array
        What the function returned: one array if there is one output.

    Raises
    ------
    BlockError
        If there are not as many results as outputs.
    """
    if len(names) == 1:
        return {names[0]: results}
    if not isinstance(results, tuple) or len(results) != len(names):
        got = f"{len(results)}" if isinstance(results, tuple) else f"one {type(results).__name__}"
        raise BlockError(
            f"the function of {owner} must return a tuple of {len(names)} arrays, for: "
            f"{', '.join(names)}; it returned {got}"
        )
    return dict(zip(names, results, strict=True))


def finite(owner: str, name: str, value: float, above: float = -inf) -> float:
    """Return a structural number, checked as parameters are.

    Parameters
    ----------
    owner : str
        What the block is called in error messages.
    name : str
        What the number is called.
    value : float
        What the user gives [any].
    above : float
        What it must be greater than [the same].

    Raises
    ------
    BlockError
        If it is no finite number above the bound.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise BlockError(f"{owner} needs a number as '{name}', not {value!r}") from None
    if not (isfinite(number) and number > above):
        bound = "" if above == -inf else f" and above {above:g}"
        raise BlockError(f"{owner} cannot have {name} = {value}; it must be finite{bound}")
    return number

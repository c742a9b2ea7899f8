"""Units of measurement: pint decides what fits what."""

from __future__ import annotations

from functools import cache
from tokenize import TokenError
from typing import TYPE_CHECKING

from trussflow.blocks.framework.errors import BlockError

if TYPE_CHECKING:
    import pint

Unit = str | tuple[str, ...] | None
"""One unit for all elements, one unit per element, or None: not stated, fits everything."""


@cache
def _registry() -> pint.UnitRegistry[float]:
    """Return the one registry; imported late because most wires have equal unit strings."""
    import pint

    return pint.UnitRegistry()


@cache
def parse(unit: str) -> pint.Unit:
    """Return the pint unit of a string such as ``"N*m"``; ``""`` and ``"1"`` are dimensionless.

    Raises
    ------
    BlockError
        If pint does not know the unit, or cannot read the string.
    """
    import pint

    registry = _registry()
    # What pint raises for "foo", "3 m", "m**s", "m/", "1/0" and "(", in that order.
    bad = pint.PintError, ValueError, TypeError, AssertionError, ZeroDivisionError, TokenError
    try:
        return registry.Unit("" if unit == "1" else unit)
    except bad as error:
        raise BlockError(f"unknown unit {unit!r}: {str(error) or 'it cannot be read'}") from error


@cache
def mismatch(first: str, second: str) -> str:
    """Say why two units do not fit; an empty string means that they do.

    Examples
    --------
    >>> mismatch("m", "N")
    "unit 'm' does not fit 'N'"
    >>> mismatch("N*m", "m*N")
    ''
    """
    if first == second:
        return ""
    try:
        a, b = parse(first), parse(second)
    except BlockError as error:
        return str(error)
    if a.dimensionality != b.dimensionality:
        return f"unit {first!r} does not fit {second!r}"
    zero, one = (_registry().Quantity(value, a).to(b).magnitude for value in (0.0, 1.0))
    if zero != 0:
        return f"unit {first!r} has another zero than {second!r}; convert it in a block"
    if abs(one - 1) > 1e-12:  # round-off of the conversion, not a scale
        return f"unit {first!r} is {one:g} {second!r}; insert a Gain with the factor"
    return ""


def per_element(unit: Unit, size: int) -> tuple[str | None, ...]:
    """Return the unit of each of `size` elements that have the `unit`."""
    return tuple(unit) if isinstance(unit, tuple) else (unit,) * size

"""Units in the form of FMI: integer exponents of SI base units, a factor and an offset."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import inf, isclose
from typing import Any

from trussflow.blocks.framework.units import parse

BASE_UNIT_NAMES = {
    "kilogram": "kg",
    "meter": "m",
    "second": "s",
    "ampere": "A",
    "kelvin": "K",
    "mole": "mol",
    "candela": "cd",
    "radian": "rad",
}
"""FMI's names of the base units, by pint's names."""


@dataclass(frozen=True, slots=True)
class FmiUnit:
    """A unit of a model description.

    Attributes
    ----------
    name : str
        Name in the declaration of the block or in the imported FMU.
    exponents : dict or None
        Exponents of the base units by FMI's names. None if the FMU does not state them. Also None if
        FMI cannot express the unit: an exponent is not an integer, or the factor is zero or infinite.
    factor, offset : float
        Value in base units = factor * value + offset [1].
    display : str
        Name of the display unit with degrees instead of radians; empty if there is none.
    """

    name: str
    exponents: dict[str, int] | None = None
    factor: float = 1.0
    offset: float = 0.0
    display: str = ""


@cache
def fmi_unit(name: str) -> FmiUnit:
    """Return the FMI form of a unit.

    Parameters
    ----------
    name : str
        A unit that pint knows.

    Raises
    ------
    BlockError
        If pint does not know the unit.
    """
    unit = parse(name)
    quantity = unit._REGISTRY.Quantity
    try:
        # The images of 0 and 1 give offset and factor, also for degrees Celsius.
        zero, one = (quantity(value, unit).to_base_units() for value in (0.0, 1.0))
    except OverflowError:  # a power of the unit overflows
        return FmiUnit(name)
    # pint allows exponents of any numeric type
    parts: dict[str, Any] = dict(one.unit_items())
    powers = {BASE_UNIT_NAMES.get(n, n): float(e) for n, e in parts.items() if e}
    display = ""
    if dict(quantity(1.0, unit).unit_items()).get("radian") == 1:
        # In this order: else "radian" would become "degian".
        display = name.replace("radian", "deg").replace("rad", "deg")
    factor = float(one.magnitude - zero.magnitude)
    offset = float(zero.magnitude)
    # xs:int
    whole = all(power.is_integer() and abs(power) < 2**31 for power in powers.values())
    if not (
        whole
        and set(powers) <= set(BASE_UNIT_NAMES.values())
        and 0.0 < abs(factor) < inf
    ):
        return FmiUnit(name, None, display=display)
    exponents = {part: int(power) for part, power in powers.items()}
    return FmiUnit(name, exponents, _rounded(factor), offset, display)


def _rounded(factor: float) -> float:
    """Return a factor without the round-off error of the conversion, if it is a simple number."""
    simple = float(f"{factor:.12g}")
    return simple if isclose(simple, factor, rel_tol=1e-14) else factor

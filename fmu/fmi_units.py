"""Units as FMI wants them: whole exponents of SI base units, a factor and an offset."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import inf, isclose, pi
from typing import Any

from trussflow.blocks.framework.units import parse

BASE = {
    "kilogram": "kg",
    "meter": "m",
    "second": "s",
    "ampere": "A",
    "kelvin": "K",
    "mole": "mol",
    "candela": "cd",
    "radian": "rad",
}
"""FMI's names of the base units by those of pint."""


@dataclass(frozen=True, slots=True)
class FmiUnit:
    """A unit as it stands in a model description, of an FMU made here or elsewhere.

    Attributes
    ----------
    name : str
        As the block declares it, or as an imported FMU calls it.
    exponents : dict or None
        Exponents of the base units by FMI's names; None where the FMU does not say, or where they
        are not whole numbers, or the factor is none, which FMI cannot express: the unit then has a name only.
    factor, offset : float
        Value in base units = factor * value + offset [1].
    display : tuple of (str, float)
        Units in which tools may show values, and how many make one of this unit [1].
    """

    name: str
    exponents: dict[str, int] | None = None
    factor: float = 1.0
    offset: float = 0.0
    display: tuple[tuple[str, float], ...] = ()


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
        zero, one = (quantity(value, unit).to_base_units() for value in (0.0, 1.0))
    except OverflowError:  # some power of it is beyond all numbers
        return FmiUnit(name)
    parts: dict[str, Any] = dict(one.unit_items())  # pint allows any kind of number
    powers = {BASE.get(part, part): float(power) for part, power in parts.items() if power}
    display: tuple[tuple[str, float], ...] = ()
    if dict(quantity(1.0, unit).unit_items()).get("radian") == 1:
        display = ((name.replace("radian", "deg").replace("rad", "deg"), 180 / pi),)
    factor, offset = float(one.magnitude - zero.magnitude), float(zero.magnitude)
    whole = all(power.is_integer() and abs(power) < 2**31 for power in powers.values())  # as XML has them
    if not (whole and set(powers) <= set(BASE.values()) and 0.0 < abs(factor) < inf):
        return FmiUnit(name, None, display=display)
    exponents = {part: int(power) for part, power in powers.items()}
    return FmiUnit(name, exponents, _rounded(factor), offset, display)


def _rounded(factor: float) -> float:
    """Take away round-off of the conversion from a factor that is a simple number."""
    simple = float(f"{factor:.12g}")
    return simple if isclose(simple, factor, rel_tol=1e-14) else factor

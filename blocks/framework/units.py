"""Units of measurement, compared by pint."""

from __future__ import annotations

import difflib
import re
from functools import cache
from tokenize import TokenError
from typing import TYPE_CHECKING

from trussflow.blocks.errors import BlockError
from trussflow.blocks.support.validation import shown

if TYPE_CHECKING:
    import pint

COMMON_UNITS = {
    *(
        "m",
        "mm",
        "km",
        "s",
        "ms",
        "min",
        "h",
        "rad",
        "deg",
        "kg",
        "g",
        "N",
        "mN",
        "kN",
        "Pa",
        "kPa",
        "MPa",
    ),
    *("bar", "J", "kJ", "W", "kW", "A", "mA", "V", "mV", "K", "degC", "Hz", "kHz"),
}
"""Units that are recognized without pint, whose import takes a second."""

Unit = str | tuple[str, ...] | None
"""One unit for all elements, one unit per element, or None for an undeclared unit, which fits any other."""


UNIT_SIGNS = {
    r"\*\*": "^",
    r"\^0\.5(?!\d)": "^½",
    r"\^2(?![\d.])": "²",
    r"\^3(?![\d.])": "³",
    r"\^4(?![\d.])": "⁴",
    r"\*": "·",
}
"""Typographic replacements in the string of a unit, by regular expression; the order matters."""


def readable(unit: str) -> str:
    """Return the string of a unit in typographic form: ``"kg**0.5*m/s**2"`` becomes ``"kg^½·m/s²"``."""
    for said, sign in UNIT_SIGNS.items():
        unit = re.sub(said, sign, unit)
    return unit


def distinct(units: str) -> str:
    """Return each unit of a list once, in typographic form: ``"m, m, N*m"`` becomes ``"m, N·m"``."""
    return ", ".join(dict.fromkeys(readable(units).split(", ")))


@cache
def _registry() -> pint.UnitRegistry[float]:
    """Return the registry; pint is imported only when two unit strings differ."""
    import pint

    return pint.UnitRegistry()


@cache
def parse(unit: str) -> pint.Unit:
    """Return the pint unit of a string such as ``"N*m"``; ``""`` and ``"1"`` are dimensionless.

    Raises
    ------
    BlockError
        If pint has no such unit, or cannot parse the string.
    """
    import pint

    registry = _registry()
    # Exceptions of pint for "foo", "3 m", "m**s", "m/", "1/0" and "(", in that order.
    bad = (
        pint.PintError,
        ValueError,
        TypeError,
        AssertionError,
        ZeroDivisionError,
        TokenError,
    )
    try:
        if "Nm" in _names(unit):
            # "Nm" is a unit of textile yarn in pint
            raise ValueError("a newton metre is 'N*m'")
        found = registry.Unit("" if unit == "1" else unit)
        found.dimensionality  # noqa: B018 - raises if a level, such as dB, is in a product
    except bad as error:
        known = [*registry, *COMMON_UNITS]
        close = (
            difflib.get_close_matches(name, known)
            for name in _names(unit)
            if name not in known
        )
        near = dict.fromkeys(n for names in close for n in names)  # without duplicates
        reason = str(error) or "it cannot be parsed"
        if "delta_" in reason:
            reason = "levels such as dB cannot be multiplied or divided; omit the unit"
        hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
        raise BlockError(f"unknown unit {unit!r}: {reason}{hint}") from error
    return found


def _names(unit: str) -> list[str]:
    """Return the words in the string of a unit."""
    # A word begins with a letter, so exponents and factors are left out.
    return re.findall(r"[^\W\d_]\w*", str(unit))


def check_declared(where: str, unit: object) -> None:
    """Check that a declared unit is valid.

    Parameters
    ----------
    where : str
        Name of the declaration, for messages.
    unit : object
        One unit, a tuple of one per element, or None.

    Raises
    ------
    BlockError
        If it is not text, or an unknown unit.
    """
    for one in unit if isinstance(unit, tuple) else (unit,):
        if isinstance(one, str):
            try:
                # Without pint if possible, see COMMON_UNITS.
                if not COMMON_UNITS.issuperset(_names(one)):
                    parse(one)
            except BlockError as error:
                raise BlockError(f"{where}: {error}") from error
        elif one is not None:
            raise BlockError(
                f"{where} has the unit {shown(one)}; a unit is text such as 'N*m', a tuple of such, or None"
            )


@cache
def mismatch(first: str, second: str) -> str:
    """Return the reason why two units do not fit, or an empty text if they do.

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
    # Conversions are affine: two points give offset (degC to K) and factor (km to m).
    zero, one = (_registry().Quantity(value, a).to(b).magnitude for value in (0.0, 1.0))
    if zero != 0:
        return f"unit {first!r} has another zero than {second!r}; convert it in a block"
    if abs(one - 1) > 1e-12:  # round-off of the conversion, not a scale
        return f"unit {first!r} is {one:g} {second!r}; insert a Gain with the factor"
    return ""


def factor(given: str, wanted: str) -> float:
    """Return the factor that converts a number from the unit `given` to the unit `wanted`.

    Raises
    ------
    BlockError
        If the units do not fit, or have different zeros.

    Examples
    --------
    >>> factor("km", "m")
    1000.0
    """
    fault = mismatch(given, wanted)
    # Units that differ by a factor only are converted; other faults are errors.
    if fault and "insert a Gain" not in fault:
        raise BlockError(fault)
    scale: float = _registry().Quantity(1.0, parse(given)).to(parse(wanted)).magnitude
    return scale


def per_element(unit: Unit, size: int) -> tuple[str | None, ...]:
    """Return the unit of each of `size` elements of a port with this `unit`."""
    return tuple(unit) if isinstance(unit, tuple) else (unit,) * size

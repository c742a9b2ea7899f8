"""Conversion of an FMU's unit names to pint's names, checked against the FMU's definitions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import isclose

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.units import parse
from trussflow.fmu.errors import FmuUnitError
from trussflow.fmu.fmi_units import FmiUnit, fmi_unit
from trussflow.fmu.runtime.description import FmuDescription

UNIT_NAMES = {"-": "", "1": "", "Ohm": "ohm", "%": "percent", "°": "deg"}
"""pint's names of units that are common in FMUs under other names."""

POWER_PATTERN = re.compile(r"(?<=[A-Za-z\u00b5\u03bc])\^?(-?\d+)")
"""Pattern of a power in FMI's notation: ``m2`` or ``s-1``."""

PRODUCT_PATTERN = re.compile(r"[.·](?=[^\W\d])")
"""Pattern of a product in FMI's notation: ``N.m``; it excludes the point of ``kg**0.5``."""


class UnitTable:
    """The units of one FMU, by the FMU's names.

    Parameters
    ----------
    description : FmuDescription
        The model description.
    given : mapping of str to (str or None), optional
        The user's definitions: a unit of pint by the FMU's name, or None to disable the check.

    Raises
    ------
    FmuUnitError
        If a name is not a unit of the FMU, or a definition contradicts that of the FMU.
    """

    def __init__(
        self, description: FmuDescription, given: Mapping[str, str | None] | None = None
    ) -> None:
        self._name = description.name
        self._definitions = description.units
        self._known: dict[str, str | None] = {"": None}
        used = {
            v.unit for v in description.variables.values()
        } | description.units.keys()
        for name, unit in (given or {}).items():
            if name not in used:
                listed = ", ".join(sorted(used - {""})) or "none"
                raise FmuUnitError(
                    f"FMU '{self._name}' has no unit '{name}'; its units are: {listed}"
                )
            definition = self._definitions.get(name)
            if unit is not None and definition is not None:
                self._check(unit, definition)
            self._known[name] = unit

    def unit(self, name: str) -> str | None:
        """Return the unit of pint; None if no unit is stated or it is unchecked.

        Parameters
        ----------
        name : str
            The FMU's name of the unit.

        Raises
        ------
        FmuUnitError
            If the unit is unknown to pint and the FMU does not define it, or the two contradict.
        """
        if name not in self._known:
            self._known[name] = self._find(name)
        return self._known[name]

    def _find(self, name: str) -> str:
        definition = self._definitions.get(name)
        ours = spelled(name)
        try:
            found = fmi_unit(ours)
        except BlockError:
            found = None
        if definition is None or definition.exponents is None:
            if found is None:
                raise FmuUnitError(
                    f"FMU '{self._name}' has the unit '{name}', which is unknown and which the FMU does "
                    f"not define; define it with units={{'{name}': '...'}}, or disable its check with "
                    f"units={{'{name}': None}}"
                )
            return ours
        if found is not None and _agree(found, definition):
            return ours
        # A product of SI base units needs no other name: ``kg*m**2``.
        if definition.factor == 1.0 and definition.offset == 0.0:
            return _base_units(definition)
        raise FmuUnitError(
            f"FMU '{self._name}' defines its unit '{name}' as {describe(definition)}; trussflow has no "
            f"equal unit of that name. Name one with units={{'{name}': '...'}}, or disable its check "
            f"with units={{'{name}': None}}"
        )

    def _check(self, unit: str, definition: FmiUnit) -> None:
        """Raise an error for a unit of the user that contradicts the FMU."""
        try:
            found = fmi_unit(unit)
        except BlockError as error:
            raise FmuUnitError(
                f"cannot use '{unit}' for '{definition.name}': {error}"
            ) from None
        if definition.exponents is not None and not _agree(found, definition):
            raise FmuUnitError(
                f"unit '{unit}' does not fit '{definition.name}' of FMU '{self._name}', which "
                f"is {describe(definition)}; insert a Gain with the factor after the block instead"
            )


def spelled(name: str) -> str:
    """Convert a unit to pint's notation: ``N.m`` becomes ``N*m``, ``m/s2`` becomes ``m/s**2``.

    Parameters
    ----------
    name : str
        A unit in FMI's notation.
    """
    if name in UNIT_NAMES:
        return UNIT_NAMES[name]
    # Powers are tried last: in names such as ``inH2O`` the digit is no power.
    text = PRODUCT_PATTERN.sub("*", name)
    try:
        parse(text)
    except BlockError:
        return POWER_PATTERN.sub(r"**\1", text)
    return text


def describe(definition: FmiUnit) -> str:
    """Return a unit in base units, for messages.

    Parameters
    ----------
    definition : FmiUnit
        The unit.
    """
    text = f"{definition.factor:g} {_base_units(definition)}".rstrip()
    return text + (
        f" with its zero at {definition.offset:g}" if definition.offset else ""
    )


def _agree(ours: FmiUnit, theirs: FmiUnit) -> bool:
    """Return whether two units are equal; the radian counts as 1, because many FMUs leave it out."""
    if ours.exponents is None or theirs.exponents is None:
        return True
    powers = [
        {name: power for name, power in exponents.items() if power and name != "rad"}
        for exponents in (ours.exponents, theirs.exponents)
    ]
    return (
        powers[0] == powers[1]
        and isclose(ours.factor, theirs.factor, rel_tol=1e-9)
        and isclose(ours.offset, theirs.offset, rel_tol=1e-9, abs_tol=1e-12)
    )


def _base_units(definition: FmiUnit) -> str:
    """Return the product of the base units of a unit."""
    powers = (definition.exponents or {}).items()
    return "*".join(f"{n}**{e}" if e != 1 else n for n, e in powers if e)

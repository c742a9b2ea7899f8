"""Units of an FMU in our words, checked against what the FMU itself says they are."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import isclose

from trussflow.blocks.framework.errors import BlockError
from trussflow.blocks.framework.units import parse
from trussflow.fmu.errors import FmuUnitError
from trussflow.fmu.fmi_units import FmiUnit, fmi_unit
from trussflow.fmu.runtime.description import FmuDescription

WORDS = {"-": "", "1": "", "Ohm": "ohm", "degC": "degC", "%": "percent", "°": "deg"}
"""Names that are common in FMUs and that pint knows by another."""

POWER = re.compile(r"(?<=[A-Za-z\u00b5\u03bc])\^?(-?\d+)")
"""A power as FMI writes it: ``m2`` or ``s-1``."""


TIMES = re.compile(r"[.·](?=[^\W\d])")
"""A product as FMI writes it: ``N.m``; the point of ``kg**0.5`` is none."""


class UnitTable:
    """The units of one FMU by their names there.

    Parameters
    ----------
    description : FmuDescription
        The model description.
    given : mapping of str to (str or None), optional
        What the user says: our unit by the FMU's name, or None for a unit not to be looked at.

    Raises
    ------
    FmuUnitError
        If a name is not a unit of the FMU, or contradicts what the FMU says.
    """

    def __init__(self, description: FmuDescription, given: Mapping[str, str | None] | None = None) -> None:
        self._name, self._definitions = description.name, description.units
        self._known: dict[str, str | None] = {"": None}
        used = {v.unit for v in description.variables.values()} | description.units.keys()
        for name, unit in (given or {}).items():
            if name not in used:
                listed = ", ".join(sorted(used - {""})) or "none"
                raise FmuUnitError(f"FMU '{self._name}' has no unit '{name}'; its units are: {listed}")
            definition = self._definitions.get(name)
            if unit is not None and definition is not None:
                self._check(unit, definition)
            self._known[name] = unit

    def unit(self, name: str) -> str | None:
        """Return our unit; None where none is stated.

        Parameters
        ----------
        name : str
            The FMU's name of it.

        Raises
        ------
        FmuUnitError
            If it is unknown here, or means something else here than in the FMU.
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
                    f"FMU '{self._name}' has the unit '{name}', which is unknown here and not "
                    f"defined there; say what it is with units={{'{name}': '...'}}, or "
                    f"units={{'{name}': None}} to leave it unchecked"
                )
            return ours
        if found is not None and _agree(found, definition):
            return ours
        base = _from_base(definition)
        if base is not None and _agree(fmi_unit(base), definition):
            return base
        here = ", and something else here" if found is not None else ""
        raise FmuUnitError(
            f"FMU '{self._name}': its unit '{name}' means {describe(definition)} there{here}; "
            f"say which of ours means the same with units={{'{name}': '...'}}, or leave it unchecked "
            f"with units={{'{name}': None}}"
        )

    def _check(self, unit: str, definition: FmiUnit) -> None:
        """Refuse a unit of the user that contradicts the FMU."""
        try:
            found = fmi_unit(unit)
        except BlockError as error:
            raise FmuUnitError(f"cannot use '{unit}' for '{definition.name}': {error}") from None
        if definition.exponents is not None and not _agree(found, definition):
            raise FmuUnitError(
                f"unit '{unit}' does not fit '{definition.name}' of FMU '{self._name}', which "
                f"means {describe(definition)}; insert a Gain with the factor behind the block "
                "rather than calling it something else"
            )


def spelled(name: str) -> str:
    """Return a unit as pint writes it: ``N.m`` becomes ``N*m``, ``m/s2`` becomes ``m/s**2``.

    Parameters
    ----------
    name : str
        A unit as FMI writes it.
    """
    if name in WORDS:
        return WORDS[name]
    text = TIMES.sub("*", name)
    try:
        parse(text)
    except BlockError:
        return POWER.sub(r"**\1", text)
    return text


def describe(definition: FmiUnit) -> str:
    """Return what a unit is in base units, for messages.

    Parameters
    ----------
    definition : FmiUnit
        The unit.
    """
    powers = [f"{n}^{e}" if e != 1 else n for n, e in (definition.exponents or {}).items() if e]
    text = f"{definition.factor:g} {' '.join(powers) or '1'}"
    return text + (f" with its zero at {definition.offset:g}" if definition.offset else "")


def _agree(ours: FmiUnit, theirs: FmiUnit) -> bool:
    """Tell whether two units are the same; radians count as one, as they do in many FMUs."""
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


def _from_base(definition: FmiUnit) -> str | None:
    """Return a unit made of base units, if it has no factor."""
    if definition.factor != 1.0 or definition.offset != 0.0:
        return None
    powers = (definition.exponents or {}).items()
    return "*".join(f"{n}**{e}" if e != 1 else n for n, e in powers if e)

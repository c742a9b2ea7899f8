"""Record of every number in a report, with name, unit and runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from trussflow.blocks.framework.units import readable
from trussflow.models.errors import ModelError

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MINUS = "\N{MINUS SIGN}"

Note = Callable[..., str]
"""Function that records a number of a run, by name, value, unit and digits, and returns it as text."""


class Ledger:
    """Record of the numbers in a report.

    Attributes
    ----------
    numbers : dict
        By name, each with its ``value`` [unit]; ``unit``, empty for ratios; ``runs``, the names of the runs that
        it is computed from; and ``text`` in the report, without the unit.
    """

    def __init__(self) -> None:
        self.numbers: dict[str, dict[str, Any]] = {}

    def __call__(
        self,
        name: str,
        value: float,
        unit: str = "",
        *,
        runs: Sequence[str] = (),
        digits: int = 3,
        show_unit: bool = True,
    ) -> str:
        """Record a number and return it as text, an integer with all its digits.

        Parameters
        ----------
        name : str
            Unique name in the report.
        value : float
            Value [unit].
        unit : str
            Unit; ``"%"`` displays a ratio in per cent.
        runs : sequence of str
            Names of the runs that it is computed from.
        digits : int
            Significant digits [-].
        show_unit : bool
            Whether the text includes the unit.

        Raises
        ------
        ModelError
            If the name has another number already.
        """
        text = pretty(100 * value if unit == "%" else value, digits)
        if isinstance(value, int):
            text = str(value)
        number = {"value": float(value), "unit": unit, "runs": list(runs), "text": text}
        if self.numbers.setdefault(name, number) != number:
            raise ModelError(f"the report has two different numbers named '{name}'")
        return f"{text} {readable(unit)}" if unit and show_unit else text

    def of(self, run: str) -> Note:
        """Return a function that records numbers of a run, under its name."""

        def note(name: str, value: float, unit: str = "", **form: Any) -> str:
            return self(f"{run}: {name}", value, unit, runs=[run], **form)

        return note


def pretty(value: float, digits: int = 3) -> str:
    """Return a number as text, such as 0.27 or 4.07×10⁻⁶.

    Parameters
    ----------
    value : float
        Value [any].
    digits : int
        Significant digits [-].
    """
    if not math.isfinite(value):
        return (
            "∞" if value > 0 else "not a number" if math.isnan(value) else f"{MINUS}∞"
        )
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if -3 <= power <= 4:
        return f"{float(f'{mantissa}e{power}'):.{max(0, digits - 1 - power)}f}".replace(
            "-", MINUS
        )
    return f"{mantissa}×10{str(power).translate(RAISED)}".replace("-", MINUS)

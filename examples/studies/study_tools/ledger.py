"""Every number in the report, with its name, unit and the runs it comes from."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from trussflow.blocks.framework.units import readable
from trussflow.models.errors import ModelError

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MINUS = "\N{MINUS SIGN}"

Note = Callable[..., str]
"""Takes down a number of a run, by name, value, unit and digits, and returns it as text."""


@dataclass(frozen=True, slots=True)
class Number:
    """One number.

    Attributes
    ----------
    value : float
        As computed [unit].
    unit : str
        Its unit; empty for ratios.
    runs : tuple of str
        The runs it comes from; empty if it needs none, such as data and parameters.
    text : str
        As printed in the report, without the unit.
    """

    value: float
    unit: str
    runs: tuple[str, ...]
    text: str


class Ledger:
    """Takes down each number as it is printed."""

    def __init__(self) -> None:
        self.numbers: dict[str, Number] = {}

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
        """Take a number down and return it as text.

        Parameters
        ----------
        name : str
            What it is; unique in the report.
        value : float
            The number [unit].
        unit : str
            Its unit; ``"%"`` turns a ratio into per cent.
        runs : sequence of str
            The runs it comes from.
        digits : int
            Significant digits [-].
        show_unit : bool
            Whether the unit follows; in a table it may stand in the heading.

        Raises
        ------
        ModelError
            If the name was used for another number.
        """
        text = pretty(100 * value if unit == "%" else value, digits)
        number = Number(float(value), unit, tuple(runs), text)
        if self.numbers.setdefault(name, number) != number:
            raise ModelError(f"the report has two different numbers named '{name}'")
        return f"{text} {readable(unit)}" if unit and show_unit else text

    def of(self, run: str, *others: str) -> Note:
        """Return a way to take down numbers of runs, under the name of the first.

        Parameters
        ----------
        run, *others : str
            The runs that the numbers come from.
        """

        def note(name: str, value: float, unit: str = "", **form: Any) -> str:
            return self(f"{run}: {name}", value, unit, runs=(run, *others), **form)

        return note

    def count(self, name: str, value: int, runs: Sequence[str] = ()) -> str:
        """Take a whole number down and return it as text.

        Parameters
        ----------
        name : str
            What it is; unique in the report.
        value : int
            The number [-].
        runs : sequence of str
            The runs it comes from.
        """
        return self(name, value, runs=runs, digits=max(1, len(str(abs(value)))))


def pretty(value: float, digits: int = 3) -> str:
    """Return a number as people write it: 0.27, 4.07×10⁻⁶.

    Parameters
    ----------
    value : float
        The number [any].
    digits : int
        Significant digits [-].
    """
    if not math.isfinite(value):
        return "∞" if value > 0 else "not a number" if math.isnan(value) else f"{MINUS}∞"
    if value == 0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if -3 <= power <= 4:
        return f"{float(f'{mantissa}e{power}'):.{max(0, digits - 1 - power)}f}".replace("-", MINUS)
    return f"{mantissa}×10{str(power).translate(RAISED)}".replace("-", MINUS)

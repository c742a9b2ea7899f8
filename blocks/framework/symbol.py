"""Textbook symbols of blocks in pictures of diagrams."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.units import readable

if TYPE_CHECKING:
    from trussflow.blocks.framework.block import Block

MAX_VALUE_LENGTH, MAX_POLYNOMIAL_LENGTH = 22, 40
"""Largest number of letters of an array and of a polynomial."""

WHOLE_NUMBERS = 1e4, 1e6
"""Range of numbers that are drawn without fraction and power of ten [any]."""

NO_LIMIT = 1e100
"""Magnitude from which numbers are drawn as infinite [any]."""


FIELD = re.compile(r"\{(\w+):?(\w*)\}")
"""Pattern of a value in a symbol."""


@dataclass(frozen=True, slots=True)
class Symbol:
    """Symbol of a block in pictures, as in a textbook: the class attribute or property ``_symbol``.

    In `text` and `caption`, ``{name}`` is the value of a parameter or attribute of the block,
    ``{name:s}`` a polynomial in s with these coefficients (s or z), ``{A:A}`` the matrix A, or the letter if
    it is large. ``^(...)`` is a superscript.

    Parameters
    ----------
    text : str
        Lines of the symbol; a line ``-`` is the bar of a fraction.
    curve : str
        Path in SVG notation from (0, 0) to (36, 24), drawn over axes through its middle.
    outline : str
        ``"box"``, ``"triangle"`` or ``"circle"``.
    pins : str
        One sign for each input, drawn instead of its name.
    caption : str
        Text below the name of the block. It is omitted if all its values are zero or infinite.

    Examples
    --------
    >>> from trussflow.blocks import Block, Parameter, Symbol
    >>> class Spring(Block):
    ...     stiffness = Parameter(4.0, unit="N/m")
    ...     _symbol = Symbol("k = {stiffness} N/m")
    >>> Spring()._symbol.of(Spring()).text
    'k = 4 N/m'
    """

    text: str = ""
    curve: str = ""
    outline: str = "box"
    pins: str = ""
    caption: str = ""

    def of(self, block: Block) -> Symbol:
        """Return the symbol with the values of a `block`."""

        def shown(field: re.Match[str]) -> str:
            name, form = field.groups()
            value = block.parameters.get(name, getattr(block, name, "?"))
            write: Any = polynomial if form in {"s", "z"} else value_text
            return str(write(value, form))

        # a negative term of a sum is subtracted
        text, caption = (
            FIELD.sub(shown, each).strip().replace("+ −", "− ")
            for each in (self.text, self.caption)
        )
        values = set(re.findall(r"\b[\d.]+|∞", caption))
        return replace(
            self, text=text, caption="" if values and values <= {"0", "∞"} else caption
        )


def value_text(value: Any, large: str = "") -> str:
    """Return a number, array or unit as a short text.

    Parameters
    ----------
    value : object
        The value; others than numbers, arrays and texts give an empty text.
    large : str
        Text for an array with too many elements; by default its shape.
    """
    if isinstance(value, str):
        return readable(value)
    if not isinstance(value, float | int | np.ndarray):
        return ""
    array = np.asarray(value, dtype=float)
    first = array.ravel()[:1]
    # A vector of equal elements may be drawn as a number, but not among matrices.
    plain = array.size < 2 or array.ndim < 2 - bool(large) or not first.any()
    if plain and (array == first).all():
        return number(float(first[0])) if array.size else ""
    rows = (" ".join(map(number, row)) for row in np.atleast_2d(array).tolist())
    text = f"[{'; '.join(rows)}]" if array.ndim < 3 else ""
    if 0 < len(text) <= MAX_VALUE_LENGTH:
        return text
    return large or f"{'×'.join(map(str, array.shape))} values"


def number(value: float) -> str:
    """Return a number [any] with four digits as text."""
    if abs(value) >= NO_LIMIT:
        return "−∞" if value < 0 else "∞"
    form = ".0f" if WHOLE_NUMBERS[0] <= abs(value) < WHOLE_NUMBERS[1] else ".4g"
    digits, _, power = f"{value:{form}}".partition("e")
    text = f"{digits}·10^({int(power)})" if power else digits
    return text.replace("-", "−")


def polynomial(coefficients: Sequence[float], variable: str) -> str:
    """Return a polynomial as text, from `coefficients` [any] of falling powers of a `variable`."""
    text, order = "", len(coefficients) - 1
    for power, value in zip(range(order, -1, -1), coefficients, strict=True):
        factor = {0: "", 1: variable}.get(power, f"{variable}^({power})")
        size = "" if abs(value) == 1 and factor else number(abs(value))
        term = " ".join(filter(None, ("−" if value < 0 else "+", size, factor)))
        text += f"{term} " if value else ""
    text = text.removeprefix("+ ").strip() or "0"
    return (
        text if len(text) <= MAX_POLYNOMIAL_LENGTH else f"order {order} in {variable}"
    )

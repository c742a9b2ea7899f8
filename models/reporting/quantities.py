"""Numbers for people to read: few digits, and units with SI prefixes."""

from __future__ import annotations

import math
import re

from trussflow.blocks.framework.units import readable

PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
"""SI prefixes, keyed by their power of ten."""
SCALABLE = re.compile(r"(m|s|N|rad|J|W|Pa|Hz|V|A)(?![A-Za-z^²³⁴½])")
"""Units that may have a prefix; a power of the first unit would apply to the prefix, too."""
SMALL_ONLY = re.compile(r"s|rad")
"""Units without prefixes for large numbers."""

_NUMBER = re.compile(r"-?\d+(\.\d*)?(e[-+]?\d+)?")
_QUANTITY = re.compile(
    rf"(?P<number>{_NUMBER.pattern}|\[[^A-Za-df-z]*\])(?: (?P<unit>\S+))?"
)


def _rounded(value: float, digits: int) -> str:
    """Return a number as text with a number of significant `digits`, without zeros at the end."""
    return f"{float(f'{value:.{digits}g}'):.{max(digits, 7)}g}"


def prefixed(value: float, unit: str, digits: int = 3) -> tuple[str, str]:
    """Return a number as text, and its unit with an SI prefix if that is usual.

    Parameters
    ----------
    value : float
        Number [unit].
    unit : str
        Unit, such as ``"N*m"``.
    digits : int
        Number of significant digits [-].

    Examples
    --------
    >>> prefixed(4.072e-6, "m")
    ('4.07', 'µm')
    """
    unit, size, power = readable(unit), abs(value), 0
    if SCALABLE.match(unit) and 0.0 < size < math.inf:
        size = float(f"{size:.{digits}g}")  # 999.9 is 1 k
        if not 0.1 <= size < 1000.0:
            power = 3 * math.floor(math.log10(size) / 3.0 + 1e-9)
        if power not in PREFIXES or (power > 0 and SMALL_ONLY.match(unit)):
            power = 0
    return _rounded(value / 10.0**power, digits), PREFIXES[power] + unit


def shortened(text: str, digits: int = 7) -> str:
    """Return the text of a value in a parameter file with few digits, scalars with an SI prefix.

    Parameters
    ----------
    text : str
        Number or list of numbers, and a unit; other text is returned as it is.
    digits : int
        Number of significant digits [-].

    Examples
    --------
    >>> shortened("70000000000.0 Pa"), shortened("[0.16666666666666666, 2.0] kg*m^2")
    ('70 GPa', '[0.1666667, 2] kg·m²')
    """
    found = _QUANTITY.fullmatch(text)
    if found is None:
        return text
    number, unit = found["number"], found["unit"] or ""
    if not number.startswith("["):
        number, unit = prefixed(float(number), unit, digits)
    else:
        number = _NUMBER.sub(lambda each: _rounded(float(each[0]), digits), number)
    return f"{number} {readable(unit)}".strip()

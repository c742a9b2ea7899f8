"""Textbook symbols of blocks in pictures of diagrams."""

from __future__ import annotations

import ast
import itertools
import linecache
import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.units import readable

if TYPE_CHECKING:
    from trussflow.blocks.framework.block import Block

MAX_VALUE_LENGTH, MAX_POLYNOMIAL_LENGTH = 22, 40
"""Largest number of letters of an array and of a polynomial."""

NO_LIMIT = 1e100
"""Magnitude from which numbers are drawn as infinite [any]."""

MAX_NAME_LENGTH = 28
"""Largest number of letters of a name; the tooltip has the complete name."""

MAX_EQUATION_LENGTH, MAX_EQUATIONS = 48, 10
"""Largest number of letters of a line of equations, and of lines."""

METHODS = {
    "derivative": "{}′ = {}",
    "update": "{}^(+) = {}",
    "output": "{} = {}",
    "indicators": "{} when 0 = {}",
    "on_event": "then {}^(+) = {}",
}
"""Methods of a block with the form of their equations."""

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
        Text for an array with too many elements; by default its size.
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
    digits, _, power = f"{value:.4g}".partition("e")
    text = f"{digits}·10^({int(power)})" if power else digits
    return text.replace("-", "−")


def polynomial(coefficients: Sequence[float], variable: str) -> str:
    """Return a polynomial as text, from `coefficients` [any] of falling powers of a `variable`."""
    text, order = "", len(coefficients) - 1
    for power, value in zip(range(order, -1, -1), coefficients, strict=True):
        factor = {0: "", 1: variable}.get(power, f"{variable}^({power})")
        size = "" if abs(value) == 1 and factor else number(abs(value))
        term = "·".join(filter(None, (size, factor)))
        text += f"{'−' if value < 0 else '+'} {term} " if value else ""
    text = text.removeprefix("+ ").strip() or "0"
    return (
        text if len(text) <= MAX_POLYNOMIAL_LENGTH else f"order {order} in {variable}"
    )


def block_equations(block: Block) -> str:
    """Return the equations of the `METHODS` of a `block`; an empty text if one is not known."""
    found = [
        equations(getattr(block, name), form)
        for name, form in METHODS.items()
        if block.states_own(name)
    ]
    return "\n".join(itertools.chain(*found)) if all(found) else ""


def equations(function: Callable[..., Any], form: str = "") -> list[str]:
    """Return the lines of a lambda, or of a function of assignments and a `return`.

    Parameters
    ----------
    function : callable
        The function.
    form : str
        Form of each value of a returned dict, with its key; by default the result is one line.

    Returns
    -------
    list of str
        The lines; empty if there are too many, the function has another form, or its text is not known.
    """
    *steps, last = _body(function) or [ast.Pass()]
    result = last.value if isinstance(last, ast.Return) else None
    if not result or not all(isinstance(step, ast.Assign) for step in steps):
        return []
    if form and not isinstance(result, ast.Dict):
        return []
    texts = [*map(_written, steps)]
    if isinstance(result, ast.Dict):
        texts += [
            form.format(key.value, _written(value))
            for key, value in zip(result.keys, result.values, strict=True)
            if isinstance(key, ast.Constant)
        ]
    else:
        texts.append(_written(result))
    lines = wrapped(*texts)
    # The name of a private function says nothing.
    is_private = re.search(r"\b_[a-z]", " ".join(lines))
    return [] if is_private or len(lines) > MAX_EQUATIONS else lines


def brief(name: str) -> str:
    """Return a name, shortened if it is too long."""
    return name if len(name) <= MAX_NAME_LENGTH else f"{name[: MAX_NAME_LENGTH - 1]}…"


def wrapped(*texts: str) -> list[str]:
    """Return the lines of `texts`, each of moderate length."""
    settings: dict[str, Any] = {"subsequent_indent": "  ", "break_long_words": False}
    lines = (textwrap.wrap(text, MAX_EQUATION_LENGTH, **settings) for text in texts)
    return [*itertools.chain(*lines)]


def _body(function: Callable[..., Any]) -> list[ast.stmt]:
    """Return the statements of a function; an empty list if its text is not known."""
    code, found = getattr(function, "__code__", None), list[list[ast.stmt]]()
    # The body of a wrapper calls a function that the picture does not contain.
    if code is None or hasattr(function, "__wrapped__"):
        return []
    try:
        tree = _parsed("".join(linecache.getlines(code.co_filename)))
    except SyntaxError:
        return []
    for node in ast.walk(tree):
        first = next(iter(getattr(node, "decorator_list", ())), node)
        # Of an edited file, the line may contain another function.
        place = getattr(first, "lineno", 0), getattr(node, "name", "<lambda>")
        if place != (code.co_firstlineno, code.co_name):
            continue
        if isinstance(node, ast.Lambda):
            found.append([ast.Return(node.body)])
        elif isinstance(node, ast.FunctionDef):
            found.append(node.body[ast.get_docstring(node) is not None :])
    return found[0] if len(found) == 1 else []


_parsed = lru_cache(maxsize=8)(ast.parse)
"""Syntax tree of the text of a file."""


def _written(node: ast.AST) -> str:
    """Return an expression or assignment as text: ``2 * np.sin(x.angle)`` is ``2·sin(angle)``."""
    text = re.sub(r"\b(?:np|self|[xup])\.(?=[a-z_])", "", ast.unparse(node))
    text = re.sub(r"(\d)\.0\b", r"\1", text).replace("-", "−").replace(" * ", "·")
    return re.sub(r" \*\* (\w+)", r"^(\1)", text)

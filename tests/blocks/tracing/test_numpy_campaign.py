"""Random compositions of NumPy calls: traced ones agree with NumPy on all backends, or are refused.

``TRUSSFLOW_COMPOSITIONS=20000`` runs the long campaign. A difference counts where NumPy's number is finite, and where
neither round-off (a perturbed point gives almost the same) nor the sign of zero decides.
"""

import os
import warnings
from collections import Counter
from collections.abc import Callable
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import TrussflowError
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.library.algebra import Function
from trussflow.blocks.simulation.executor import CompiledExecutor
from trussflow.blocks.tracing.block_check import isolate
from trussflow.blocks.tracing.program import lower
from trussflow.blocks.tracing.tracing import Trace, symbol, to_expression

COMPOSITIONS = int(os.environ.get("TRUSSFLOW_COMPOSITIONS", "300"))
BATCH = 100
ROUND_OFF = 1e-9  # of the largest intermediate number, which is what is lost when it cancels
SIZE = 3
"""All arrays have this shape, or are scalars."""

ONE = [
    *("abs", "sqrt", "square", "reciprocal", "sign", "exp", "expm1", "log", "log1p", "log10", "log2", "exp2"),
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "sinh", "cosh", "tanh", "arcsinh", "arccosh", "arctanh"),
    *("floor", "ceil", "trunc", "fix", "rint", "round", "cbrt", "degrees", "radians", "sinc", "negative"),
    *("isnan", "isinf", "isfinite", "isposinf", "isneginf", "logical_not", "nan_to_num", "cumsum", "cumprod"),
    *("nancumsum", "flip", "ediff1d", "sort", "argmax", "positive", "nanmax", "nanmin", "nansum", "nanprod"),
    *("nanmean", "max", "min", "sum", "mean", "prod", "ptp", "std", "var", "all", "any", "gradient", "median"),
    *("linalg.norm", "count_nonzero"),
]
TWO = [
    *("add", "subtract", "multiply", "divide", "power", "mod", "fmod", "floor_divide", "maximum", "minimum", "fmax"),
    *("fmin", "arctan2", "hypot", "copysign", "less", "less_equal", "greater", "greater_equal", "equal", "not_equal"),
    *("logical_and", "logical_or", "logical_xor", "heaviside", "logaddexp", "logaddexp2", "isclose", "dot", "cross"),
    *("float_power", "nextafter"),
]
NUMBERS = (0.0, 1.0, -1.0, 0.5, 2.0, 3.0, 0.1, -2.5, 7.0, 1e-3, 1e6)
Maker = Callable[[np.random.Generator], tuple[str, Callable[..., Any]]]


def call(name: str, *fixed: Any, **keywords: Any) -> Callable[..., Any]:
    function: Any = np
    for part in name.split("."):
        function = getattr(function, part)
    return lambda *arrays: function(*arrays, *fixed, **keywords)


def drawn(rng: np.random.Generator, depth: int) -> tuple[str, Callable[[Array, Array], Any]]:
    """Return the text and the function of a random composition of two vectors."""
    if depth == 0 or rng.random() < 0.1:
        k = rng.integers(3)
        if k == 2:
            number = float(rng.choice(NUMBERS))
            return repr(number), lambda _u, _v: number
        return "uv"[k], lambda u, v: (u, v)[k]
    kind = rng.random()
    first, f = drawn(rng, depth - 1)
    if kind < 0.45:
        name = str(rng.choice(ONE))
        g = call(name)
        return f"{name}({first})", lambda u, v: g(f(u, v))
    second, h = drawn(rng, depth - 1)
    if kind < 0.85:
        name = str(rng.choice(TWO))
        g = call(name)
        return f"{name}({first}, {second})", lambda u, v: g(f(u, v), h(u, v))
    if kind < 0.92:
        third, i = drawn(rng, depth - 1)
        return f"where({third} > 0, {first}, {second})", lambda u, v: np.where(i(u, v) > 0, f(u, v), h(u, v))
    special: list[tuple[str, Callable[..., Any]]] = [
        ("clip(%s, -1, 2)", lambda a, _: np.clip(a, -1, 2)),
        ("interp(%s)", lambda a, _: np.interp(a, [-1, 0, 2], [3, 1, 4.0])),
        ("digitize(%s)", lambda a, _: np.digitize(a, [-1, 0, 2.0])),
        ("round(%s, 1)", lambda a, _: np.round(a, 1)),
        ("modf(%s)[0]", lambda a, _: np.modf(a)[0]),
        ("divmod(%s)", lambda a, b: sum(divmod(a, b))),
        ("roll(%s)", lambda a, _: np.roll(a, 1)),
        ("stack(%s)", lambda a, b: np.stack([a, b])[0]),
        ("max(%s, initial)", lambda a, _: np.max(a, initial=0.5)),
        ("sum(%s, where)", lambda a, _: np.sum(a, where=[True, False, True])),
        ("nan_to_num(%s, ...)", lambda a, _: np.nan_to_num(a, nan=1.0, posinf=2.0, neginf=-3.0)),
        ("%s % %s", lambda a, b: a % b),
        ("%s // %s", lambda a, b: a // b),
    ]
    text, join = special[rng.integers(len(special))]
    return text.replace("%s", first, 1).replace("%s", second), lambda u, v: join(f(u, v), h(u, v))


def points() -> list[tuple[Vector, Vector]]:
    """Return ordinary, huge, tiny, infinite, NaN, equal and signed-zero inputs."""
    rng = np.random.default_rng(7)
    mixed = [0.0, -0.0, 0.5, -2.5, 3.5, 1e300, -1e300, 1e-300, -1e-310, np.inf, -np.inf, np.nan, 1.0, -1.0, 1e17]
    found = [(rng.uniform(-3, 3, SIZE), rng.uniform(-3, 3, SIZE)) for _ in range(4)]
    found += [(rng.choice(mixed, SIZE), rng.choice(mixed, SIZE)) for _ in range(12)]
    found += [(np.full(SIZE, a), np.full(SIZE, a)) for a in (0.5, 0.0, 2.0, np.inf, np.nan)]
    found += [(np.round(rng.uniform(-9, 9, SIZE)) / 2, np.round(rng.uniform(-9, 9, SIZE)) / 10) for _ in range(4)]
    return found

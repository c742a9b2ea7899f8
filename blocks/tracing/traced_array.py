"""Traced arrays: NumPy arrays with expressions instead of numbers.

CasADi's array interface implements most functions. `numpy_functions` replaces those that differ from NumPy,
mostly for NaN and infinite numbers. Keywords that CasADi ignores, and operations that need numbers, raise
`NeedsNumberError`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any, Never

import casadi as ca
import numpy as np

from trussflow.blocks.tracing.numpy_functions import (
    NUMPY_REPLACEMENTS,
    REFUSED_FUNCTIONS,
)

UNSUPPORTED_ARGUMENTS = frozenset(
    (
        "where",
        "initial",
        "dtype",
        "out",
        "order",
        "casting",
        "subok",
        "like",
        "mean",
        "correction",
        "period",
        "left",
        "right",
    )
)
"""Arguments of NumPy functions that CasADi ignores or interprets differently."""


class NeedsNumberError(TypeError):
    """An equation needs the numbers of a traced array, or writes into it; the message proposes a remedy."""


def _refuse(what: str) -> Callable[..., Never]:
    def refuse(*_: object, **__: object) -> Never:
        raise NeedsNumberError(what)

    return refuse


_TO_COMBINE = "'&', '|', '^' and '~' do not trace; write np.logical_and, np.logical_or, np.not_equal, np.logical_not"
_TO_CHOOSE = (
    "a signal has no value while traced, and cannot be an index or a count; write np.where or np.select to "
    "choose, np.trunc or np.floor instead of int()"
)
REFUSAL_MESSAGES = {
    "__bool__": "a condition has no value while traced; write np.where instead of 'if', np.logical_and "
    "and np.logical_or instead of 'and' and 'or', np.maximum and np.minimum instead of max() and min()",
    "__float__": "a signal has no value while traced; write NumPy's functions instead of those of math "
    "(np.sin instead of math.sin), and leave float() out",
    **dict.fromkeys(("__int__", "__index__"), _TO_CHOOSE),
    "__round__": "round() does not trace; write np.round",
    "__array__": "np.array, np.asarray, np.full, functions of SciPy and indices need numbers; write np.stack "
    "or np.concatenate to put signals together, np.where to choose",
    **dict.fromkeys(
        ("__divmod__", "__rdivmod__"), "divmod() does not trace; write u // v and u % v"
    ),
    "__setitem__": "an array of signals cannot be written into; write np.stack, np.concatenate or np.where",
    **dict.fromkeys(
        (
            "__and__",
            "__or__",
            "__xor__",
            "__invert__",
            "__rand__",
            "__ror__",
            "__rxor__",
        ),
        _TO_COMBINE,
    ),
}
"""Message of each method that needs numbers, with the remedy."""


class TracedArray(ca.ArrayInterfaceSX):
    """A NumPy array whose elements are expressions."""

    def __array_ufunc__(
        self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any
    ) -> Any:
        """Implement ``np.add`` and other universal functions."""
        name = (
            f"np.{ufunc.__name__}"
            if hasattr(np, ufunc.__name__)
            else f"{ufunc.__name__}() of another library"
        )
        name += f".{method}" if method != "__call__" else ""
        _refuse_dropped(name, kwargs)
        replaced = ufunc in NUMPY_REPLACEMENTS
        if replaced and method == "__call__":
            return NUMPY_REPLACEMENTS[ufunc](*inputs)
        if replaced or ufunc in REFUSED_FUNCTIONS:
            return owned(NotImplemented, name)
        return owned(super().__array_ufunc__(ufunc, method, *inputs, **kwargs), name)

    def __array_function__(
        self, func: Callable[..., Any], types: Any, args: Any, kwargs: Any
    ) -> Any:
        """Implement ``np.stack`` and other functions."""
        name = f"{func.__module__.replace('numpy', 'np', 1)}.{func.__name__}"
        _refuse_dropped(name, _given(func, args, kwargs))
        if func in NUMPY_REPLACEMENTS:
            return NUMPY_REPLACEMENTS[func](*args, **kwargs)
        if func in REFUSED_FUNCTIONS:
            return owned(NotImplemented, name)
        return owned(super().__array_function__(func, types, args, kwargs), name)


def owned(value: Any, name: str = "") -> Any:
    """Convert a result of CasADi to traced arrays, or to plain arrays if it consists of numbers.

    Parameters
    ----------
    value : object
        The result.
    name : str
        Name of the function, as the user writes it.

    Raises
    ------
    NeedsNumberError
        If CasADi does not implement the function.
    """
    if value is NotImplemented:
        raise NeedsNumberError(f"{name} does not trace, or not with these arguments")
    if isinstance(value, list | tuple):
        return type(value)(owned(each, name) for each in value)
    if isinstance(value, ca.ArrayInterfaceSX):
        # In place, as a copy of every result would slow down tracing.
        value.__class__ = TracedArray
    return np.asarray(value) if isinstance(value, ca.ArrayInterfaceDM) else value


def _kept(name: str) -> Callable[..., Any]:
    """Return a method of CasADi's arrays, with its results converted to traced arrays."""
    method = getattr(ca.ArrayInterface, name)

    def call(self: TracedArray, *_args: Any, **_kwargs: Any) -> Any:
        return owned(method(self, *_args, **_kwargs))

    return call


_WRAPPED_METHODS = (
    "_binop",
    "_rbinop",
    "_matmul",
    "__getitem__",
    "__neg__",
    "__abs__",
    "reshape",
    "transpose",
    "sum",
    "mean",
    "prod",
    "max",
    "min",
    "ptp",
    "all",
    "any",
    "var",
    "std",
    "squeeze",
    "flatten",
    "ravel",
)
for _name in _WRAPPED_METHODS:
    setattr(TracedArray, _name, _kept(_name))
# NumPy's operators call universal functions, which have replacements; CasADi's do not.
for _name in ("__mod__", "__rmod__", "__floordiv__", "__rfloordiv__"):
    setattr(TracedArray, _name, getattr(np.lib.mixins.NDArrayOperatorsMixin, _name))
for _name, _what in REFUSAL_MESSAGES.items():
    setattr(TracedArray, _name, _refuse(_what))
_transposed = vars(ca.ArrayInterface)["T"]
setattr(TracedArray, "T", property(lambda self: owned(_transposed.fget(self))))  # noqa: B010  # mypy: a method


@cache
def _signature(func: Callable[..., Any]) -> inspect.Signature | None:
    try:
        return inspect.signature(func)
    except ValueError:  # a function written in C
        return None


def _given(func: Callable[..., Any], args: Any, kwargs: Any) -> dict[str, Any]:
    """Return the arguments of a call by name; without a signature, only the keyword arguments."""
    signature = _signature(func)
    return kwargs if signature is None else signature.bind(*args, **kwargs).arguments


def _refuse_dropped(name: str, arguments: dict[str, Any]) -> None:
    for dropped in UNSUPPORTED_ARGUMENTS.intersection(arguments):
        value = arguments[dropped]
        idle = (
            value is None
            or value is np._NoValue
            or value is True
            or value is float
            or value == "K"
        )
        if not idle:
            raise NeedsNumberError(
                f"'{dropped}' of {name} does not trace; write it with np.where, np.maximum or np.minimum"
            )

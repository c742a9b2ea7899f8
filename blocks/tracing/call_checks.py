"""Checks of the results of a block's equations, and messages for the exceptions that they raise."""

from __future__ import annotations

import inspect
import linecache
from collections.abc import Callable
from traceback import walk_tb
from typing import Any

import numpy as np

from trussflow.blocks.errors import BlockError, Explained, SimulationError, TracingError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Event, Signals, State
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.tracing.kernels import is_traced, shapes_of
from trussflow.blocks.tracing.traced_array import REFUSAL_MESSAGES, NeedsNumberError

_NOT_THE_USERS = ("trussflow.blocks.", "numpy", "casadi")


def equation(equations: Equations, kind: str, fired: Signals) -> Callable[..., Any]:
    """Return the equation `kind` as a function of t, x, u and p; only ``on_event`` reads `fired` events.

    The `equations` are a block or its object for one run.
    """
    found: Callable[..., Any] = getattr(equations, kind)
    return (lambda *given: found(*given, fired)) if kind == "on_event" else found


def checked(block: Block, kind: str, values: Values) -> Values:
    """Return `values`, checked for the names and shapes that the equation `kind` of a `block` must return."""
    where = f"{kind}() of block '{block.path}' ({type(block).__name__})"
    returned: object = values
    some = kind == "on_event"  # may return only the states and modes that change
    if kind == "output":
        expected = {p.name: p.whole_shape for p in block.outputs()}
    else:
        stored = block.declared(State) if some else block.states()
        names = block.declared(Event) if kind == "indicators" else stored
        expected = {name: block.state_shape(name) for name in names}
    given = set(returned) if isinstance(returned, dict) else {None}
    if not (given <= set(expected) if some else given == set(expected)):
        got = (
            ", ".join(returned)
            if isinstance(returned, dict)
            else repr(type(returned).__name__)
        )
        raise BlockError(
            f"{where} must return a dict of{' some of' if some else ''}: {', '.join(expected)}; "
            f"it returned: {got}"
        )
    for name, found in shapes_of(values).items():
        shape, value = expected[name], values[name]
        if not is_traced(value) and (
            isinstance(value, np.ma.MaskedArray)
            or np.asarray(value).dtype.kind not in "biuf"
        ):
            raise BlockError(
                f"{where}: '{name}' must be an array of numbers, not {value!r}{_place(block, kind)}"
            )
        if found != shape:
            what = (
                "Output" if kind == "output" else type(block._declared[name]).__name__
            )
            declared = f"{what}({'shape=' * (what in ('Mode', 'Event'))}{found})"
            declared = (
                f"outputs={{'{name}': {declared}}}"
                if _wrapped(block)
                else f"{name} = {declared}"
            )
            raise BlockError(
                f"{where}: '{name}' is declared with shape {shape}, but was returned with shape "
                f"{found}; return that shape, or declare {declared}{_place(block, kind)}"
            )
    return values


def tracing_errors(block: Block) -> Explained:
    """Convert an exception from a block's equations during tracing into a `TracingError`."""
    return Explained(lambda error: refusal(block, brief(error), error))


def brief(error: Exception) -> str:
    """Return the first line of an error message, or the first two if the first ends with a colon."""
    if isinstance(error, NeedsNumberError):
        return str(error)
    if str(error).startswith("setting an array element") or "read-only" in str(error):
        # raised by NumPy
        return REFUSAL_MESSAGES["__setitem__"]
    first, *others = str(error).splitlines() or [""]
    return f"{type(error).__name__}: {first}" + (
        f" {others[0]}" if others and first.endswith(":") else ""
    )


def _wrapped(block: Block) -> Any:
    """Return the user's function in a block such as `Function`, if there is one."""
    return vars(block).get("_function")


def _place(block: Block, kind: str = "output", error: Exception | None = None) -> str:
    """Return a line with the place of an error in the user's code, or of the first line of the equation."""
    frames = walk_tb(None if error is None else error.__traceback__)
    named = [(str(f.f_globals.get("__name__")), f.f_code, line) for f, line in frames]
    users = [
        (code, line)
        for name, code, line in named
        if not name.startswith(_NOT_THE_USERS)
    ]
    code = getattr(
        inspect.unwrap(_wrapped(block) or getattr(block, kind)), "__code__", None
    )
    # The innermost frame of the user is reported. The equation itself comes first, so
    # that it is reported only if no frame is the user's.
    if code is not None:
        users.insert(0, (code, code.co_firstlineno))
    if not users:
        return ""
    code, line = users[-1]
    text = linecache.getline(code.co_filename, line).strip()
    return f"\n  {code.co_filename}:{line}{f': {text}' if 0 < len(text) < 100 else ''}"


def running_errors(block: Block, kind: str, t: float | None) -> Explained:
    """Convert an exception from the equation `kind` of a `block` at time `t` [s] into a `SimulationError`."""
    return Explained(
        lambda error: SimulationError(
            f"{kind}() of block '{block.path}' ({type(block).__name__}) raised "
            f"{type(error).__name__}{'' if t is None else f' at t = {t:g} s'}: {error}"
        )
    )


def refusal(block: Block, reason: str, error: Exception | None = None) -> TracingError:
    """Return the error that a `block` cannot be traced, with the `reason` and the place of `error`."""
    return TracingError(
        f"the equations of block '{block.path}' ({type(block).__name__}) cannot be traced: "
        f"{reason}{_place(block, error=error)}\n"
        "  docs/traceable.md lists the supported operations; a Python block (PythonFunction, or "
        "traced = False) may use any Python code"
    )

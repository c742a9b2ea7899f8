"""Reduction of the result of a run to numbers or selected signals."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Mapping, Sequence
from numbers import Number
from types import CodeType, FunctionType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.port import Port
from trussflow.blocks.simulation.lanes import LaneRuns
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import shown

if TYPE_CHECKING:
    import xarray as xr

SETTLING_BAND = 0.02
"""Settling band around the final value, relative to the largest distance from it [-]."""

Function = Callable[["xr.Dataset"], Any]


class Kept(NamedTuple):
    """Reduction of a run by a `function`, which returns values by name.

    Attributes
    ----------
    function : callable
        Takes the result of the run.
    outputs : list of str or None
        The outputs that it needs; None if unknown.
    words : dict of str to tuple, optional
        Output and name of the reduction of each value, if all are of `REDUCTIONS`, without whole signals.
    """

    function: Function
    outputs: list[str] | None = None
    words: dict[str, tuple[str, str]] | None = None


def _mean(times: Vector, values: Vector) -> Any:
    # NumPy's sum depends on the memory layout: contiguous in time, as in the result of a run.
    values = np.moveaxis(np.ascontiguousarray(np.moveaxis(values, 0, -1)), -1, 0)
    # Weighted by time: steps of an adaptive solver, and the last
    # one, have other lengths.
    return np.trapezoid(values, times, axis=0) / (times[-1] - times[0])


def _settling(times: Vector, values: Vector) -> Any:
    """Return the settling time of each element."""
    far = np.abs(values - values[-1])
    outside = far > SETTLING_BAND * far.max(axis=0)
    # The last time outside is the first True of the reversed array.
    last = len(times) - 1 - np.argmax(outside[::-1], axis=0)
    return np.where(
        outside.any(axis=0), times[np.minimum(last + 1, len(times) - 1)], times[0]
    )


REDUCTIONS: dict[str, Callable[[Vector, Vector], Any]] = {
    "max": lambda _, values: values.max(axis=0),
    "min": lambda _, values: values.min(axis=0),
    "peak": lambda _, values: np.abs(values).max(axis=0),
    "mean": _mean,
    "rms": lambda times, values: np.sqrt(_mean(times, values**2)),
    "final": lambda _, values: values[-1],
    "settling": _settling,
    "all": lambda _, values: values,
}
"""Reductions of a signal, by element, for `times` [s] and `values` [as declared]."""


def understood(keep: Any) -> Kept:
    """Return the reduction that the argument `keep` describes.

    Raises
    ------
    SimulationError
        If the argument is not valid.
    """
    if callable(keep):
        return Kept(keep)
    if isinstance(keep, str) and keep == "all":
        return Kept(_everything)
    if isinstance(keep, Sequence) and not isinstance(keep, str):
        keep = {_name(output): "all" for output in keep}
    if not isinstance(keep, Mapping) or not keep:
        hint = "give 'all', a list of outputs, a function of the run, or any of these by name"
        raise SimulationError(f"cannot keep {shown(keep)}: {hint}")
    functions, words = dict[str, Function](), dict[str, tuple[str, str]]()
    for name, what in keep.items():
        own = _name(name)
        if callable(what):
            functions[own] = what
            continue
        pair = (own, what) if isinstance(what, str) else what
        if not isinstance(pair, tuple) or len(pair) != 2 or pair[1] not in REDUCTIONS:
            hint = f"give a function of the run, one of {', '.join(REDUCTIONS)}, or ('block.output', 'max')"
            raise SimulationError(f"cannot keep '{own}' as {shown(what)}: {hint}")
        words[own] = _name(pair[0]), pair[1]
        functions[own] = functools.partial(_made, *words[own])
    # A function may read any output, so all must be logged.
    plain = len(words) == len(functions)
    outputs = [*dict.fromkeys(output for output, _ in words.values())]
    return Kept(
        functools.partial(_each, functions),
        outputs if plain else None,
        words if plain and all(word != "all" for _, word in words.values()) else None,
    )


def _name(output: Any) -> str:
    if not isinstance(output, str | Port) or "/" in str(output):
        raise SimulationError(
            f"cannot keep {shown(output)}: names are text without '/', or outputs"
        )
    return output if isinstance(output, str) else output.full_path


def _everything(result: xr.Dataset) -> Mapping[Any, Any]:
    return result.data_vars


def _each(functions: Mapping[str, Function], result: xr.Dataset) -> dict[str, Any]:
    return {name: function(result) for name, function in functions.items()}


def _made(output: str, word: str, result: xr.Dataset) -> Any:
    """Return the reduction of an output by the name of the reduction."""
    return (
        result[output]
        if word == "all"
        else REDUCTIONS[word](result["time"].values, result[output].values)
    )


def reduced(result: xr.Dataset, kept: Kept) -> dict[str, Any]:
    """Return the values that are `kept` of a `result` by name: numbers, arrays and signals."""
    import xarray as xr

    return {
        name: value
        if isinstance(value, xr.DataArray) and value.ndim
        else np.asarray(value, dtype=float)
        for name, value in kept.function(result).items()
    }


def reduced_together(
    runs: LaneRuns, words: Mapping[str, tuple[str, str]]
) -> dict[str, Vector]:
    """Return the reductions `words`, as in `Kept`, of each of several `runs` by name."""
    return {
        name: runs.reduced(output, REDUCTIONS[word])
        for name, (output, word) in words.items()
    }


def code_of(thing: Any) -> str:
    """Return a hash of functions with their constants and closures; other objects count by type only."""
    return hashlib.sha256(_text(thing).encode()).hexdigest()[:16]


def _text(thing: Any) -> str:
    if isinstance(thing, FunctionType):
        code, values = (
            thing.__code__,
            [cell.cell_contents for cell in thing.__closure__ or ()],
        )
        constants = (str, Number, np.ndarray)
        # Constants of the module that the function uses: a change of
        # them changes its result.
        values += [
            v
            for n in code.co_names
            if isinstance(v := thing.__globals__.get(n), constants)
        ]
        return _text((code, thing.__defaults__, thing.__kwdefaults__, values))
    if isinstance(thing, CodeType):
        return _text(
            (thing.co_code.hex(), thing.co_names, thing.co_varnames, thing.co_consts)
        )
    if isinstance(thing, functools.partial):
        return _text((thing.func, thing.args, thing.keywords))
    if isinstance(thing, Mapping):
        return _text([(str(key), value) for key, value in thing.items()])
    if isinstance(thing, list | tuple | frozenset):
        # The order of a set differs from process to process.
        parts = [_text(part) for part in thing]
        return str(sorted(parts) if isinstance(thing, frozenset) else parts)
    if isinstance(thing, np.ndarray):
        return f"{thing.shape} {thing.tobytes().hex()}"
    known = thing is None or isinstance(thing, str | bytes | Number)
    return (
        repr(thing)
        if known
        else getattr(thing, "__qualname__", type(thing).__qualname__)
    )

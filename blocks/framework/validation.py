"""Checks of what users give: numbers, shapes, names."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.described import Described
from trussflow.blocks.framework.errors import (
    BlockError,
    LinearAnalysisError,
    NameLookupError,
    ParameterError,
    SimulationError,
)
from trussflow.blocks.framework.types import Vector

MOST_ELEMENTS = 10_000_000
"""Elements of one signal; more is a slip, and would fill the memory before anything refuses it."""


def shown(value: object) -> str:
    """Return how to show what a user gave in a message: short, whatever it is."""
    try:
        text = value._described().title if isinstance(value, Described) else repr(value)
    except ValueError:  # whole numbers of more than 4300 digits
        text = f"a huge {type(value).__name__}"
    return text if len(text) <= 200 else f"{text[:200]}..."


def number_array(what: str, value: Any) -> Vector:
    """Return a `value` [any] as a float array of the shape that it has; `what` it is, messages say.

    Raises
    ------
    ParameterError
        If it is not numeric: text, complex, masked, or lists of different lengths.
    """
    try:
        given = np.asarray(value)
        no_none = given.dtype.kind == "O" and all(element is not None for element in given.flat)
        if (given.dtype.kind in "biuf" or no_none) and not np.ma.is_masked(value):
            return given.astype(float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ParameterError(
        f"{what} must be numeric, not {shown(value)}; give one real number, or lists of equal length"
    )


def finite_array(
    what: str, value: Any, shape: tuple[int, ...] | None = None, *, infinite: bool = False
) -> Vector:
    """Return a value as a float array of the shape wanted.

    Parameters
    ----------
    what : str
        What it is, for messages.
    value : array_like
        What the user gave [any].
    shape : tuple of int, optional
        Shape wanted; a value that can be broadcast to it is [-]. By default any.
    infinite : bool
        Whether infinite numbers are allowed.

    Raises
    ------
    ParameterError
        If it is not numeric, not finite, or has the wrong shape.
    """
    given = number_array(what, value)
    try:
        array = given if shape is None else np.broadcast_to(given, shape)
    except ValueError:
        raise ParameterError(f"{what} has shape {given.shape}; it must have shape {shape}") from None
    bad = np.isnan(array) if infinite else ~np.isfinite(array)
    if bad.any():
        place, element = first_element(bad)
        raise ParameterError(f"{what} is not finite{element}: {array[place]}")
    return array


def first_element(marked: NDArray[np.bool_]) -> tuple[tuple[int, ...], str]:
    """Return the index of the first True in `marked`, and how to name it in a message."""
    place = tuple(int(i) for i in np.argwhere(marked)[0])
    return place, f" (element {', '.join(map(str, place))})" if place else ""


def positive(error: type[Exception] = SimulationError, /, **values: float) -> None:
    """Refuse `values` [any], times and tolerances, that are zero, negative or not finite, by an `error`.

    Raises
    ------
    SimulationError
        Or that error, naming the argument and its value.
    """
    for name, value in values.items():
        try:
            good = not isinstance(value, bool) and math.isfinite(value) and value > 0
        except (TypeError, ValueError, OverflowError):
            good = False
        if not good:
            raise error(f"{name} = {shown(value)} must be a positive and finite number")


def positive_if_given(**values: float | None) -> None:
    """Refuse times and tolerances [any] like `positive`; None stands for a default.

    Raises
    ------
    SimulationError
        Naming the argument and its value.
    """
    positive(**{name: value for name, value in values.items() if value is not None})


def one_of(what: str, name: Any, allowed: Sequence[str], error: type[Exception] = SimulationError) -> None:
    """Refuse a `name` that is not among those `allowed`, saying `what` it should have been.

    Raises
    ------
    SimulationError
        Or that `error`, listing those there are.
    """
    if not isinstance(name, str) or name not in allowed:
        raise error(f"unknown {what} {shown(name)}; choose from: {', '.join(allowed)}")


def positive_whole(**values: Any) -> None:
    """Refuse numbers that are not 1, 2, 3 and so on.

    Raises
    ------
    SimulationError
        Naming the argument and its value.
    """
    for name, value in values.items():
        if not is_whole(value) or value < 1:
            raise SimulationError(f"{name} = {shown(value)} must be a positive whole number")


def is_whole(value: object) -> bool:
    """Tell whether a value is a whole number; True and False are none."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def as_shape(what: str, shape: Any) -> tuple[int, ...]:
    """Return a size, or several, as a shape.

    Parameters
    ----------
    what : str
        Whose shape it is, for messages.
    shape : int or sequence of int
        What was given [-].

    Raises
    ------
    BlockError
        If sizes are no whole numbers from 0 on, or there are more elements than memory holds.
    """
    sizes = tuple(shape) if isinstance(shape, tuple | list) else (shape,)
    if not all(is_whole(n) and n >= 0 for n in sizes):
        raise BlockError(f"{what} cannot have shape {shown(shape)}: sizes are non-negative whole numbers")
    if math.prod(sizes) > MOST_ELEMENTS:
        raise BlockError(
            f"{what} cannot have shape {shown(shape)}: a signal has at most {MOST_ELEMENTS:,} elements"
        )
    return tuple(int(n) for n in sizes)


def yes_or_no(owner: str, name: str, value: object) -> None:
    """Refuse the `value` of an option `name` of an `owner` if it is neither True nor False.

    Raises
    ------
    BlockError
        If so.
    """
    if not isinstance(value, bool | np.bool_):
        raise BlockError(f"{owner} needs {name}=True or {name}=False, not {shown(value)}")


def one_sign_each(owner: str, signs: Any, allowed: str, such: str) -> None:
    """Refuse `signs` that are no text of `allowed` ones, one for each input of an `owner`, `such` as these.

    Raises
    ------
    BlockError
        If so.
    """
    if not isinstance(signs, str) or not signs or set(signs) - set(allowed):
        raise BlockError(f"{owner} needs {such}, one for each input; got {shown(signs)}")


def by_name(what: str, values: Any, names: type | UnionType = str) -> Mapping[Any, Any]:
    """Return values that a user gave by name; None stands for none.

    Parameters
    ----------
    what : str
        What they are, for messages.
    values : mapping of str to object, or None
        What the user gave [any].
    names : type
        What names may be: text, or ports as well.

    Raises
    ------
    NameLookupError
        If it is no mapping, or a name is no text.
    """
    given = {} if values is None else values
    if not isinstance(given, Mapping):
        raise NameLookupError(f"{what} must be given by name, as a dict, not as {shown(values)}")
    for name in given:
        if not isinstance(name, names):
            raise NameLookupError(f"{what} must be given by name: {shown(name)} is no name")
    return given


def as_path(error: type[Exception], cannot: str, path: Any) -> Path:
    """Return the `path` of a file that a user gave, to be read or written.

    Parameters
    ----------
    error : type
        What to raise.
    cannot : str
        How its message begins.
    path : str or os.PathLike
        What the user gave; whether there is such a file is not looked at.

    Raises
    ------
    Exception
        That error, if no file can have such a name.
    """
    try:
        found = Path(path)
        good = bool(found.name)
        os.lstat(found)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass
    except (TypeError, ValueError, OSError):  # no text, with a NUL inside, too long
        good = False
    if not good:
        raise error(f"{cannot} {shown(path)}: give the path of a file as text, not too long and without NUL")
    return found


def frequencies(omega: Any, fewest: int = 1) -> Vector:
    """Return frequencies `omega` [rad/s], at least the `fewest` [-] that are needed, as a vector.

    Raises
    ------
    ParameterError
        If they are no numbers.
    LinearAnalysisError
        If one is not positive and finite, there are too few, or they are no list.
    """
    found = np.atleast_1d(number_array("omega", omega))
    if found.ndim > 1 or found.size < fewest:
        raise LinearAnalysisError(f"omega = {shown(omega)} must be a list of {fewest} or more frequencies")
    for each in found.tolist():
        positive(LinearAnalysisError, omega=each)
    return found

"""Checks of arguments from users: numbers, shapes, names."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import UnionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import (
    BlockError,
    LinearAnalysisError,
    NameLookupError,
    ParameterError,
    SimulationError,
)
from trussflow.blocks.support.summary import Described
from trussflow.blocks.support.types import Vector

MOST_ELEMENTS = 10_000_000
"""Largest number of elements of a signal; a larger one is an error that would exhaust the memory."""


def shown(value: object) -> str:
    """Return a short text of an argument from the user, for messages."""
    try:
        text = value._described().title if isinstance(value, Described) else repr(value)
    except ValueError:  # Python does not convert integers of more than 4300 digits
        text = f"a huge {type(value).__name__}"
    return text if len(text) <= 200 else f"{text[:200]}..."


def meant(name: str, names: Iterable[str]) -> str:
    """Return the end of a message about a misspelt `name`: the nearest of the `names`, or nothing."""
    near = difflib.get_close_matches(name, [*names], n=1)
    return f"; did you mean '{near[0]}'?" if near else ""


def number_array(what: str, value: Any) -> Vector:
    """Return a `value` [any] as a float array of its own shape; messages name it `what`.

    Raises
    ------
    ParameterError
        If it is not numeric: text, complex, masked, or lists of different lengths.
    """
    try:
        given = np.asarray(value)
        # Objects may be numbers, such as Fraction; None would become
        # NaN in the conversion.
        no_none = given.dtype.kind == "O" and all(
            element is not None for element in given.flat
        )
        # np.asarray() drops the mask, so the value itself is tested.
        if (given.dtype.kind in "biuf" or no_none) and not np.ma.is_masked(value):
            return given.astype(float)
    except (TypeError, ValueError, OverflowError):
        pass
    raise ParameterError(
        f"{what} must be numeric, not {shown(value)}; give one real number, or lists of equal length"
    )


def finite_array(
    what: str,
    value: Any,
    shape: tuple[int, ...] | None = None,
    *,
    infinite: bool = False,
) -> Vector:
    """Return a value as a float array of the required shape, finite by default.

    Parameters
    ----------
    what : str
        Name of the value, for messages.
    value : array_like
        Value from the user [any].
    shape : tuple of int, optional
        Required shape [-], to which the value is broadcast; by default any.
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
        raise ParameterError(
            f"{what} has shape {given.shape}; it must have shape {shape}"
        ) from None
    bad = np.isnan(array) if infinite else ~np.isfinite(array)
    if bad.any():
        place, element = first_element(bad)
        raise ParameterError(f"{what} is not finite{element}: {array[place]}")
    return array


def first_element(marked: NDArray[np.bool_]) -> tuple[tuple[int, ...], str]:
    """Return the index of the first True in `marked`, and its text for messages."""
    place = tuple(int(i) for i in np.argwhere(marked)[0])
    return place, f" (element {', '.join(map(str, place))})" if place else ""


def positive(error: type[Exception] = SimulationError, /, **values: float) -> None:
    """Check that `values` [any], such as times and tolerances, are positive and finite.

    Raises
    ------
    SimulationError
        Or the class `error`, with the argument and its value.
    """
    for name, value in values.items():
        try:
            # True is a number in Python, but not a time or a tolerance.
            good = not isinstance(value, bool) and math.isfinite(value) and value > 0
        except (TypeError, ValueError, OverflowError):
            good = False
        if not good:
            raise error(f"{name} = {shown(value)} must be a positive and finite number")


def positive_if_given(**values: float | None) -> None:
    """Check that values [any] are positive and finite, or None.

    Raises
    ------
    SimulationError
        With the argument and its value.
    """
    positive(**{name: value for name, value in values.items() if value is not None})


def one_of(
    what: str,
    name: Any,
    allowed: Sequence[str],
    error: type[Exception] = SimulationError,
) -> None:
    """Check that a `name` of the kind `what` is among those `allowed`.

    Raises
    ------
    SimulationError
        Or the class `error`, with a list of the valid names.
    """
    if not isinstance(name, str) or name not in allowed:
        raise error(f"unknown {what} {shown(name)}; choose from: {', '.join(allowed)}")


def positive_whole(**values: Any) -> None:
    """Check that values are whole numbers of at least 1.

    Raises
    ------
    SimulationError
        With the argument and its value.
    """
    for name, value in values.items():
        if not is_whole(value) or value < 1:
            raise SimulationError(
                f"{name} = {shown(value)} must be a positive whole number"
            )


def is_whole(value: object) -> bool:
    """Return whether a value is a whole number; True and False are not."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def as_shape(what: str, shape: Any) -> tuple[int, ...]:
    """Return one or several sizes as a shape.

    Parameters
    ----------
    what : str
        Name of the object, for messages.
    shape : int or sequence of int
        Size or sizes from the user [-].

    Raises
    ------
    BlockError
        If sizes are not whole numbers from 0 on, or there are too many elements.
    """
    sizes = tuple(shape) if isinstance(shape, tuple | list) else (shape,)
    if not all(is_whole(n) and n >= 0 for n in sizes):
        raise BlockError(
            f"{what} cannot have shape {shown(shape)}: sizes are non-negative whole numbers"
        )
    if math.prod(sizes) > MOST_ELEMENTS:
        raise BlockError(
            f"{what} cannot have shape {shown(shape)}: a signal has at most {MOST_ELEMENTS:,} elements"
        )
    return tuple(int(n) for n in sizes)


def yes_or_no(owner: str, name: str, value: object) -> None:
    """Check that the `value` of an option `name` of an `owner` is True or False.

    Raises
    ------
    BlockError
        If it is neither.
    """
    if not isinstance(value, bool | np.bool_):
        raise BlockError(
            f"{owner} needs {name}=True or {name}=False, not {shown(value)}"
        )


def one_sign_each(owner: str, signs: Any, allowed: str, such: str) -> None:
    """Check that `signs` of an `owner` is a text of `allowed` signs; messages give `such` examples.

    Raises
    ------
    BlockError
        If it is empty, not text, or has other characters.
    """
    if not isinstance(signs, str) or not signs or set(signs) - set(allowed):
        raise BlockError(
            f"{owner} needs {such}, one for each input; got {shown(signs)}"
        )


def by_name(what: str, values: Any, names: type | UnionType = str) -> Mapping[Any, Any]:
    """Return values from the user by name; None gives an empty mapping.

    Parameters
    ----------
    what : str
        Name of the argument, for messages.
    values : mapping of str to object, or None
        Values from the user [any].
    names : type
        Allowed types of names: text, or also ports.

    Raises
    ------
    NameLookupError
        If it is not a mapping, or a name has another type.
    """
    given = {} if values is None else values
    if not isinstance(given, Mapping):
        raise NameLookupError(
            f"{what} must be given by name, as a dict, not as {shown(values)}"
        )
    for name in given:
        if not isinstance(name, names):
            raise NameLookupError(
                f"{what} must be given by name: {shown(name)} is no name"
            )
    return given


def as_path(error: type[Exception], cannot: str, path: Any) -> Path:
    """Return the `path` of a file from the user, to be read or written.

    Parameters
    ----------
    error : type
        Class of the error.
    cannot : str
        Beginning of its message.
    path : str or os.PathLike
        Path from the user; the file need not exist.

    Raises
    ------
    Exception
        The `error`, if no file can have such a name.
    """
    try:
        found = Path(path)
        good = bool(found.name)
        # The system decides whether a file may have this name; the file need not exist.
        os.lstat(found)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        pass
    except (TypeError, ValueError, OSError):  # not text, contains NUL, or too long
        good = False
    if not good:
        raise error(
            f"{cannot} {shown(path)}: give the path of a file as text, not too long and without NUL"
        )
    return found


def frequencies(omega: Any, fewest: int = 1) -> Vector:
    """Return frequencies `omega` [rad/s] as a vector of at least `fewest` [-] elements.

    Raises
    ------
    ParameterError
        If they are not numbers.
    LinearAnalysisError
        If one is not positive and finite, there are too few, or they are not a list.
    """
    found = np.atleast_1d(number_array("omega", omega))
    if found.ndim > 1 or found.size < fewest:
        raise LinearAnalysisError(
            f"omega = {shown(omega)} must be a list of {fewest} or more frequencies"
        )
    for each in found.tolist():
        positive(LinearAnalysisError, omega=each)
    return found

"""Checks of numbers that users give."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.errors import ParameterError, SimulationError
from trussflow.blocks.framework.types import Vector


def finite_array(what: str, value: Any, shape: tuple[int, ...] | None = None) -> Vector:
    """Return a value as a float array of the shape wanted.

    Parameters
    ----------
    what : str
        What it is, for messages.
    value : array_like
        What the user gave [any].
    shape : tuple of int, optional
        Shape wanted; a value that can be broadcast to it is [-]. By default any.

    Raises
    ------
    ParameterError
        If it is not numeric, not finite, or has the wrong shape.
    """
    try:
        given = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ParameterError(f"{what} must be numeric, not {value!r}") from None
    try:
        array = given if shape is None else np.broadcast_to(given, shape)
    except ValueError:
        raise ParameterError(f"{what} has shape {given.shape}; it must have shape {shape}") from None
    bad = ~np.isfinite(array)
    if bad.any():
        place, element = first_element(bad)
        raise ParameterError(f"{what} is not finite{element}: {array[place]}")
    return array


def first_element(marked: NDArray[np.bool_]) -> tuple[tuple[int, ...], str]:
    """Return the index of the first True in `marked`, and how to name it in a message."""
    place = tuple(int(i) for i in np.argwhere(marked)[0])
    return place, f" (element {', '.join(map(str, place))})" if place else ""


def positive(**values: float) -> None:
    """Refuse times and tolerances [any] that are zero, negative or not finite.

    Raises
    ------
    SimulationError
        Naming the argument and its value.
    """
    for name, value in values.items():
        try:
            good = math.isfinite(value) and value > 0
        except TypeError:
            good = False
        if not good:
            raise SimulationError(f"{name} = {value!r} must be a positive and finite number")


def positive_if_given(**values: float | None) -> None:
    """Refuse times and tolerances [any] like `positive`; None stands for a default.

    Raises
    ------
    SimulationError
        Naming the argument and its value.
    """
    positive(**{name: value for name, value in values.items() if value is not None})


def one_of(what: str, name: str, allowed: Sequence[str]) -> None:
    """Refuse a `name` that is not among those `allowed`, saying `what` it should have been.

    Raises
    ------
    SimulationError
        Listing those there are.
    """
    if name not in allowed:
        raise SimulationError(f"unknown {what} {name!r}; choose from: {', '.join(allowed)}")


def positive_whole(**values: Any) -> None:
    """Refuse numbers that are not 1, 2, 3 and so on.

    Raises
    ------
    SimulationError
        Naming the argument and its value.
    """
    for name, value in values.items():
        if not isinstance(value, int | np.integer) or value < 1:
            raise SimulationError(f"{name} = {value!r} must be a positive whole number")

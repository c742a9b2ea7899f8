"""Histories of signals: the points that a run stores in d, their search, and interpolation between them.

The layout of a history in d, and the search in C, are in ``history.h``; ``events.h`` stores points in C.
"""

from __future__ import annotations

from functools import cache, partial
from math import prod

import casadi as ca
import numpy as np

from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.c_function import NumPyFunction, c_kernel
from trussflow.blocks.tracing.kernels import (
    Kernel,
    call_kernel,
    column_of,
    from_expression,
    is_traced,
)
from trussflow.blocks.tracing.operations import c_file

HEADER_SIZE = 4
"""Count of the numbers before the points, as in history.h [-]."""

NO_POINT = 1e100
"""Time of a missing point, as in history.h [s]."""

TIME_TOLERANCE, JUMP_TOLERANCE, ROUND_OFF = 1e-9, 1e-7, 1e-12
"""Tolerance of equal times, relative to the delay; smallest change at equal times that is a jump, relative to the
element; round-off of an element, relative to the largest one. As in events.h.
"""


def empty(room: int, size: int, longest: float) -> Vector:
    """Return a history without points.

    Parameters
    ----------
    room : int
        Largest number of points [-].
    size : int
        Size of the signal [-].
    longest : float
        Longest time for which points are needed [s].
    """
    header = [0.0, room, size, longest]
    return np.concatenate([header, np.zeros(room * (2 + size))])


def store(history: Vector, t: float, values: Vector) -> None:
    """Store the `values` of a signal at time `t` [s] in its `history`; see ``tf_store`` in events.h."""
    count, room, _, longest = history[:HEADER_SIZE]
    ring = history[HEADER_SIZE:].reshape(int(room), -1)
    number, piece = int(count), 1.0
    if number:
        last = ring[(number - 1) % len(ring)]
        piece = last[1]
        if t - last[0] <= TIME_TOLERANCE * longest:
            near = [ring[i % len(ring)] for i in range(max(0, number - 4), number)]
            sizes = np.max([np.abs(p[2:]) for p in near if p[1] == piece], axis=0)
            noise = ROUND_OFF * sizes.max(initial=0.0)
            moved = np.abs(values - last[2:])
            if not (moved > np.maximum(noise, JUMP_TOLERANCE * sizes)).any():
                return
            # A piece of one point at this time has no length: the new value replaces it.
            if number == 1 or ring[(number - 2) % len(ring)][1] != piece:
                last[2:] = values
                return
            piece += 1.0
    ring[number % len(ring)] = [t, piece, *values]
    history[0] += 1.0


def too_short(history: Vector) -> bool:
    """Return whether a point that is needed was replaced in a `history` [any]."""
    number, room, _, longest = history[:HEADER_SIZE]
    times = history[HEADER_SIZE:].reshape(int(room), -1)[:, 0]
    oldest, last = (times[int(i % room)] for i in (number + 1, number - 1))
    return bool(number > room and oldest > last - longest)


def count(history: Array) -> Array:
    """Return the number of points stored so far; traced, a history is only this number."""
    return np.reshape(history, (-1,))[0]


def search(history: Array, size: int, piece: Array, t: Array) -> Array:
    """Return what the points around a time tell: a column.

    They are the first time of the next piece, the last time of all (infinite if there is none), the number of
    the piece at `t` (zero before the first), and the times and values of four points of the given piece, two
    on each side of `t`. A missing point has a time so large that its weight is zero.

    Parameters
    ----------
    history : array
        The history, as a block reads it.
    size : int
        Size of the signal [-].
    piece : array, shape ()
        Number of the piece, from 1 [-].
    t : array, shape ()
        Time [s].
    """
    if is_traced(history):
        call = call_kernel(_kernel(size), column_of([history, piece, t]))
        return from_expression(call.symbols, (7 + 4 * size,))
    return _searched(size, np.array([0.0, piece, t]), np.ravel(history))


def interpolated(found: Array, t: Array, shape: tuple[int, ...]) -> Array:
    """Return the signal of a `shape` at time `t` [s], by Lagrange's cubic in the points `found` by `search`."""
    times, values = found[3:7], np.reshape(found[7:], (4, -1))
    terms = [
        prod((t - times[j]) / (times[i] - times[j]) for j in range(4) if j != i)
        * values[i]
        for i in range(4)
    ]
    return np.reshape(sum(terms), shape)


def _searched(size: int, given: Vector, history: Vector) -> Vector:
    """Return the results of `search` in NumPy; the same as in history.h."""
    _, piece, t = given
    points = np.zeros((0, 2 + size))
    if history.size > HEADER_SIZE:
        number, room = int(history[0]), int(history[1])
        ring = history[HEADER_SIZE:][: room * (2 + size)].reshape(room, -1)
        points = ring[np.arange(max(0, number - room), number) % room]
    k = int(np.searchsorted(points[:, 0], t, side="right"))
    begin, end = np.searchsorted(points[:, 1], [piece - 1.0, piece], side="right")
    result = np.array([np.inf, np.inf, 0.0, *(NO_POINT * np.arange(1, 5))])
    if end < len(points):
        result[0] = points[end, 0]
    if len(points):
        result[1] = points[-1, 0]
    if k:
        result[2] = points[k - 1, 1]
    k = min(k, end - 1)
    values = np.zeros((4, size))
    for i, place in enumerate(range(k - 2, k + 2)):
        if begin <= place < end:
            result[3 + i] = points[place, 0]
            values[i] = points[place, 2:]
    return np.concatenate([result, values.ravel()])


class _Search(NumPyFunction):
    """Callback of CasADi for `search`, with the numbers of d from the history on."""

    def __init__(self, size: int, numbers: int) -> None:
        super().__init__("history", 3 + numbers, 7 + 4 * size)
        self._size = size

    def value(self, argument: Vector) -> Vector:
        return _searched(self._size, argument[:3], argument[3:])


@cache
def _kernel(size: int) -> Kernel:
    """Return the kernel of `search`; stored points do not depend on the states, so its derivative is zero."""
    reads = cache(partial(_Search, size))
    return c_kernel(
        reads(1),
        c_file("history.h"),
        "tf_search(d, in[1], in[2], out);",
        partial(_constant, size),
        reads,
    )


def _constant(size: int) -> ca.Function:
    """Return a function with results of `search` that are finite, and not zero, which would hide the time."""
    found = np.ones(7 + 4 * size)
    found[3:7] = NO_POINT * np.arange(1, 5)
    return ca.Function("history_constant", [ca.SX.sym("in", 3)], [ca.SX(ca.DM(found))])

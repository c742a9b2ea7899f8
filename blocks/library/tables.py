"""Tables: linear interpolation between given points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Signals
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.piecewise import limited, piece, row_for_each
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array, shown, yes_or_no


class Interpolation:
    """Linear interpolation that can be traced.

    The points become constants of the compiled code, and each evaluation uses every point. For more than
    some hundred points, use a `PythonFunction`.

    Parameters
    ----------
    owner : str
        Name of the block, for messages.
    points : array_like, shape (k,)
        At least two increasing points [any].
    values : array_like, shape (k,) or (k, n)
        One row for each point [any].
    extrapolate : bool
        Whether the first and the last piece are extrapolated; otherwise the end values are held.

    Raises
    ------
    BlockError
        If the points do not increase, or the values do not match them.
    """

    def __init__(
        self,
        owner: str,
        points: npt.ArrayLike,
        values: npt.ArrayLike,
        extrapolate: bool,
    ) -> None:
        self.points, self.values = p, v = row_for_each(
            owner, points=points, values=values
        )
        yes_or_no(owner, "extrapolate", extrapolate)
        self.extrapolate = extrapolate
        # One span per row, with axes of length 1 for the elements of a value.
        span = np.diff(p).reshape(-1, *(1,) * (v.ndim - 1))
        self.slopes: Vector = np.diff(v, axis=0) / span

    def __call__(self, x: Array) -> Array:
        """Return the interpolated values; rows need a scalar `x`."""
        if not self.extrapolate:
            x = limited(x, self.points[0], self.points[-1])
        start, value, slope = piece(
            x, self.points[:-1], [self.points[:-1], self.values[:-1], self.slopes]
        )
        return value + slope * (x - start)


class Table(Block):
    """Look up each element of the input in a table, by linear interpolation.

    Parameters
    ----------
    points, values : array_like, shape (k,)
        Increasing inputs, and the outputs at these points [input unit, output unit].
    extrapolate : bool
        Whether the first and the last piece are extrapolated; otherwise the end values are held.
    input_unit, output_unit : str, tuple of str or None
        Units of input and output; None leaves them unchecked.

    Raises
    ------
    BlockError
        If the points do not increase, or the values do not match them.
    """

    u = Input(INFERRED, unit=Attribute("input_unit"), meaning="independent variable")
    y = Output(INFERRED, unit=Attribute("output_unit"), meaning="interpolated value")
    _symbol = Symbol(curve="M2 21L10 14L18 12L26 5L34 3")

    def __init__(
        self,
        points: npt.ArrayLike,
        values: npt.ArrayLike,
        *,
        extrapolate: bool = False,
        input_unit: Unit = None,
        output_unit: Unit = None,
    ) -> None:
        self.input_unit, self.output_unit = input_unit, output_unit
        self._table = Interpolation("Table", points, values, extrapolate)
        if self._table.values.ndim != 1:
            raise BlockError(
                f"Table has values of shape {self._table.values.shape}; it returns one number "
                "per element of its input. Add one Table for each column"
            )
        super().__init__()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the interpolated values."""
        return {"y": self._table(u.u)}


def listed(given: object) -> list[Any]:
    """Return the elements of `given` as a list; it is empty if the argument is not a sequence."""
    if isinstance(given, Sequence) or (
        isinstance(given, np.ndarray) and given.ndim > 0
    ):
        return list(given)
    return []


class GridTable(Block):
    r"""Look up a number or an array in a table of several variables, by multilinear interpolation.

    .. math:: y = \sum_{i, j, \dots} w_i(u_1) w_j(u_2) \cdots v_{i j \cdots}

    with the hat functions w of each axis. Each evaluation uses every point of the grid. For more than some
    thousand points, use a `PythonFunction`.

    Parameters
    ----------
    axes : sequence of array_like
        Increasing points of each variable [unit of that input]; the inputs are named ``u1``, ``u2``, ...
    values : array_like
        Outputs on the grid, with one axis for each variable, followed by the axes of y [output unit].
    extrapolate : bool
        Whether the first and the last piece are extrapolated; otherwise the end values are held.
    units : sequence of str, optional
        Unit of each input; by default unchecked.
    output_unit : str, tuple of str or None
        Unit of the output; None leaves it unchecked.

    Raises
    ------
    BlockError
        If points do not increase, or the values do not match them.
    """

    y = Output("shape", unit=Attribute("output_unit"), meaning="interpolated value")
    _symbol = Symbol(curve="M2 21L10 14L18 12L26 5L34 3M2 15L12 9L22 8L34 1")

    def __init__(
        self,
        axes: Sequence[npt.ArrayLike],
        values: npt.ArrayLike,
        *,
        extrapolate: bool = False,
        units: Sequence[str] | None = None,
        output_unit: Unit = None,
    ) -> None:
        points = [
            np.atleast_1d(finite_array("axes of GridTable", each))
            for each in listed(axes)
        ]
        self.values, sizes = (
            finite_array("values of GridTable", values),
            tuple(map(len, points)),
        )
        if not points or self.values.shape[: len(points)] != sizes:
            raise BlockError(
                f"GridTable has axes of {sizes} points, but values of shape {self.values.shape}"
            )
        self._hats = [
            # Interpolated rows of the identity are the hat functions of the points.
            Interpolation("GridTable", each, np.eye(len(each)), extrapolate)
            for each in points
        ]
        count = len(points)
        each_unit = [None] * count if units is None else listed(units)
        if isinstance(units, str) or len(each_unit) != count:
            raise BlockError(
                f"GridTable has {count} inputs; give a list of as many units, not {shown(units)}"
            )
        self.shape, self.output_unit = self.values.shape[len(points) :], output_unit
        self.extra_ports = {
            f"u{i}": Input(unit=unit, meaning=f"variable {i}")
            for i, unit in enumerate(each_unit, 1)
        }
        super().__init__()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the interpolated value."""
        found: Array = self.values
        for i, hats in enumerate(self._hats, 1):
            # Contract the first axis that is left: weights @ (points, other elements).
            rows = np.reshape(found, (len(hats.points), -1))
            found = np.reshape(hats(u[f"u{i}"]) @ rows, self.values.shape[i:])
        return {"y": found}


class TimeTable(Block):
    """Interpolate a table over time linearly.

    Parameters
    ----------
    times : array_like, shape (k,)
        Increasing times [s].
    values : array_like, shape (k,) or (k, n)
        One number, or one row, for each time [unit].
    extrapolate : bool
        Whether the first and the last piece are extrapolated; otherwise the end values are held.
    unit : str, tuple of str or None
        Unit of the output, or one per element; None leaves it unchecked.

    Raises
    ------
    BlockError
        If the times do not increase, or the values do not match them.
    """

    y = Output("shape", unit=Attribute("unit"), meaning="interpolated value")
    _symbol = Symbol(curve="M2 20L9 6L18 6L24 16L34 10")

    def __init__(
        self,
        times: npt.ArrayLike,
        values: npt.ArrayLike,
        *,
        extrapolate: bool = False,
        unit: Unit = None,
    ) -> None:
        self._table = Interpolation("TimeTable", times, values, extrapolate)
        self.shape, self.unit = self._table.values.shape[1:], unit
        super().__init__()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the interpolated value."""
        return {"y": self._table(t)}

    def breakpoints(self) -> tuple[float, ...]:
        """Return the times of the table, where the slope jumps."""
        return tuple(float(t) for t in self._table.points)

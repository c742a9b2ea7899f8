r"""Uncertain linear models: a linear fractional function of the parameters.

.. math:: \begin{bmatrix} A & B \\ C & D \end{bmatrix}(\delta) =
          M_0 + U\,\Delta\,(I - Q\,\Delta)^{-1} P, \qquad
          \Delta = \mathrm{diag}(\delta_1 I, \ldots, \delta_k I), \quad |\delta_i| \le 1
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, combinations_with_replacement, product
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.margins import on_the_border
from trussflow.blocks.linear_analysis.operating_point import OperatingPoint, given_point
from trussflow.blocks.linear_analysis.references import References
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import by_name, finite_array, shown

if TYPE_CHECKING:
    from trussflow.blocks.linear_analysis.linear_model import LinearModel

ROUND_OFF_TOLERANCE = 1e-9
"""Relative tolerance below which a change counts as round-off [-]."""

COMPARED_MEMBERS = 8
"""Number of random members to which the fractional model is compared [-]."""

Ranges = Mapping[str, tuple[Array, Array]]
"""Least and greatest value by name."""

Polynomial = dict[tuple[int, ...], Array]
"""Coefficients by powers of the parameters."""


@dataclass(frozen=True, slots=True)
class Fractions:
    """The matrices of a linear fractional function.

    Attributes
    ----------
    nominal : Vector
        M_0, of the rows of A and C, and the columns of A and B [any].
    left, inner, right : Vector
        U, Q and P [any].
    sizes : tuple of int
        Multiplicity of each δ in Δ [-].
    """

    nominal: Vector
    left: Vector
    inner: Vector
    right: Vector
    sizes: tuple[int, ...]

    def at(self, delta: Vector) -> Vector:
        """Return the function where the parameters are `delta` [1]."""
        each = np.repeat(delta, self.sizes)
        mixed = np.eye(len(each)) - self.inner * each
        return self.nominal + (self.left * each) @ np.linalg.solve(mixed, self.right)


def quadratic(function: Callable[[Vector], Vector], count: int) -> Polynomial:
    """Return the quadratic function through 0, both ends of each variable, and the corners of each two.

    Parameters
    ----------
    function : callable
        Takes variables from -1 to 1 and returns an array.
    count : int
        Number of variables [-].
    """
    axes = np.eye(count)
    one = np.eye(count, dtype=int)
    middle = function(np.zeros(count))
    found = {(0,) * count: middle}
    for i in range(count):
        up, down = function(axes[i]), function(-axes[i])
        found[tuple(one[i])] = (up - down) / 2.0
        found[tuple(2 * one[i])] = (up + down) / 2.0 - middle
    for i, j in combinations(range(count), 2):
        corners = [
            # The sum with these signs cancels all terms but that of the product.
            a * b * function(a * axes[i] + b * axes[j])
            for a, b in product((1, -1), repeat=2)
        ]
        found[tuple(one[i] + one[j])] = np.sum(corners, axis=0) / 4.0
    return found


def fractions_of(
    family: Callable[[Vector], Vector], count: int, balance: tuple[Vector, Vector]
) -> Fractions:
    """Return the function that is quadratic in the parameters, and exact at ±1 of each of them alone.

    Parameters
    ----------
    family : callable
        Takes k numbers from -1 to 1 and returns [[A, B], [C, D]].
    count : int
        k [-].
    balance : tuple of Vector
        Scales of rows and columns before ranks are determined [any].
    """
    rows, columns = balance

    def scaled(delta: Vector) -> Vector:
        return family(delta) / rows[:, None] / columns

    found = quadratic(scaled, count)
    one = np.eye(count, dtype=int)
    middle = found[(0,) * count]
    first = [found[tuple(power)] for power in one]
    pairs = combinations_with_replacement(range(count), 2)
    second = {(i, j): found[tuple(one[i] + one[j])] for i, j in pairs}
    # Ranks are relative to the linear terms: second differences of a linear function
    # are round-off of this size.
    size = max((float(np.linalg.norm(one)) for one in first), default=0.0)
    # Horner's form: δ_i (M_i + sum over j >= i of M_ij δ_j). The inner products share their rows by j, and
    # what δ_i multiplies shares its columns by i.
    inner = [_rows_of([second[i, j] for i in range(j + 1)], size) for j in range(count)]
    outer = [
        _rows_of([first[i].T, *(second[i, j].T for j in range(i, count))], size).T
        for i in range(count)
    ]
    sizes = [(u.shape[1], v.shape[0]) for u, v in zip(outer, inner, strict=True)]
    left = np.hstack(
        [
            np.hstack([u, np.zeros((len(middle), b))])
            for u, (_, b) in zip(outer, sizes, strict=True)
        ]
    )
    right = np.vstack(
        [np.vstack([u.T @ m, v]) for u, m, v in zip(outer, first, inner, strict=True)]
    )
    mixed = np.zeros((len(right), len(right)))
    starts = np.cumsum([0, *(a + b for a, b in sizes)])
    for (i, j), bend in second.items():
        (a, _), (before, b) = sizes[i], sizes[j]
        place = slice(starts[j] + before, starts[j] + before + b)
        mixed[starts[i] : starts[i] + a, place] = outer[i].T @ bend @ inner[j].T
    repeats = tuple(a + b for a, b in sizes)
    return Fractions(
        middle * rows[:, None] * columns,
        left * rows[:, None],
        mixed,
        right * columns,
        repeats,
    )


def _rows_of(matrices: Sequence[Vector], size: float) -> Vector:
    """Return orthonormal rows that span those of all matrices, but for what is round-off beside `size`."""
    _, values, rows = np.linalg.svd(np.vstack(matrices), full_matrices=False)
    found: Vector = rows[values > ROUND_OFF_TOLERANCE * size]
    return found


@dataclass(frozen=True, eq=False)
class UncertainModel:
    """A linear model with parameters within ranges.

    Attributes
    ----------
    ranges : dict
        Least and greatest value of each parameter [as declared].
    nominal : LinearModel
        In the middle of all ranges.
    family : callable
        Takes a number from -1 to 1 for each parameter and returns the diagram's own linear model there.
    fractions : Fractions
        [[A, B], [C, D]] as a linear fractional function of those numbers.
    """

    ranges: Ranges
    nominal: LinearModel
    family: Callable[[Vector], LinearModel]
    fractions: Fractions

    def values(self, delta: Sequence[float] | Vector) -> dict[str, Array]:
        """Return the parameters at numbers from -1 to 1.

        Parameters
        ----------
        delta : sequence of float
            One for each parameter [1].

        Raises
        ------
        ParameterError
            If there are more or fewer of them, or one is not finite.
        """
        return _values(
            self.ranges,
            finite_array("numbers from -1 to 1", delta, (len(self.ranges),)),
        )

    def response(self, omega: float) -> Vector:
        """Return the response from the outputs of Δ and the inputs to the inputs of Δ and the outputs.

        Parameters
        ----------
        omega : float
            [rad/s].

        Raises
        ------
        LinearAnalysisError
            If the nominal model has a pole there.
        """
        f = self.fractions
        n = self.nominal.nstates
        states = (
            on_the_border(self.nominal, np.asarray(omega)) * np.eye(n)
            - f.nominal[:n, :n]
        )
        into = np.hstack([f.left[:n], f.nominal[:n, n:]])
        out = np.vstack([f.right[:, :n], f.nominal[n:, :n]])
        through = np.block([[f.inner, f.right[:, n:]], [f.left[n:], f.nominal[n:, n:]]])
        try:
            found: Vector = through + out @ np.linalg.solve(states, into)
        except np.linalg.LinAlgError as error:
            raise LinearAnalysisError(
                f"the nominal model has a pole at {omega:g} rad/s; leave that frequency out"
            ) from error
        return found

    @cached_property
    def misfit(self) -> float:
        """Largest error of the fractions, relative to the difference of a member from the nominal model [-].

        The members are a few random ones, the same in each process; norms are those of balanced matrices. The
        error of gains at resonances may be larger: `worst_gain` compares these gains.
        """
        f = self.fractions
        found = 0.0
        rows, columns = _balance(self.nominal)
        for delta in np.random.default_rng(0).uniform(
            -1.0, 1.0, (COMPARED_MEMBERS, len(f.sizes))
        ):
            exact = _stacked(self.family(delta))
            missed, changed = (
                float(np.linalg.norm((exact - one) / rows[:, None] / columns))
                for one in (f.at(delta), f.nominal)
            )
            found = max(found, missed / changed if changed else 0.0)
        return found


def uncertain(
    item: Block,
    inputs: References,
    outputs: References,
    parameters: Mapping[str, Any],
    *,
    becoming: Callable[..., Mapping[str, Any]] | None = None,
    at: OperatingPoint | None = None,
    cut: References = (),
) -> UncertainModel:
    r"""Return the linear model of a diagram whose parameters are uncertain.

    Its matrices are exact Jacobians at the middle of all ranges, at both ends of each range, and at the corners
    of each pair of ranges. Between these points, they are quadratic functions of the parameters, written as a
    linear fractional function (Zhou, Doyle, Glover 1996, *Robust and Optimal Control*, chapter 10).
    `UncertainModel.misfit` is the error of this interpolation.

    Parameters
    ----------
    item : Block
        A diagram, or a single block.
    inputs, outputs : Port, str or sequence of these
        As of `linearize`.
    parameters : mapping
        Range by ``"block.parameter"``: least and greatest value, or a number r for ±r times the nominal value.
        Elements of an array change together.
    becoming : callable, optional
        Function of the `parameters` as keywords that returns parameters of the diagram, for uncertain numbers
        that change several parameters. All ranges must then be least and greatest value.
    at : OperatingPoint, optional
        Operating point, the same for all parameters.
    cut : Port, str or sequence of these
        As of `linearize`.

    Returns
    -------
    UncertainModel

    Raises
    ------
    LinearAnalysisError
        If a range is invalid or has no effect, a relative range names no parameter, or as for `linearize`.
    NameLookupError
        If there is no such parameter.
    ParameterError
        If an end of a range is no finite number.
    """
    linearizer = Linearizer(item, inputs, outputs, cut=cut)
    at = given_point(at)
    own = {} if becoming is not None else {**linearizer.parameters(), **at.parameters}
    given = by_name("uncertain parameters", parameters)
    if not given:
        raise LinearAnalysisError(
            "nothing is uncertain: name parameters, as {'block.parameter': 0.1}"
        )
    ranges = {
        name: _range(name, value, own, becoming is not None)
        for name, value in given.items()
    }

    def model(delta: Vector) -> LinearModel:
        values = _values(ranges, delta)
        changed = values if becoming is None else becoming(**values)
        return linearizer.at(replace(at, parameters={**at.parameters, **changed}))

    nominal = model(np.zeros(len(ranges)))

    def family(delta: Vector) -> LinearModel:
        found = model(delta)
        if found.nstates != nominal.nstates:
            raise LinearAnalysisError(
                f"'{item.name}' has {found.nstates} states at some parameters and {nominal.nstates} at "
                "others; avoid values that disable a part of it"
            )
        return found

    fractions = fractions_of(
        lambda delta: _stacked(family(delta)), len(ranges), _balance(nominal)
    )
    for name, size in zip(ranges, fractions.sizes, strict=True):
        if not size:
            raise LinearAnalysisError(
                f"'{name}' changes nothing between these inputs and outputs; leave it out"
            )
    return UncertainModel(ranges, nominal, family, fractions)


def _values(ranges: Ranges, delta: Vector) -> dict[str, Array]:
    """Return the parameters at numbers from -1 to 1."""
    return {
        name: (low + high) / 2.0 + (high - low) / 2.0 * d
        for (name, (low, high)), d in zip(ranges.items(), delta, strict=True)
    }


def _range(
    name: str, value: Any, own: Mapping[str, Array], pair: bool
) -> tuple[Array, Array]:
    """Return least and greatest value of a parameter."""
    if isinstance(value, tuple | list) and len(value) == 2:
        ends = [finite_array(f"range of '{name}'", end) for end in value]
        if ends[0].shape != ends[1].shape:
            raise LinearAnalysisError(
                f"the ends of the range of '{name}' have different shapes"
            )
    elif pair or np.ndim(value):
        raise LinearAnalysisError(
            f"the range of '{name}' is {shown(value)}; give (least, greatest)"
        )
    else:
        share = float(finite_array(f"range of '{name}'", value, ()))
        if name not in own:
            raise LinearAnalysisError(
                f"there is no parameter '{name}'; there are: {', '.join(own)}"
            )
        ends = [own[name] * (1.0 - share), own[name] * (1.0 + share)]
    # By element: shares of negative values, and ends in any order, are allowed.
    low = np.minimum(*ends)
    high = np.maximum(*ends)
    if np.all(low == high):
        raise LinearAnalysisError(
            f"the range of '{name}' leaves no room: {shown(value)}"
        )
    return low, high


def _stacked(model: LinearModel) -> Vector:
    return np.block([[model.A, model.B], [model.C, model.D]])


def _balance(model: LinearModel) -> tuple[Vector, Vector]:
    """Return divisors of the rows and columns of [[A, B], [C, D]] that make its elements similar in size."""
    _, (scale, _) = scipy.linalg.matrix_balance(model.A, permute=False, separate=True)
    rows, columns = (
        np.ones(n)
        for n in (model.nstates + model.noutputs, model.nstates + model.ninputs)
    )
    rows[: model.nstates], columns[: model.nstates] = scale, 1.0 / scale
    for ends, along in ((rows, 1), (columns, 0)):
        matrix = _stacked(model) / rows[:, None] / columns
        largest = np.max(np.abs(matrix), axis=along)[model.nstates :]
        ends[model.nstates :] = np.where(largest > 0.0, largest, 1.0)
    return rows, columns

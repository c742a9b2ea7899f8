r"""The greatest gain of an uncertain model, by branch and bound.

Boxes of parameters are split until the greatest gain that was found in one, times 1 + tolerance, bounds
them all (Balakrishnan, Boyd, Balemi 1991, *Branch and bound algorithm for computing the minimum stability
degree of parameter-dependent linear systems*, International Journal of Robust and Nonlinear Control 1). The
gain's power series bounds each box.
"""

from __future__ import annotations

import heapq
import sys
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.linear_analysis.margins import response
from trussflow.blocks.linear_analysis.uncertainty.gain_series import (
    MAX_CORNER_PARAMETERS,
    GainSeries,
    corners,
)
from trussflow.blocks.linear_analysis.uncertainty.uncertain_model import UncertainModel
from trussflow.blocks.support.call_site import warn
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array, positive

if TYPE_CHECKING:
    from trussflow.blocks.linear_analysis.linear_model import LinearModel

EDGE_TOLERANCE = 1e-6
"""Growth rate, relative to the fastest pole, that counts as the edge of stability [-]."""

ASCENT_EVALUATIONS = 50
"""Gain evaluations per parameter of the local ascent from a member [-]."""


class WorstGain(NamedTuple):
    """The greatest gain at each frequency.

    Attributes
    ----------
    omega : Vector, shape (k,)
        [rad/s].
    reached : Vector, shape (k,)
        Largest singular value, from all inputs to all outputs, of the worst member found [their units].
    bound : Vector, shape (k,)
        Upper bound on this value over all members of the fractional model; infinite if a member may have a
        pole at this frequency [their units].
    parameters : tuple of dict
        Parameters of the worst members [as declared].
    boxes : Vector, shape (k,)
        Number of boxes [-].
    """

    omega: Vector
    reached: Vector
    bound: Vector
    parameters: tuple[dict[str, Array], ...]
    boxes: Vector


class _Gain:
    """The gain at one frequency, as a function of the parameters."""

    def __init__(self, model: UncertainModel, omega: float) -> None:
        self.sizes = model.fractions.sizes
        self.places = spans(self.sizes)
        k = sum(self.sizes)
        N = model.response(omega)
        self.N11, self.N12, self.N21, self.N22 = (
            N[:k, :k],
            N[:k, k:],
            N[k:, :k],
            N[k:, k:],
        )

    def within(self, centre: Vector, half: Vector) -> Vector:
        """Return the map from Δ', with elements from -1 to 1, and the inputs, for δ = `centre` + `half` Δ'."""
        at = np.repeat(centre, self.sizes)
        reach = np.repeat(half, self.sizes)
        # `N11 * at` scales the columns: it is N11 Δ for a diagonal Δ.
        closed = np.linalg.solve(
            np.eye(len(at)) - self.N11 * at, np.hstack([self.N11 * reach, self.N12])
        )
        below = np.hstack([self.N21 * reach, self.N22]) + (self.N21 * at) @ closed
        return np.vstack([closed, below])

    def at(self, delta: Vector) -> float:
        """Return the gain of one member; it is infinite if the member has a pole at this frequency."""
        try:
            found = self.within(delta, np.zeros(len(delta)))
        except np.linalg.LinAlgError:
            return np.inf
        return float(np.linalg.norm(found[len(self.N11) :, len(self.N11) :], 2))

    def climbed(self, delta: Vector) -> Vector:
        """Return a member near `delta` with at least the same gain, by a local ascent."""
        from scipy.optimize import minimize

        settings: Any = {
            "method": "Nelder-Mead",
            "options": {"maxfev": ASCENT_EVALUATIONS * len(delta)},
        }

        def lost(delta: Vector) -> float:
            # Differences of infinite values would be NaN in the simplex method.
            return -min(self.at(delta), sys.float_info.max)

        found = minimize(lost, delta, bounds=[(-1.0, 1.0)] * len(delta), **settings)
        return max(np.asarray(found.x), delta, key=self.at)


def worst_gain(
    model: UncertainModel,
    omega: npt.ArrayLike,
    *,
    tolerance: float = 0.05,
    boxes: int = 2000,
) -> WorstGain:
    """Return the greatest gain found at each frequency, and an upper bound for all members.

    Parameters
    ----------
    model : UncertainModel
        From `uncertain`.
    omega : array_like, shape (k,)
        Frequencies; the bound does not hold between them [rad/s].
    tolerance : float
        Relative gap allowed between both bounds [-].
    boxes : int
        Largest number of boxes of parameters for each frequency; fewer boxes give a looser bound [-].

    Returns
    -------
    WorstGain
        The gains and their bounds.

    Raises
    ------
    LinearAnalysisError
        If a frequency is not at least 0, tolerance or boxes are not above 0, or the model is unstable in the
        middle or at a corner of the ranges. `robust_stability` proves that all members are stable.

    Warns
    -----
    SimulationWarning
        If the gain of the diagram at a worst member differs from that of the fractional model by more than the
        tolerance. The bound holds for the fractional model only.
    """
    frequencies = np.atleast_1d(finite_array("frequencies", omega))
    positive(LinearAnalysisError, tolerance=tolerance, boxes=boxes)
    if frequencies.ndim > 1 or not frequencies.size or np.any(frequencies < 0.0):
        raise LinearAnalysisError("frequencies must be a row of numbers, none below 0")
    for delta in _members(len(model.ranges)):
        if _grows(model.family(delta)):
            raise LinearAnalysisError(
                f"with {model.values(delta)} the model is unstable, and so has no gain; close its loop "
                "first, or use narrower ranges"
            )
    found = [
        _worst(_Gain(model, float(w)), len(model.ranges), tolerance, boxes)
        for w in frequencies
    ]
    reached, bound, where, count = zip(*found, strict=True)
    for w, gain, delta in zip(frequencies, reached, where, strict=True):
        if gain == np.inf:
            continue
        exact = float(
            np.linalg.norm(response(model.family(delta), np.array([w]))[0], 2)
        )
        if abs(exact - gain) > tolerance * gain:
            warn(
                f"at {w:g} rad/s the diagram itself has a gain of {exact:.4g} where its fractional model has "
                f"{gain:.4g}, so that the bounds do not hold for the diagram: use narrower ranges, or look for "
                "states that jump or change their sign"
            )
            break
    parameters = tuple(model.values(delta) for delta in where)
    return WorstGain(
        frequencies, np.array(reached), np.array(bound), parameters, np.array(count)
    )


def _members(count: int) -> list[Vector]:
    """Return the first members to evaluate: the middle, and all corners if there are few."""
    return [
        np.zeros(count),
        *(corners(count) if count <= MAX_CORNER_PARAMETERS else ()),
    ]


def _grows(model: LinearModel) -> bool:
    """Return whether a linear model is unstable."""
    poles = model.poles()
    growth = (
        # Growth per sample; a pole at zero has no logarithm.
        np.log(np.maximum(np.abs(poles), sys.float_info.min))
        if model.dt
        else poles.real
    )
    return bool(
        np.max(growth, initial=0.0)
        > EDGE_TOLERANCE * max(np.max(np.abs(poles), initial=0.0), 1.0)
    )


def _worst(
    gain: _Gain, count: int, tolerance: float, most: int
) -> tuple[float, float, Vector, int]:
    """Return the greatest gain found, the upper bound, the parameters found, and the number of boxes."""
    place = gain.climbed(max(_members(count), key=gain.at))
    best = gain.at(place)
    looked = 1
    axes = np.eye(count)
    left: list[tuple[float, int, Vector, Vector, int]] = []

    def keep(centre: Vector, half: Vector) -> None:
        series = GainSeries(gain.within(centre, half), gain.places)
        # The box with the greatest bound comes first. The number of the box decides
        # between equal bounds, as arrays have no order.
        heapq.heappush(left, (-series.bound, looked, centre, half, series.widest()))

    keep(np.zeros(count), np.ones(count))
    while (
        # A gain of zero has no relative tolerance, and nothing exceeds an infinite one.
        0.0 < best < np.inf and looked < most and -left[0][0] > best * (1.0 + tolerance)
    ):
        _, _, centre, half, widest = heapq.heappop(left)
        half = half * (1.0 - axes[widest] / 2.0)
        for side in (-1.0, 1.0):
            middle = centre + side * half * axes[widest]
            # An ascent is expensive, so that it starts only from a better member.
            if gain.at(middle) > best:
                place = gain.climbed(middle)
                best = gain.at(place)
            looked += 1
            keep(middle, half)
    bound = max(best * (1.0 + tolerance), -left[0][0])
    return best, bound, place, looked

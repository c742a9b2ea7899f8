r"""Power series of the gain of an uncertain model in a box of parameters, and its upper bound.

With :math:`\Delta = \mathrm{diag}(\delta_1 I, \ldots, \delta_k I)`, :math:`|\delta_i| \le 1`, the map from
inputs to outputs is

.. math:: N_{22} + N_{21} \Delta (I - N_{11} \Delta)^{-1} N_{12}
          = N_{22} + N_{21} \Delta N_{12} + N_{21} \Delta N_{11} \Delta N_{12} + \ldots

Terms of low order are exact: parameters are real, and effects of one parameter in several places may cancel.
The remainder is bounded by a geometric series of the norms of the blocks of :math:`N_{11}`, which converges
if their spectral radius is below 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import product

import numpy as np

from trussflow.blocks.support.types import Array, Vector

SERIES_ORDER = 4
"""Order up to which the series is exact; a bound covers the rest [-]."""

MAX_CORNER_PARAMETERS = 6
"""Number of parameters up to which all corners of a box are evaluated [-]."""

MAX_SPECTRAL_RADIUS = 0.999
"""Spectral radius above which the bound of the remainder has no valid digits [-]."""


class GainSeries:
    """Series of the gain from inputs to outputs over a box of parameters.

    Parameters
    ----------
    box : array, shape (n, m)
        N: map from the outputs of Δ and the inputs to the inputs of Δ and the outputs [any].
    blocks : sequence of slice
        Rows, and columns, of each parameter in Δ.
    """

    def __init__(self, box: Array, blocks: Sequence[slice]) -> None:
        self.box = box
        self.blocks = blocks
        self.inner = blocks[-1].stop
        self.loop = np.array(
            [[np.linalg.norm(box[i, j], 2) for j in blocks] for i in blocks]
        )
        self.into = np.array([np.linalg.norm(box[i, self.inner :], 2) for i in blocks])
        powers = {(0,) * len(blocks): box[self.inner :]}
        series = dict(powers)
        for _ in range(SERIES_ORDER):
            powers = self._multiplied(powers)
            series.update(powers)
        self.powers = np.array(list(series))
        self.terms = np.array([row[:, self.inner :] for row in series.values()])
        # An even power is between 0 and 1: half of its term shifts the middle, and the
        # other half is the deviation.
        even = np.all(self.powers % 2 == 0, axis=1)
        self.middle = self.terms[0] + np.sum(self.terms[even][1:], axis=0) / 2.0
        self.sizes = np.linalg.norm(self.terms, 2, axis=(1, 2)) * np.where(
            even, 0.5, 1.0
        )
        # `bound` evaluates constant and linear terms at corners, not by norms.
        self.sizes[np.sum(self.powers, axis=1) < 2] = 0.0
        self.last = np.array(list(powers))
        self.tails = np.array(
            [[np.linalg.norm(row[:, i], 2) for i in blocks] for row in powers.values()]
        )

    def _multiplied(
        self, powers: dict[tuple[int, ...], Array]
    ) -> dict[tuple[int, ...], Array]:
        """Return the terms of the next order: the given terms times Δ and N."""
        found: dict[tuple[int, ...], Array] = {}
        for power, row in powers.items():
            for i, own in enumerate(self.blocks):
                higher = (*power[:i], power[i] + 1, *power[i + 1 :])
                found[higher] = found.get(higher, 0.0) + row[:, own] @ self.box[own]
        return found

    @cached_property
    def bound(self) -> float:
        """Upper bound on the gain in the box, infinite if unknown [outputs / inputs]."""
        tilts = self.terms[np.sum(self.powers, axis=1) == 1]
        if len(tilts) <= MAX_CORNER_PARAMETERS:
            # A norm is convex, so that its maximum over the box is at a corner.
            flat = self.middle + np.einsum("ci,iab->cab", corners(len(tilts)), tilts)
            nearly = float(np.max(np.linalg.norm(flat, 2, axis=(1, 2))))
        else:
            nearly = float(
                np.linalg.norm(self.middle, 2)
                + np.sum(np.linalg.norm(tilts, 2, axis=(1, 2)))
            )
        return nearly + self._beyond(np.ones(len(self.blocks)))

    def _beyond(self, share: Vector) -> float:
        """Return the part of the bound from norms, with each parameter limited to a `share` of its range."""
        loop = self.loop * share
        if _radius(loop) >= MAX_SPECTRAL_RADIUS:
            return np.inf
        # Sum of all powers of `loop`; it converges for a spectral radius below 1.
        rest = np.linalg.solve(np.eye(len(loop)) - loop, self.into)
        within = np.prod(share**self.powers, axis=1) @ self.sizes
        return float(
            within + np.prod(share**self.last, axis=1) @ (self.tails * share) @ rest
        )

    def widest(self) -> int:
        """Return the parameter whose halved range gives the least bound."""
        halved = 1.0 - np.eye(len(self.blocks)) / 2.0
        left = [self._beyond(share) for share in halved]
        if min(left) == np.inf:
            left = [_radius(self.loop * share) for share in halved]
        return int(np.argmin(left))


def corners(count: int) -> Vector:
    """Return the corners of a box from -1 to 1.

    Parameters
    ----------
    count : int
        Parameters [-].
    """
    return np.array(list(product((-1.0, 1.0), repeat=count)))


def _radius(matrix: Vector) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))

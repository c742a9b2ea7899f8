r"""Whether all members of an uncertain model are stable, by Lyapunov functions of boxes of parameters.

In a box P is linear in the parameters, and such that what is linear in them vanishes below:

.. math:: A_c^T P_c + P_c A_c = -I, \qquad
          A_c^T P_i + P_i A_c = -(A_i^T P_c + P_c A_i), \qquad P(\delta) = P_c + \sum_i \delta_i P_i

with A at the middle of the box and its slopes. The middle is stable; if
:math:`R(\delta) = A^T P + P A` is negative definite in the whole box, no pole of any member is on the border,
as :math:`v^* R\, v = 2\,\mathrm{Re}(\lambda)\, v^* P v` there: so all members are stable (Gahinet, Apkarian,
Chilali 1996, *Affine parameter-dependent Lyapunov functions and real parametric uncertainty*, IEEE
Transactions on Automatic Control 41). R is -I and a polynomial without linear terms, which eigenvalues bound.
Boxes that are not proved are split. If sampled, :math:`A^T P A - P` stands for :math:`A^T P + P A`.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy

from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.framework.validation import finite_array, positive_whole
from trussflow.blocks.linear_analysis.uncertainty.uncertain_model import UncertainModel

ROUNDING = 1e-6
"""By how much a box must be better than needed [-]."""

Polynomial = dict[tuple[int, ...], Array]
"""Coefficients by powers of the parameters."""


class RobustStability(NamedTuple):
    """Whether all members of an uncertain model are stable.

    Attributes
    ----------
    proved : bool
        Whether all are.
    unstable : dict or None
        Parameters of a member that is not, if one was found [as declared].
    open : float
        Share of the parameters' box about which nothing was found [-].
    boxes : int
        How many boxes it took [-].
    """

    proved: bool
    unstable: dict[str, Array] | None
    open: float
    boxes: int


def robust_stability(model: UncertainModel, *, decay: float = 0.0, boxes: int = 20_000) -> RobustStability:
    """Prove that all members of an uncertain model are stable, or find one that is not.

    Parameters
    ----------
    model : UncertainModel
        From `uncertain`.
    decay : float
        How fast every motion is to decay at least, as exp(-decay t); below 0 how fast it may grow [1/s].
    boxes : int
        How many boxes of parameters to look at; where they do not do, some of them stay open [-].

    Returns
    -------
    RobustStability
        On the fractional model, which `model.misfit` compares with the diagram, and parameters that do not
        change in time.

    Raises
    ------
    SimulationError
        If `boxes` is no number of boxes.
    ParameterError
        If `decay` is not finite.
    """
    positive_whole(boxes=boxes)
    decay = float(finite_array("decay", decay, ()))
    count, nominal = len(model.ranges), model.nominal
    n, sampled = nominal.nstates, bool(nominal.dt)
    _, (scale, _) = scipy.linalg.matrix_balance(nominal.A, permute=False, separate=True)
    axes, looked = np.eye(count), 0

    def at(delta: Vector) -> Vector:
        """Return A in balanced coordinates, sped up by the decay: as that is to be stable."""
        matrix = model.fractions.at(delta)[:n, :n] * scale / scale[:, None]
        return matrix * np.exp(decay * nominal.dt) if sampled else matrix + decay * np.eye(n)

    left = [(-1.0, 0, np.zeros(count), np.ones(count))]
    while left and looked < boxes:
        minus, _, centre, half = heapq.heappop(left)
        looked += 1
        box = _polynomial(at, centre, half)
        poles = np.linalg.eigvals(box[(0,) * count])
        if np.max(np.abs(poles) - 1.0 if sampled else poles.real, initial=-1.0) >= 0.0:
            share = -minus - sum(minus for minus, *_ in left)
            return RobustStability(False, model.values(centre), share, looked)
        beyond = _beyond(box, sampled)
        if sum(beyond) < 1.0 - ROUNDING:
            continue
        widest = int(np.argmax(beyond))
        half = half * (1.0 - axes[widest] / 2.0)
        for side in (-1, 1):
            middle = centre + side * half * axes[widest]
            heapq.heappush(left, (minus / 2.0, 2 * looked + (side > 0), middle, half))
    return RobustStability(not left, None, -sum(minus for minus, *_ in left), looked)


def _polynomial(at: Callable[[Vector], Vector], centre: Vector, half: Vector) -> Polynomial:
    """Return a quadratic function in a box, of numbers from -1 to 1: by differences, which are exact."""
    steps, middle = np.diag(half), at(centre)
    one = np.eye(len(half), dtype=int)
    up, down = ([at(centre + side * step) for step in steps] for side in (1.0, -1.0))
    found = {(0,) * len(half): middle}
    for i, (a, b) in enumerate(zip(up, down, strict=True)):
        found[tuple(one[i])] = (a - b) / 2.0
        found[tuple(2 * one[i])] = (a + b) / 2.0 - middle
    for i, j in combinations(range(len(half)), 2):
        found[tuple(one[i] + one[j])] = at(centre + steps[i] + steps[j]) - up[i] - up[j] + middle
    return found


def _beyond(box: Polynomial, sampled: bool) -> Vector:
    """Return how far from -I each parameter, from -1 to 1, may take R; below 1 in all it is a proof."""
    turned = {power: matrix.T for power, matrix in box.items()}
    none = min(box)
    middle = box[none]

    def solved(right: Vector) -> Vector:
        """Return P of A'P + PA = -right, or of A'PA - P = -right."""
        if sampled:
            return np.asarray(scipy.linalg.solve_discrete_lyapunov(middle.T, right))
        return np.asarray(scipy.linalg.solve_continuous_lyapunov(middle.T, -right))

    def rate(p: Polynomial) -> Polynomial:
        """Return R."""
        if sampled:
            return _sum(_product(_product(turned, p), box), {power: -matrix for power, matrix in p.items()})
        return _sum(_product(turned, p), _product(p, box))

    found = {none: solved(np.eye(len(middle)))}
    linear = {power: solved(matrix) for power, matrix in rate(found).items() if sum(power) == 1}
    beyond = np.zeros(len(none))
    for power, matrix in rate(found | linear).items():
        if power != none:
            ends = np.linalg.eigvalsh((matrix + matrix.T) / 2.0)
            even = all(k % 2 == 0 for k in power)  # from 0 to 1: what makes R smaller does not matter
            beyond += max(ends[-1], 0.0 if even else -ends[0]) * np.array(power) / sum(power)
    return beyond


def _sum(a: Polynomial, b: Polynomial) -> Polynomial:
    return {power: a.get(power, 0.0) + b.get(power, 0.0) for power in (a | b)}


def _product(a: Polynomial, b: Polynomial) -> Polynomial:
    found: Polynomial = {}
    for first, left in a.items():
        for second, right in b.items():
            power = tuple(i + j for i, j in zip(first, second, strict=True))
            found[power] = found.get(power, 0.0) + left @ right
    return found

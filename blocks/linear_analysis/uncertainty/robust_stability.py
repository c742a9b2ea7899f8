r"""Proof of stability of all members of an uncertain model, by Lyapunov functions of boxes of parameters.

In a box, P is linear in the parameters and cancels the linear terms of R:

.. math:: A_c^T P_c + P_c A_c = -I, \qquad
          A_c^T P_i + P_i A_c = -(A_i^T P_c + P_c A_i), \qquad P(\delta) = P_c + \sum_i \delta_i P_i

with :math:`A_c` at the middle of the box, and the slopes :math:`A_i`. The middle is stable. If
:math:`R(\delta) = A^T P + P A` is negative definite in the whole box, no pole of any member is on the border,
as :math:`v^* R\, v = 2\,\mathrm{Re}(\lambda)\, v^* P v` there. Hence all members are stable (Gahinet, Apkarian,
Chilali 1996, *Affine parameter-dependent Lyapunov functions and real parametric uncertainty*, IEEE
Transactions on Automatic Control 41). R is -I and a polynomial without linear terms, which eigenvalues bound.
Boxes without proof are split. For sampled models, :math:`A^T P A - P` replaces :math:`A^T P + P A`.
"""

from __future__ import annotations

import heapq
import warnings
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.linear_analysis.margins import SUM_ROUND_OFF
from trussflow.blocks.linear_analysis.uncertainty.uncertain_model import (
    Polynomial,
    UncertainModel,
    quadratic,
)
from trussflow.blocks.support.progress import status_line
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array, positive

MAX_LOG_SPEEDUP = 300.0
"""Largest logarithm of the speed-up of a sampled model; beyond, only zero is stable [-]."""


class RobustStability(NamedTuple):
    """Whether all members of an uncertain model are stable.

    Attributes
    ----------
    proved : bool
        Whether all members are proved to be stable.
    unstable : dict or None
        Parameters of an unstable member, if one was found [as declared].
    open : float
        Undecided share of the parameters' box [-].
    boxes : int
        Number of boxes [-].
    """

    proved: bool
    unstable: dict[str, Array] | None
    open: float
    boxes: int


def robust_stability(
    model: UncertainModel, *, decay: float = 0.0, boxes: int = 20_000
) -> RobustStability:
    """Prove that all members of an uncertain model are stable, or find one that is not.

    Parameters
    ----------
    model : UncertainModel
        From `uncertain`.
    decay : float
        Required decay rate of every motion, exp(-decay t); a negative value allows growth [1/s].
    boxes : int
        Largest number of boxes of parameters; if it does not suffice, some boxes stay undecided [-].

    Returns
    -------
    RobustStability
        Result for the fractional model, which `model.misfit` compares with the diagram, and for parameters
        that are constant in time.

    Raises
    ------
    LinearAnalysisError
        If `boxes` is not above 0.
    ParameterError
        If `decay` is not finite.
    """
    positive(LinearAnalysisError, boxes=boxes)
    decay = float(finite_array("decay", decay, ()))
    count = len(model.ranges)
    nominal = model.nominal
    n = nominal.nstates
    sampled = bool(nominal.dt)
    if not n:
        return RobustStability(True, None, 0.0, 0)
    _, (scale, _) = scipy.linalg.matrix_balance(nominal.A, permute=False, separate=True)

    def within(centre: Vector, half: Vector, delta: Vector) -> Vector:
        """Return A in balanced coordinates, shifted by the decay: it must be stable."""
        matrix = (
            model.fractions.at(centre + half * delta)[:n, :n] * scale / scale[:, None]
        )
        if not sampled:
            return matrix + decay * np.eye(n)
        return np.asarray(matrix * np.exp(min(decay * nominal.dt, MAX_LOG_SPEEDUP)))

    axes = np.eye(count)
    looked = 0
    # Boxes by volume, the largest first, as a share of the whole; then a unique number,
    # as arrays have no order.
    left = [(-1.0, 0, np.zeros(count), np.ones(count))]
    with status_line("proving stability"):
        while left and looked < boxes:
            minus, _, centre, half = heapq.heappop(left)
            looked += 1
            # A is quadratic in the parameters, so that this is exact in the whole box.
            box = quadratic(partial(within, centre, half), count)
            poles = np.linalg.eigvals(box[(0,) * count])
            if np.max(np.abs(poles) - 1.0 if sampled else poles.real) >= 0.0:
                share = -minus - sum(minus for minus, *_ in left)
                return RobustStability(False, model.values(centre), share, looked)
            beyond = _beyond(box, sampled)
            # R is negative definite in the whole box: all of its members are stable.
            if sum(beyond) < 1.0:
                continue
            # Without a finite bound, the longest side is split.
            widest = int(np.argmax(np.where(np.isfinite(beyond), beyond, half)))
            half = half * (1.0 - axes[widest] / 2.0)
            for side in (-1, 1):
                middle = centre + side * half * axes[widest]
                heapq.heappush(
                    left, (minus / 2.0, 2 * looked + (side > 0), middle, half)
                )
    return RobustStability(not left, None, -sum(minus for minus, *_ in left), looked)


def _beyond(box: Polynomial, sampled: bool) -> Vector:
    """Return the share of the margin of R that each parameter uses at most; a sum below 1 is a proof.

    Residuals of the Lyapunov equations and round-off reduce the margin. The shares are infinite if no margin
    is left.
    """
    none = min(box)
    turned = {power: matrix.T for power, matrix in box.items()}
    middle = box[none]

    def solved(right: Vector) -> Vector:
        """Return P of A'P + PA = -right, or of A'PA - P = -right."""
        if sampled:
            return np.asarray(scipy.linalg.solve_discrete_lyapunov(middle.T, right))
        return np.asarray(scipy.linalg.solve_continuous_lyapunov(middle.T, -right))

    def rate(p: Polynomial) -> Polynomial:
        """Return R, which is linear in P."""
        if sampled:
            return _sum(
                _product(_product(turned, p), box),
                {power: -matrix for power, matrix in p.items()},
            )
        return _sum(_product(turned, p), _product(p, box))

    try:
        with warnings.catch_warnings():
            # SciPy warns of inaccurate solutions; their residual is part of R below.
            warnings.simplefilter("ignore", scipy.linalg.LinAlgWarning)
            p = {none: solved(np.eye(len(middle)))}
            found = rate(p)
            p |= (
                linear := {
                    power: solved(matrix)
                    for power, matrix in found.items()
                    if sum(power) == 1
                }
            )
            found = _sum(found, rate(linear))
    except np.linalg.LinAlgError:
        return np.full(len(none), np.inf)
    size = float(sum(np.linalg.norm(matrix) for matrix in box.values()))
    size = size**2 + 1.0 if sampled else 2.0 * size
    rounding = (
        SUM_ROUND_OFF
        * len(middle)
        * size
        * sum(np.linalg.norm(matrix) for matrix in p.values())
    )
    ends = {
        power: np.linalg.eigvalsh((matrix + matrix.T) / 2.0)
        for power, matrix in found.items()
    }
    spare = -ends.pop(none)[-1] - rounding
    if not spare > 0.0:
        return np.full(len(none), np.inf)
    beyond = np.zeros(len(none))
    for power, each in ends.items():
        # Even powers are from 0 to 1, so that their negative eigenvalues only increase
        # the margin.
        even = all(k % 2 == 0 for k in power)
        beyond += (
            max(each[-1], 0.0 if even else -each[0]) * np.array(power) / sum(power)
        )
    return np.asarray(beyond / spare)


def _sum(a: Polynomial, b: Polynomial) -> Polynomial:
    """Return a + b."""
    return {power: a.get(power, 0.0) + b.get(power, 0.0) for power in (a | b)}


def _product(a: Polynomial, b: Polynomial) -> Polynomial:
    """Return a b."""
    found: Polynomial = {}
    for first, left in a.items():
        for second, right in b.items():
            power = tuple(i + j for i, j in zip(first, second, strict=True))
            found[power] = found.get(power, 0.0) + left @ right
    return found

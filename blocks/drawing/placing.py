"""Vertical placement of boxes with level wires, by linear programming.

References
----------
E. R. Gansner, E. Koutsofios, S. C. North, K.-P. Vo (1993), *A technique for drawing directed graphs*,
IEEE Trans. Software Eng. 19(3), section 4;
E. J. Candes, M. B. Wakin, S. P. Boyd (2008), *Enhancing sparsity by reweighted l1 minimization*,
J. Fourier Anal. Appl. 14.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from trussflow.blocks.drawing.graph import Box, Channels
from trussflow.blocks.support.types import Vector

COMPACTNESS_WEIGHT = 1e-4
"""Weight of the heights of boxes, which are pulled to the top, relative to that of wires [-]."""

REWEIGHTING_ROUNDS = 3
"""Number of solutions; each has smaller weights for wires that bend in the one before."""

BEND_HEIGHT = 5.0
"""Height difference of a wire that halves its weight in the next solution [px]."""


Limits = Sequence[tuple[int, int, float]]
"""Indices of an upper and a lower position, and their smallest distance."""

Ties = Sequence[tuple[int, int, float, float]]
"""Indices of two positions, the difference wanted of the first and the second, and a weight."""


def positions(count: int, limits: Limits, ties: Ties, rounds: int = 1) -> Vector:
    r"""Return positions y that satisfy the limits, with differences as wanted as far as possible.

    .. math:: \min \sum_k w_k |y_{a_k} - y_{b_k} - s_k|, \qquad y_{lower} - y_{upper} \ge d

    Parameters
    ----------
    count : int
        Number of positions [-].
    limits, ties : list of tuple
        See `Limits` and `Ties` [unit of the positions].
    rounds : int
        Number of solutions [-]; each has smaller weights for ties that are violated in the one before.
    """
    # slow to import
    from scipy.optimize import linprog
    from scipy.sparse import block_array, eye_array

    upper, lower, distance = np.reshape(limits, (-1, 3)).T
    left, right, shift, weight = np.reshape(ties, (-1, 4)).T
    each = eye_array(count, format="csr")
    apart: Any = each[upper.astype(int)] - each[lower.astype(int)]
    slope: Any = each[left.astype(int)] - each[right.astype(int)]
    # Sugiyama, step 5: coordinates. Each tie has a slack e with e >= |y_a - y_b - s|,
    # as two inequalities; the minimum of w e makes it equal.
    slack: Any = -eye_array(len(ties))
    rules: Any = block_array([[apart, None], [slope, slack], [-slope, slack]])
    bounds = np.concatenate([-distance, shift, -shift])
    pull = np.full(count, COMPACTNESS_WEIGHT)
    found: Vector = np.zeros(count)
    cost = weight
    for _ in range(rounds):
        solution: Any = linprog(np.concatenate([pull, cost]), rules, bounds)
        found = solution.x[:count]
        # Reweighting lowers the cost of bent wires only, so that few wires
        # bend, as with a cost per bend.
        cost = weight / (1.0 + np.abs(slope @ found - shift) / BEND_HEIGHT)
    # differences are exact despite round-off
    return np.asarray(np.round(found - found.min(), 6))


def place(layers: list[list[Box]], channels: Channels, gap: float) -> None:
    """Set the heights of boxes so that their wires are as level as the order in the layers allows.

    Parameters
    ----------
    layers : list of list of Box
        The layers from the left, each with its boxes from above.
    channels : Channels
        Rails between the layers.
    gap : float
        Distance between boxes [px].
    """
    boxes = [box for layer in layers for box in layer]
    number = {box: i for i, box in enumerate(boxes)}
    limits = [
        # Two dummy nodes are wires: their heights are distance enough.
        (number[a], number[b], a.height + (gap if a.width or b.width else 0.0))
        for layer in layers
        for a, b in pairwise(layer)
    ]
    wires = [
        # wires that pass a layer have larger weights
        (
            number[a.box],
            number[b.box],
            b.dy - a.dy,
            1 + 3 * (not a.box.width) + 3 * (not b.box.width),
        )
        for channel in channels
        for rail in channel
        for a in rail.left
        for b in rail.right
        # Wires that run back are not level with those that run on.
        if a.box.back == b.box.back
    ]
    heights = positions(len(boxes), limits, wires, REWEIGHTING_ROUNDS)
    for box, y in zip(boxes, heights.tolist(), strict=True):
        box.y = y

"""Stiffness matrices of frames of Euler–Bernoulli beams, with tension, torsion and bending."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.models.geometry.rotation import cross_matrix

if TYPE_CHECKING:
    from scipy.sparse import csr_array


class Rigidity(NamedTuple):
    """Rigidities of a rod.

    Attributes
    ----------
    stretching : float
        Axial rigidity, E A [N].
    bending : array, shape (3, 3)
        Bending rigidity, E I, as a tensor in the axes of the frame; its part along the rod is ignored [N·m²].
    twisting : float
        Torsional rigidity, G J [N·m²].
    """

    stretching: float
    bending: Vector
    twisting: float


def assembled_stiffness(
    positions: Vector, ends: Sequence[tuple[int, int]], rods: Sequence[Rigidity]
) -> csr_array:
    """Return the stiffness matrix of beams between points.

    Parameters
    ----------
    positions : array, shape (n, 3)
        Positions of the points [m].
    ends : sequence of (int, int)
        First and second point of each beam.
    rods : sequence of Rigidity
        Rigidities of each beam.

    Returns
    -------
    scipy.sparse.csr_array, shape (6 n, 6 n)
        Six freedoms per point: displacement, rotation [N/m, N, N·m].
    """
    from scipy.sparse import coo_array  # slow to import, not needed in simulations

    freedoms = (6 * np.array(ends)[:, :, None] + np.arange(6)).reshape(-1, 12)
    values = [
        _element(rod, positions[b] - positions[a])
        for (a, b), rod in zip(ends, rods, strict=True)
    ]
    rows, columns = np.repeat(freedoms, 12, axis=1), np.tile(freedoms, 12)
    size = 6 * len(positions)
    return coo_array(
        (np.ravel(values), (rows.ravel(), columns.ravel())), shape=(size, size)
    ).tocsr()


def _element(rod: Rigidity, span: Vector) -> Vector:
    r"""Return the stiffness matrix of one element, (12, 12).

    With the rotations :math:`\alpha, \beta` of its ends relative to its chord the bending energy is
    :math:`\frac{2}{l} (\alpha \cdot B\alpha + \alpha \cdot B\beta + \beta \cdot B\beta)`.
    """
    length = float(np.linalg.norm(span))
    along = span / length
    # Selection matrices of the freedoms (u_a, theta_a, u_b, theta_b).
    u_a, theta_a, u_b, theta_b = np.split(np.eye(12), 4)
    stretch, twist = along @ (u_b - u_a), along @ (theta_b - theta_a)
    across = np.eye(3) - np.outer(along, along)
    # A rotation of the whole rod does not bend it: the slopes are relative to the
    # chord.
    chord = cross_matrix(along) @ (u_b - u_a) / length
    alpha, beta = across @ theta_a - chord, across @ theta_b - chord
    first, second = rod.bending @ alpha, rod.bending @ beta
    # Strain energy of end slopes a and b: 2 E I / L (a^2 + a b + b^2).
    bent = 2.0 * (alpha.T @ first + beta.T @ second) + alpha.T @ second + beta.T @ first
    return np.asarray(
        rod.stretching / length * np.outer(stretch, stretch)
        + rod.twisting / length * np.outer(twist, twist)
        + 2.0 / length * bent
    )

"""The stiffness of a frame of round rods: Euler–Bernoulli beams that stretch, twist and bend."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.framework.types import Vector
from trussflow.models.geometry.rotation import cross_matrix

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from trussflow.models.truss.truss_fe import TrussFrame


def stiffness_matrix(frame: TrussFrame) -> csr_array:
    """Return the stiffness of the whole frame, nothing clamped.

    Parameters
    ----------
    frame : TrussFrame
        n mesh points.

    Returns
    -------
    scipy.sparse.csr_array, shape (6 n, 6 n)
        Six freedoms per mesh point: displacement, rotation [N/m, N, N·m].
    """
    from scipy.sparse import coo_array  # no part of what flies

    positions, _ = frame.point_masses()
    ends = np.array(frame.elements())
    freedoms = (6 * ends[:, :, None] + np.arange(6)).reshape(-1, 12)
    values = [_element(frame, positions[b] - positions[a]) for a, b in ends]
    rows, columns = np.repeat(freedoms, 12, axis=1), np.tile(freedoms, 12)
    size = 6 * len(positions)
    return coo_array((np.ravel(values), (rows.ravel(), columns.ravel())), shape=(size, size)).tocsr()


def _element(frame: TrussFrame, span: Vector) -> Vector:
    r"""Return the stiffness of one element from its first mesh point to its second, (12, 12).

    With the rotations :math:`\alpha, \beta` of its ends against its chord the element stores
    :math:`\frac{2 E I}{l} (\alpha^2 + \alpha\beta + \beta^2)` in bending. Round rods bend alike
    in every plane, so this needs no axes of the section.
    """
    length = float(np.linalg.norm(span))
    along = span / length
    area, bending = pi * frame.rod_radius**2, pi * frame.rod_radius**4 / 4.0
    shear = frame.youngs_modulus / (2.0 * (1.0 + frame.poissons_ratio))
    # Rows of the identity: what each quantity takes of (u_a, theta_a, u_b, theta_b).
    u_a, theta_a, u_b, theta_b = np.split(np.eye(12), 4)
    stretch, twist = along @ (u_b - u_a), along @ (theta_b - theta_a)
    across = np.eye(3) - np.outer(along, along)
    chord = cross_matrix(along) @ (u_b - u_a) / length
    alpha, beta = across @ theta_a - chord, across @ theta_b - chord
    bent = 2.0 * (alpha.T @ alpha + beta.T @ beta) + alpha.T @ beta + beta.T @ alpha
    return np.asarray(
        frame.youngs_modulus * area / length * np.outer(stretch, stretch)
        + 2.0 * shear * bending / length * np.outer(twist, twist)
        + 2.0 * frame.youngs_modulus * bending / length * bent
    )

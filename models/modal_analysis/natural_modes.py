"""Natural frequencies and mode shapes, whichever model they come from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from trussflow.blocks.framework.types import Vector

Support = Literal["free", "clamped"]
"""Free: nothing is held, and six rigid-body modes are removed. Clamped: the truss frame
:math:`O_t`, that is the truss's root face, is held."""

SUPPORTS: tuple[Support, ...] = get_args(Support)
"""All supports there are."""

RIGID_BODY_MODES = 6
"""Modes of frequency zero of a free body."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NaturalModes:
    """Elastic modes of truss and robots, n mesh points, k modes.

    Attributes
    ----------
    support : Support
        Free or clamped.
    frequencies : array, shape (k,)
        Natural frequencies, ascending [Hz].
    displacements : array, shape (n, 3, k)
        Of the mesh points, in truss axes, at a modal mass of one, robots included [kg^-½].
    rigid_body_frequencies : array, shape (6,) or (0,)
        What the rigid-body modes came out at, zero but for round-off; none if clamped [Hz].
    """

    support: Support
    frequencies: Vector
    displacements: Vector
    rigid_body_frequencies: Vector


def natural_modes(support: Support, eigenvalues: Vector, displacements: Vector) -> NaturalModes:
    r"""Return the modes from the eigenvalues of a pencil (K, M), rigid-body modes set apart.

    Parameters
    ----------
    support : Support
        Free: the first six are the rigid-body modes.
    eigenvalues : array, shape (k,)
        :math:`\omega^2`, ascending [1/s²].
    displacements : array, shape (n, 3, k)
        Of the mesh points, at a modal mass of one [kg^-½].

    Returns
    -------
    NaturalModes
    """
    first = RIGID_BODY_MODES if support == "free" else 0
    # Rigid-body modes come out as round-off of either sign.
    frequencies = np.sqrt(np.abs(eigenvalues)) / (2.0 * np.pi)
    return NaturalModes(
        support=support,
        frequencies=frequencies[first:],
        displacements=displacements[:, :, first:],
        rigid_body_frequencies=frequencies[:first],
    )


def modal_assurance(first: NaturalModes, second: NaturalModes, masses: Vector) -> Vector:
    r"""Return how much the shapes of two sets of modes resemble each other.

    .. math:: \mathrm{MAC}_{ab} = \frac{(\sum m\,u_a^T w_b)^2}
                                  {\sum m\,u_a^T u_a\;\sum m\,w_b^T w_b}

    Parameters
    ----------
    first, second : NaturalModes
        Over the same mesh points, :math:`u` and :math:`w`.
    masses : array, shape (n,)
        At the mesh points [kg].

    Returns
    -------
    array, shape (k, l)
        The modal assurance criterion, weighted with the truss's mass: 1 for equal shapes [1].

    References
    ----------
    Allemang (2003), *The modal assurance criterion: twenty years of use and abuse*.
    """
    products = [
        np.einsum("n,nia,nib->ab", masses, a.displacements, b.displacements, optimize=True)
        for a, b in ((first, second), (first, first), (second, second))
    ]
    scale = np.outer(np.diag(products[1]), np.diag(products[2]))
    return np.asarray(products[0] ** 2 / scale)

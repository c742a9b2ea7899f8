r"""Trusses near a given one: heavier, stiffer, with a load on them, with other shapes.

What comes out are modes of the other truss again, mass-normalized and orthogonal, so every law of
the equations holds for it as for the given one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy

from trussflow.blocks.framework.types import Array
from trussflow.models.errors import ModelError
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.validation import check_number, frozen_array


def scaled(modes: TrussModes, *, mass: float = 1.0, frequency: float = 1.0) -> TrussModes:
    r"""Return a truss of another density, and of such a stiffness that frequencies scale as asked.

    Parameters
    ----------
    modes : TrussModes
        The truss.
    mass : float
        Factor of all masses, above 0; shapes scale with its inverse root [-].
    frequency : float
        Factor of all frequencies, above 0 [-].

    Raises
    ------
    ModelError
        If a factor is not above 0.
    """
    check_number("scaled truss", mass=mass, frequency=frequency)
    return replace(
        modes,
        masses=mass * modes.masses,
        frequencies=frequency * modes.frequencies,
        shapes=modes.shapes / np.sqrt(mass),
        grasp_translations=modes.grasp_translations / np.sqrt(mass),
        grasp_rotations=modes.grasp_rotations / np.sqrt(mass),
    )


def loaded(modes: TrussModes, point: Array, mass: float) -> TrussModes:
    r"""Return a truss that carries a point mass, by Rayleigh and Ritz.

    Of the shapes T the new ones are :math:`T V`, with :math:`V^T (I + m T_p^T T_p) V = I` and
    :math:`V^T \Lambda V` diagonal: exact within the space that the given shapes span.

    Parameters
    ----------
    modes : TrussModes
        The truss, with one damping ratio for all modes: which mode is which is lost.
    point : array, shape (3,)
        The point mass of the truss nearest to this one carries it [m].
    mass : float
        m, at least 0 [kg].

    Raises
    ------
    ModelError
        If the mass is negative or not finite, or damping ratios differ.
    """
    where = frozen_array("loaded truss: point", point, (3,))
    check_number("loaded truss", zero=True, mass=mass)
    if np.ptp(modes.damping_ratios) if modes.modes else 0.0:
        raise ModelError(
            "loaded truss: the modes have different damping ratios, and the load mixes the modes; "
            "load the undamped truss, and damp it then"
        )
    node = int(np.argmin(np.linalg.norm(modes.positions - where, axis=1)))
    masses = modes.masses.copy()
    masses[node] += mass
    shape = modes.shapes[node]
    squares, mix = scipy.linalg.eigh(np.diag(modes.stiffness), np.eye(modes.modes) + mass * shape.T @ shape)
    return replace(
        modes,
        masses=masses,
        frequencies=np.sqrt(squares) / (2.0 * np.pi),
        shapes=modes.shapes @ mix,
        grasp_translations=modes.grasp_translations @ mix,
        grasp_rotations=modes.grasp_rotations @ mix,
    )


def misjudged(modes: TrussModes, factors: npt.ArrayLike) -> TrussModes:
    """Return a truss whose grasps move with each mode by a factor more than thought.

    So each mode is excited and seen that much more by the robots; its own mass and stiffness stay.

    Parameters
    ----------
    modes : TrussModes
        The truss.
    factors : array_like, shape (h,)
        One per mode [-].

    Raises
    ------
    ModelError
        If there are not as many factors as modes, or one is not finite.
    """
    each = frozen_array("misjudged truss: factors", factors, (modes.modes,))
    return replace(
        modes,
        grasp_translations=modes.grasp_translations * each,
        grasp_rotations=modes.grasp_rotations * each,
    )

r"""Variations of a truss: mass, stiffness, payload, mode shapes at the grasps.

The results are mass-normalized and orthogonal modes, so that the conservation laws of the equations hold.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy

from trussflow.blocks.support.types import Array
from trussflow.models.errors import ModelError
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.validation import check_number, frozen_array


def scaled(
    modes: TrussModes, *, mass: float = 1.0, frequency: float = 1.0
) -> TrussModes:
    r"""Return a truss with scaled density, and with a stiffness that scales its frequencies.

    Parameters
    ----------
    modes : TrussModes
        Nominal truss.
    mass : float
        Factor of all masses, positive; shapes scale with its inverse square root [-].
    frequency : float
        Factor of all frequencies, positive [-].

    Raises
    ------
    ModelError
        If a factor is not positive.
    """
    check_number("scaled truss", mass=mass, frequency=frequency)
    return modes.reshaped(
        # Keeps the shapes mass-normalized, sum m T^T T = I.
        lambda shapes: shapes / np.sqrt(mass),
        masses=mass * modes.masses,
        frequencies=frequency * modes.frequencies,
    )


def loaded(modes: TrussModes, point: Array, mass: float) -> TrussModes:
    r"""Return a truss with an additional point mass, by Rayleigh–Ritz.

    The new shapes are :math:`T V`, with :math:`V^T (I + m T_p^T T_p) V = I` and
    :math:`V^T \Lambda V` diagonal. They are exact within the space of the nominal shapes T.

    Parameters
    ----------
    modes : TrussModes
        Nominal truss, with one damping ratio for all modes, since the load mixes the modes.
    point : array, shape (3,)
        Position of the load; the nearest point mass of the truss carries it [m].
    mass : float
        Mass of the load, m, zero or positive [kg].

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
            "load the undamped truss, then call `damped`"
        )
    node = int(np.argmin(np.linalg.norm(modes.positions - where, axis=1)))
    masses = modes.masses.copy()
    masses[node] += mass
    shape = modes.shapes[node]
    # The load adds m T^T T to the modal mass; eigh normalizes the new shapes by the
    # sum.
    squares, mix = scipy.linalg.eigh(
        np.diag(modes.stiffness), np.eye(modes.modes) + mass * shape.T @ shape
    )
    return modes.reshaped(
        lambda shapes: shapes @ mix,
        masses=masses,
        frequencies=np.sqrt(squares) / (2.0 * np.pi),
    )


def misjudged(modes: TrussModes, factors: npt.ArrayLike) -> TrussModes:
    """Return a truss with scaled mode shapes at the grasp points (model mismatch).

    Modal mass and stiffness are unchanged; the excitation of each mode by the robots scales.

    Parameters
    ----------
    modes : TrussModes
        Nominal truss.
    factors : array_like, shape (h,)
        Factor per mode [-].

    Raises
    ------
    ModelError
        If the number of factors differs from that of modes, or one is not finite.
    """
    each = frozen_array("truss with scaled shapes: factors", factors, (modes.modes,))
    return replace(
        modes,
        grasp_translations=modes.grasp_translations * each,
        grasp_rotations=modes.grasp_rotations * each,
    )

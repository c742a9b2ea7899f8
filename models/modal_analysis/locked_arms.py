r"""Natural modes of the modal model with all joints locked.

With the joints locked, what is left of the coordinates is the motion of the truss frame and
the h modes: :math:`M = [M_{rr}, M_{rf}; M_{rf}^T, M_{ff}]` is the mass matrix of the system
without the joints' rows and columns, and :math:`K = \mathrm{diag}(0_6, \Lambda)`. Clamped, only
:math:`(\Lambda, M_{ff})` is left. Everything is linearized about the undeformed truss at rest,
where the published and the exact equations have the same mass matrix. Damping is left out.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from trussflow.blocks.framework.types import Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.modal_analysis.natural_modes import SUPPORTS, NaturalModes, Support, natural_modes
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.truss.truss_terms import truss_terms
from trussflow.models.validation import check_choice, frozen_array


def locked_mass_matrix(dynamics: TrussDynamics, joint_angles: Vector | None = None) -> Vector:
    """Return the mass matrix of truss and robots with all joints locked.

    Parameters
    ----------
    dynamics : TrussDynamics
        h modes.
    joint_angles : array, shape (joints,), optional
        Of all robots; by default their rest angles [rad].

    Returns
    -------
    array, shape (6 + h, 6 + h)
        Rows: force on the truss, torque about :math:`O_t`, modes [kg, kg·m, kg·m², kg^½, ...].

    Raises
    ------
    ModelError
        If the number of joint angles is wrong.
    """
    coordinates = dynamics.rest
    if joint_angles is not None:
        angles = frozen_array("joint_angles", joint_angles, (dynamics.joints,))
        coordinates[dynamics.attitude.end : dynamics.rigid_coordinates] = angles
    kept = np.r_[0:6, dynamics.rigid_freedoms : dynamics.freedoms]
    return np.asarray(dynamics.mass_matrix(coordinates)[np.ix_(kept, kept)])


def locked_modes(
    dynamics: TrussDynamics, support: Support, joint_angles: Vector | None = None
) -> NaturalModes:
    """Return the natural modes of truss and robots with all joints locked.

    Parameters
    ----------
    dynamics : TrussDynamics
        h modes, at least one.
    support : Support
        Free or clamped.
    joint_angles : array, shape (joints,), optional
        Of all robots; by default their rest angles [rad].

    Returns
    -------
    NaturalModes
        As many elastic modes as the model has modes, h.

    Raises
    ------
    ModelError
        If there is no such support, no mode, or a wrong number of joint angles.
    """
    return _modes(dynamics.modes, locked_mass_matrix(dynamics, joint_angles), support)


def truss_alone_modes(truss: TrussModes, support: Support) -> NaturalModes:
    """Return the natural modes of the modal truss without robots.

    Parameters
    ----------
    truss : TrussModes
        h modes, at least one. Clamped, these are its own modes.
    support : Support
        Free or clamped.

    Returns
    -------
    NaturalModes
        As many elastic modes as the truss has modes, h.

    Raises
    ------
    ModelError
        If there is no such support, or the truss is rigid.
    """
    terms = truss_terms(truss.data, np.ones(1), np.zeros(3), np.zeros(3), np.zeros(truss.modes))
    own = np.eye(truss.modes)
    mass = np.block([[terms.root, terms.coupling], [terms.coupling.T, own]])
    return _modes(truss, mass, support)


def _modes(truss: TrussModes, mass: Vector, support: Support) -> NaturalModes:
    """Return the modes of a mass matrix (6 + h, 6 + h) on the stiffness of the truss."""
    check_choice("support", support, SUPPORTS)
    if truss.modes == 0:
        raise ModelError("a truss without modes is rigid and has no natural frequencies; keep at least one")
    stiffness = np.diag(np.concatenate([np.zeros(6), truss.stiffness]))
    held = 6 if support == "clamped" else 0
    eigenvalues, vectors = eigh(stiffness[held:, held:], mass[held:, held:])
    # Displacement of the mesh points: v + w x r + T tau.
    carried = np.broadcast_to(np.eye(3), (len(truss.positions), 3, 3))
    turned = np.cross(np.eye(3), truss.positions[:, None, :]).transpose(0, 2, 1)
    motion = np.concatenate([carried, turned, truss.shapes], axis=2)[:, :, held:]
    return natural_modes(support, eigenvalues, motion @ vectors)

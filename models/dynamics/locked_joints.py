"""Truss and robots with all joints locked: inertia of an arm, natural frequencies of the modal model."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from trussflow.blocks.support.types import Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.geometry.spatial import SpatialInertia, inertia_matrix
from trussflow.models.robots.arm_recursion import arm_terms
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.validation import frozen_array


def locked_inertia(arm: RobotArm, joint_angles: Vector) -> Vector:
    """Return the inertia matrix of a robot with locked joints about its grasp point.

    Parameters
    ----------
    arm : RobotArm
        Hand, links and base.
    joint_angles : array, shape (joints,)
        Joint angles [rad].

    Returns
    -------
    array, shape (6, 6)
        In truss axes [kg, kg·m, kg·m²].

    Raises
    ------
    ModelError
        If the number of joint angles is wrong.
    """
    angles, rest = (
        frozen_array("joint_angles", joint_angles, (arm.joints,)),
        np.zeros(6),
    )
    terms = arm_terms(
        arm, angles, np.zeros(arm.joints), np.eye(3), np.zeros(3), rest, rest
    )
    return np.asarray(
        inertia_matrix(SpatialInertia(arm.mass, terms.static_moment, terms.inertia))
    )


def locked_frequencies(
    dynamics: TrussDynamics,
    joint_angles: Vector | None = None,
    *,
    clamped: bool = False,
) -> Vector:
    r"""Return the natural frequencies of truss and robots with all joints locked, undamped and undeformed.

    .. math:: \mathrm{diag}(0_6, \Lambda) \phi = \omega^2 M \phi

    with the rows and columns of the mass matrix M that belong to the truss frame and the modes.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss with h modes, and robots.
    joint_angles : array, shape (joints,), optional
        Joint angles of all robots; by default their rest angles [rad].
    clamped : bool
        Whether the truss frame is held.

    Returns
    -------
    array, shape (h,)
        Elastic frequencies in ascending order [Hz].

    Raises
    ------
    ModelError
        If the truss is rigid, or the number of joint angles is wrong.
    """
    if dynamics.modes.modes == 0:
        raise ModelError(
            "a truss without modes is rigid and has no natural frequencies; keep at least one"
        )
    # `rest` is a new array at each access, so it may be changed in place.
    q = dynamics.rest
    if joint_angles is not None:
        angles = frozen_array("joint_angles", joint_angles, (dynamics.joints,))
        q[dynamics.attitude.end : dynamics.rigid_coordinates] = angles
    kept = np.r_[
        0 if not clamped else 6 : 6, dynamics.rigid_freedoms : dynamics.freedoms
    ]
    mass = np.asarray(dynamics.evaluate(q).mass_matrix)[np.ix_(kept, kept)]
    stiffness = np.zeros(len(kept))
    stiffness[-dynamics.modes.modes :] = dynamics.modes.stiffness
    # Ascending: six zeros of the rigid motions, unless clamped, then the elastic ones.
    squares = eigh(np.diag(stiffness), mass, eigvals_only=True)
    return np.asarray(np.sqrt(squares[-dynamics.modes.modes :]) / (2.0 * np.pi))

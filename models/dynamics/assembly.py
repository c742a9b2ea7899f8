"""Assembly of the equations of the whole system from the terms of truss and robots (Eqs. 21–24, 40–42).

A robot is coupled to the system only through the motion of its hand: its rows couple with
truss and modes, not with other robots. The matrices are written block by block, so that a
solver can use this arrow structure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trussflow.blocks.support.types import Array
from trussflow.models.geometry.rotation import cross_matrix, stacked
from trussflow.models.geometry.spatial import SpatialInertia, inertia_matrix
from trussflow.models.robots.arm_recursion import ArmTerms
from trussflow.models.robots.hand_motion import HandMotion
from trussflow.models.truss.truss_terms import TrussTerms


class DynamicsTerms(NamedTuple):
    r"""Terms of the equations of motion, for n speeds and k robots.

    Attributes
    ----------
    mass_matrix : array, shape (n, n)
        :math:`M`.
    bias : array, shape (n,)
        :math:`F^{I,nl}`, the inertial forces at zero generalized accelerations [N, N·m, N/kg^½].
    actuation_matrix : array, shape (n, 6 k + joints)
        :math:`P_Q`.
    base_positions : array, shape (k, 3)
        Centroids of the robots' bases, in the truss frame [m].
    base_rotations : tuple of array, shape (3, 3)
        Rotation from each base frame to the truss frame.
    """

    mass_matrix: Array
    bias: Array
    actuation_matrix: Array
    base_positions: Array
    base_rotations: tuple[Array, ...]


def assembled(
    truss: TrussTerms,
    hands: Sequence[HandMotion],
    robots: Sequence[ArmTerms],
    robot_masses: Sequence[float],
) -> DynamicsTerms:
    r"""Return the terms of the equations of the whole system.

    Parameters
    ----------
    truss : TrussTerms
        Terms of the truss, h modes.
    hands : sequence of HandMotion
        Motion of each robot's hand, with ``modal_motion`` :math:`\Phi_i`.
    robots : sequence of ArmTerms
        Terms of each robot, relative to the motion of its hand.
    robot_masses : sequence of float
        Mass of each robot [kg].

    Returns
    -------
    DynamicsTerms

    Notes
    -----
    The motion of a hand is :math:`[I, \Phi_i]` times (truss motion, modal rates). So robot i with
    the composite inertia :math:`I_i`, coupling :math:`F_i` and root bias :math:`f_i` adds
    :math:`I_i`, :math:`I_i\Phi_i`, :math:`\Phi_i^T I_i \Phi_i` to the blocks of truss and
    modes, and :math:`f_i`, :math:`\Phi_i^T f_i` to the bias. Its rows of coupling are
    :math:`F_i` and :math:`F_i\Phi_i`.

    References
    ----------
    Li, Wei, Chen (2026), Eqs. 21–24 and 40–42; see docs/notation.md.
    """
    root, coupling = truss.root, truss.coupling
    # The shapes are mass-normalized: E of Eq. 19 is the identity.
    modal = np.eye(truss.modal_bias.shape[0])
    root_bias, modal_bias = truss.root_bias, truss.modal_bias
    for hand, robot, mass in zip(hands, robots, robot_masses, strict=True):
        # All terms are about O_t in truss axes, hence those of robots and truss add.
        inertia = inertia_matrix(
            SpatialInertia(mass, robot.static_moment, robot.inertia)
        )
        carried = inertia @ hand.modal_motion
        root = root + inertia  # Eq. 22, as are the next two
        coupling = coupling + carried
        modal = modal + hand.modal_motion.T @ carried
        root_bias = root_bias + robot.root_bias  # Eq. 23
        modal_bias = modal_bias + hand.modal_motion.T @ robot.root_bias
    own = [robot.mass_matrix for robot in robots]
    to_root = [robot.root_coupling for robot in robots]
    to_modes = [
        block @ hand.modal_motion for block, hand in zip(to_root, hands, strict=True)
    ]
    rows = [
        # Rows of the truss, of each robot, and of the modes; no block couples two
        # robots.
        [root, *(block.T for block in to_root), coupling],
        *(
            [to_root[i], *_diagonal_row(own, i), to_modes[i]]
            for i in range(len(robots))
        ),
        [coupling.T, *(block.T for block in to_modes), modal],
    ]
    matrix = np.block(rows)
    return DynamicsTerms(
        mass_matrix=matrix,
        bias=np.concatenate(
            [root_bias, *(robot.joint_bias for robot in robots), modal_bias]
        ),
        # np.block fails if a row has no blocks, as without robots.
        actuation_matrix=_actuation_matrix(hands, robots)
        if robots
        else np.zeros((len(matrix), 0)),
        base_positions=stacked([robot.base_position for robot in robots], (3,)),
        base_rotations=tuple(robot.base_rotation for robot in robots),
    )


def _actuation_matrix(hands: Sequence[HandMotion], robots: Sequence[ArmTerms]) -> Array:
    """Return P_Q (Eq. 41): base forces act on all coordinates, a joint torque on its own joint."""
    wrenches = [_base_wrenches(robot) for robot in robots]
    on_joints = [robot.screws @ w for robot, w in zip(robots, wrenches, strict=True)]
    on_modes = [
        hand.modal_motion.T @ w for hand, w in zip(hands, wrenches, strict=True)
    ]
    rows = [
        wrenches,
        *(_diagonal_row(on_joints, i) for i in range(len(robots))),
        on_modes,
    ]
    bases = np.block(rows)
    joints = sum(block.shape[0] for block in on_joints)
    torques = np.zeros((bases.shape[0], joints))
    # Joint rates are generalized speeds, so a joint torque is a generalized force.
    torques[6 : 6 + joints] = np.eye(joints)
    return np.concatenate([bases, torques], axis=1)


def _base_wrenches(robot: ArmTerms) -> Array:
    """Return the spatial forces of unit forces and torques at the base's centroid (Eq. 40), (6, 6)."""
    rotation = robot.base_rotation
    # The force acts at the centroid r, in base axes: its torque about O_t is r x R f.
    lever = cross_matrix(robot.base_position) @ rotation
    return np.block([[rotation, np.zeros((3, 3))], [lever, rotation]])


def _diagonal_row(blocks: Sequence[Array], i: int) -> list[Array]:
    """Return row i of a block-diagonal matrix."""
    height = blocks[i].shape[0]
    return [
        b if j == i else np.zeros((height, b.shape[1])) for j, b in enumerate(blocks)
    ]

r"""The direct finite-element check: the whole truss, robots as rigid masses at their grasp points.

The modal model takes as :math:`T_i` and :math:`R_i` the displacement and the rotation of the mesh
point that robot i grasps. So the whole robot, arm locked and base included, is one rigid body on
that mesh point: its 6×6 inertia about the point is added to the mass of the point's six freedoms.

Three models of the truss are solved, each with fewer freedoms than the one before, so by
Rayleigh's principle (constraints raise frequencies) each above it:

1. every mesh point free, the root face included (free support only, ``flexible_face``);
2. the root face rigid, as it is in the modal model, whose modes are clamped there and whose
   frame :math:`O_t` it carries (`direct_modes`);
3. further, the rotations of all mesh points those that the truss alone would take, given its
   displacements (`all_modes_limit`). The modes of the truss alone are all of this kind, since
   its rotations carry no mass, so this is the space that all of them together span: the modal
   model tends to it, from above, as modes are added.

What lies between 2 and 3 is the give of the rods next to a grasp point under the torque of the
robot. No number of modes of the truss alone brings it in.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.sparse import block_diag, csc_array, csr_array, eye_array, hstack
from scipy.sparse.linalg import eigsh, splu

from trussflow.blocks.framework.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.geometry.rotation import cross_matrix
from trussflow.models.geometry.spatial import SpatialInertia, inertia_matrix
from trussflow.models.modal_analysis.natural_modes import (
    RIGID_BODY_MODES,
    SUPPORTS,
    NaturalModes,
    Support,
    natural_modes,
)
from trussflow.models.robots.arm_recursion import arm_terms
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.truss.frame_analysis import CLAMPED_NODES
from trussflow.models.truss.stiffness import stiffness_matrix
from trussflow.models.truss.truss_fe import TrussFrame
from trussflow.models.validation import check_choice

# The eigensolver finds what is nearest to this [1/s^2]: below all eigenvalues, so that the
# shifted stiffness is positive definite although a free body's own is not.
_SHIFT = -10.0


class RigidRobot(NamedTuple):
    """A robot with locked arm: one rigid body on a mesh point of the truss.

    Attributes
    ----------
    node : int
        The mesh point.
    inertia : SpatialInertia
        Of hand, links and base together, about the mesh point, in truss axes.
    """

    node: int
    inertia: SpatialInertia


def rigid_robots(
    arms: Sequence[RobotArm], joint_angles: Vector, nodes: Sequence[int]
) -> tuple[RigidRobot, ...]:
    """Return the robots as rigid bodies on mesh points of the truss.

    Parameters
    ----------
    arms : sequence of RobotArm
        One per grasp point.
    joint_angles : array, shape (joints,)
        Of all robots, one after the other [rad].
    nodes : sequence of int
        The mesh points they grasp.

    Returns
    -------
    tuple of RigidRobot

    Raises
    ------
    ModelError
        If there are not as many mesh points as arms, or not one angle per joint.
    """
    ends = np.cumsum([arm.joints for arm in arms])
    if len(nodes) != len(arms) or np.shape(joint_angles) != (ends[-1],):
        raise ModelError(
            f"{len(arms)} robots with {ends[-1]} joints are given, but {len(nodes)} mesh points "
            f"and joint angles of shape {np.shape(joint_angles)}; give one for each"
        )
    robots = []
    parts = np.split(np.asarray(joint_angles, dtype=float), ends[:-1])
    for arm, angles, node in zip(arms, parts, nodes, strict=True):
        rest = np.zeros(6)
        # A grasp point in the origin gives the inertia about the grasp point.
        terms = arm_terms(arm, angles, np.zeros(arm.joints), np.eye(3), np.zeros(3), rest, rest)
        body = SpatialInertia(arm.mass, terms.static_moment, terms.inertia)
        robots.append(RigidRobot(int(node), body))
    return tuple(robots)


def direct_modes(
    frame: TrussFrame,
    robots: Sequence[RigidRobot],
    support: Support,
    count: int,
    *,
    flexible_face: bool = False,
) -> NaturalModes:
    """Return the lowest elastic modes of the whole finite-element truss with its robots.

    Parameters
    ----------
    frame : TrussFrame
        The truss.
    robots : sequence of RigidRobot
        None for the truss alone.
    support : Support
        Free, or clamped at the root face.
    count : int
        Number of elastic modes [-].
    flexible_face : bool
        True, for a free truss only: the root face bends as all the rest does. False: it is
        rigid, as in the modal model.

    Returns
    -------
    NaturalModes

    Raises
    ------
    ModelError
        If there is no such support or mesh point, or so many modes cannot be had.
    """
    basis = _basis(frame, support, flexible_face=flexible_face)
    return _lowest(frame, robots, support, count, basis)


def all_modes_limit(
    frame: TrussFrame, robots: Sequence[RigidRobot], support: Support, count: int
) -> NaturalModes:
    r"""Return what the modal model tends to as it takes in all modes of the truss.

    The rotations of the mesh points follow the displacements as they do in the truss alone,
    :math:`\theta = -K_{\theta\theta}^{-1} K_{\theta u} u`.

    Parameters
    ----------
    frame : TrussFrame
        The truss.
    robots : sequence of RigidRobot
        None for the truss alone, of which this is no approximation.
    support : Support
        Free with a rigid root face, or clamped there.
    count : int
        Number of elastic modes [-].

    Returns
    -------
    NaturalModes

    Raises
    ------
    ModelError
        If there is no such support or mesh point, or so many modes cannot be had.
    """
    basis = _basis(frame, support, flexible_face=False)
    stiffness = csc_array(basis.T @ _stiffness(frame) @ basis)
    # After the motion of the face, if any, six freedoms follow per mesh point, rotations last.
    own = 6 if support == "free" else 0
    turning = np.flatnonzero((np.arange(basis.shape[1] - own) % 6) >= 3) + own
    others = np.setdiff1d(np.arange(basis.shape[1]), turning)
    coupling = stiffness[turning][:, others].toarray()
    following = -splu(csc_array(stiffness[turning][:, turning])).solve(coupling)
    whole = np.zeros((basis.shape[1], len(others)))
    whole[others], whole[turning] = np.eye(len(others)), following
    return _lowest(frame, robots, support, count, csr_array(basis @ whole))


# Every solution of one frame begins with it.
_stiffness = lru_cache(maxsize=8)(stiffness_matrix)


def _basis(frame: TrussFrame, support: Support, *, flexible_face: bool) -> csr_array:
    """Return how the freedoms of all mesh points follow from those that are left, (6 n, d)."""
    check_choice("support", support, SUPPORTS)
    if flexible_face and support == "clamped":
        raise ModelError("a clamped face is held and cannot be flexible; leave flexible_face out")
    positions, _ = frame.point_masses()
    freedoms, held = 6 * len(positions), 6 * CLAMPED_NODES
    every = csr_array(eye_array(freedoms))
    if flexible_face:
        return every
    beyond = every[:, held:]
    if support == "clamped":
        return beyond
    face = np.zeros((freedoms, 6))
    for node, position in enumerate(positions[:CLAMPED_NODES]):
        carried = [[np.eye(3), -cross_matrix(position)], [np.zeros((3, 3)), np.eye(3)]]
        face[6 * node : 6 * node + 6] = np.block(carried)
    return csr_array(hstack([csr_array(face), beyond]))


def _lowest(
    frame: TrussFrame, robots: Sequence[RigidRobot], support: Support, count: int, basis: csr_array
) -> NaturalModes:
    """Solve for the lowest elastic modes in the space that the columns of `basis` span."""
    frame.check_number_of_modes(count)
    wanted = count + (RIGID_BODY_MODES if support == "free" else 0)
    mass, stiffness = (
        csc_array(basis.T @ matrix @ basis) for matrix in (_mass(frame, robots), _stiffness(frame))
    )
    # A fixed start: the iteration then gives the same numbers every time.
    start = np.random.default_rng(0).standard_normal(basis.shape[1])
    eigenvalues, vectors = eigsh(stiffness, wanted, mass, sigma=_SHIFT, v0=start)
    order = np.argsort(eigenvalues)
    freedoms = np.reshape(basis @ vectors[:, order], (-1, 6, wanted))
    return natural_modes(support, eigenvalues[order], freedoms[:, :3])


def _mass(frame: TrussFrame, robots: Sequence[RigidRobot]) -> csr_array:
    """Return the mass of all freedoms (6 n, 6 n): point masses, and the robots on theirs."""
    _, masses = frame.point_masses()
    for node, _ in robots:
        if not 0 <= node < len(masses):
            raise ModelError(f"no mesh point {node} for a robot; the mesh has points 0 to {len(masses) - 1}")
    blocks = [np.diag([m, m, m, 0.0, 0.0, 0.0]) for m in masses]
    for node, inertia in robots:
        blocks[node] = blocks[node] + inertia_matrix(inertia)
    return csr_array(block_diag([csr_array(block) for block in blocks]))

r"""Component modes of any structure: its lowest modes, and residual attachment shapes at the grasps.

The modes of a structure converge slowly to its local deformation under a force or torque on a grasp
point. So each unit force and moment on a grasp point adds the missing static deflection,
:math:`G f - \sum_k \phi_k \phi_k^T f / \omega_k^2`, the residual attachment shape of MacNeal. G is the
flexibility of the structure clamped at some nodes, or free-floating (inertia relief). Attachment shapes
are orthogonal to the modes. Rayleigh–Ritz makes them orthogonal to each other, with a frequency each.

Some of these frequencies are very high, because little mass moves when a rod twists, and limit the step
of the solver. A shape of frequency f above the highest wanted frequency F is **condensed**: its frequency
becomes F, and its displacements and rotations at the grasps are multiplied by F / f. So its static
compliance at the grasps is unchanged, but its vibration has the frequency F instead of f. Energy and
momentum are conserved, since the equations hold for any shapes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy

from trussflow.blocks.support.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.truss.structure import Structure
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.validation import frozen_array

Grasp = int | Collection[int] | npt.ArrayLike
"""Number of a node; a set of three or more nodes, for their mean motion; or the position of a node [m]."""

# Least ratio of kinetic energies of shapes of equal strain energy; smaller ones are round-off.
_MIN_KINETIC_RATIO = 1e-8

_TOO_MANY = (
    "cannot add attachment shapes to {} modes: the modes already span the motion of all mass near the grasp "
    "points, or there is too little mass; choose fewer modes, or give rotational inertia to a node that only "
    "twists"
)

# With more point masses the lowest modes are computed by iteration, not by a dense solution.
_MAX_DENSE_POINTS = 500

# Relative error of the static solution, above which the structure is a mechanism.
_STATIC_TOLERANCE = 1e-3
_MECHANISM = (
    "{} is a mechanism, has unconnected parts, or no inertia about some axis: {}; its only motions "
    "without elastic forces must be the six rigid ones"
)

# Relative to the largest eigenvalue of the strain energies of unit loads on the grasps.
_ROUND_OFF = 1e-9

# Largest distance of a grasp point from its node [m].
_GRASP_DISTANCE = 2e-3


class _Interface(NamedTuple):
    """Grasp point as a function of the freedoms: position, nodes, and six rows of a matrix."""

    position: Vector
    nodes: tuple[int, ...]
    motion: Vector


def reduced_modes(
    structure: Structure,
    number_of_modes: int,
    grasps: Sequence[Grasp],
    *,
    clamped: Sequence[int] = (),
    highest_frequency: float = np.inf,
    attachments: bool = True,
) -> TrussModes:
    """Return the lowest modes of a structure and its attachment shapes at the grasps, undamped.

    Parameters
    ----------
    structure : Structure
        Finite-element model of the body.
    number_of_modes : int
        Number of modes, h, zero or more [-].
    grasps : sequence of int, set of int, or array_like of shape (3,)
        Number of a node; a set of nodes, for their mean motion by least squares; or the position
        of a node within 2 mm [m].
    clamped : sequence of int
        Nodes that are fixed in the frame of the body. By default the frame floats with the body, so that
        the shapes have no momentum.
    highest_frequency : float
        Attachment shapes of higher frequencies are condensed [Hz].
    attachments : bool
        Whether to add attachment shapes. Without them the model is smaller, but lacks the compliance of
        the omitted modes at the grasps.

    Returns
    -------
    TrussModes
        The h modes, then six attachment shapes per grasp that is not clamped, fewer if grasps share
        nodes. The sign of each shape makes its largest translation at the last grasp positive.

    Raises
    ------
    ModelError
        If a node does not exist, the structure is a mechanism, it has too few modes, or a mode is above
        `highest_frequency`.

    References
    ----------
    MacNeal (1971), *A hybrid method of component mode synthesis*; Craig (2000), *Coupling of
    substructures for dynamic analyses: an overview*.
    """
    held = np.isin(
        structure.nodes, [structure.nodes[node_index(structure, n)] for n in clamped]
    )
    free = np.flatnonzero(structure.elastic & np.repeat(~held, 6))
    places = [_interface(structure, grasp) for grasp in grasps]
    pulled = {
        p.nodes: p for p in places if attachments and not np.all(held[list(p.nodes)])
    }
    weights = scipy.sparse.diags_array(np.sqrt(np.repeat(structure.point_masses, 3)))
    # The mass matrix of the point masses is weighted^T weighted.
    weighted = scipy.sparse.csr_array(weights @ structure.carried)[:, free]
    rigid = structure.rigid_motions(structure.centre)[free][:, : 0 if held.any() else 6]
    deflection = _flexibility(structure, free, weighted, rigid)
    # The mass matrix has at most the rank of its nonempty rows and columns.
    limit = (
        min(np.count_nonzero(np.diff(m.indptr)) for m in (weighted, weighted.tocsc()))
        - rigid.shape[1]
    )
    if not 0 <= number_of_modes < limit - 6 * len(pulled):
        shapes = f" and {6 * len(pulled)} attachment shapes" if pulled else ""
        raise ModelError(
            f"cannot compute {number_of_modes} modes{shapes} of {structure.source}: its mass has {limit} "
            f"elastic freedoms; choose 0 to {limit - 6 * len(pulled) - 1} modes"
        )
    stiffness = structure.stiffness[free][:, free]
    squares, modes = _lowest_modes(deflection, weighted, stiffness, number_of_modes)

    # Residual attachment shapes: static deflections without the part of the modes.
    # The empty block gives the shape if there are no grasps.
    loads = np.hstack(
        [np.zeros((len(free), 0)), *(p.motion[:, free].T for p in pulled.values())]
    )
    residual = deflection(loads) - modes / squares @ (modes.T @ loads)
    # removes round-off
    residual -= modes @ ((weighted @ modes).T @ (weighted @ residual))
    # Shapes of unit strain energy have the kinetic energies 1 / omega^2. Grasps that share nodes may have
    # linearly dependent loads, which are dropped.
    energy = residual.T @ (stiffness @ residual)
    scale = 1.0 / np.sqrt(np.diag(energy))
    strengths, mix = np.linalg.eigh(energy * np.outer(scale, scale))
    own = strengths > _ROUND_OFF
    shapes = residual * scale @ mix[:, own] / np.sqrt(strengths[own])
    moving = weighted @ shapes
    kinetic, vectors = np.linalg.eigh(moving.T @ moving)
    if np.any(kinetic < _MIN_KINETIC_RATIO * np.max(kinetic, initial=0.0)):
        raise ModelError(_TOO_MANY.format(number_of_modes))
    # Mass-normalized. The largest kinetic energy at equal strain energy belongs to the
    # lowest frequency, hence the reversed order.
    attachments = (shapes @ vectors / np.sqrt(kinetic))[:, ::-1]

    frequencies = np.sqrt(np.concatenate([squares, 1.0 / kinetic[::-1]])) / (
        2.0 * np.pi
    )
    if number_of_modes and not frequencies[number_of_modes - 1] < highest_frequency:
        raise ModelError(
            f"highest_frequency is {highest_frequency} Hz, but mode {number_of_modes} has "
            f"{frequencies[number_of_modes - 1]:.4g} Hz; only attachment shapes can be condensed: "
            "choose fewer modes or a higher frequency"
        )
    found = np.zeros((len(structure.elastic), len(frequencies)))
    found[free] = np.hstack([modes, attachments])
    at_grasps = np.array([p.motion @ found for p in places]).reshape(
        len(places), 6, len(frequencies)
    )
    signs = upward_signs(at_grasps[-1, :3]) if places else np.ones(len(frequencies))
    # The static flexibility T^2 / omega^2 does not change if T is scaled with omega.
    at_grasps = at_grasps * signs * np.minimum(1.0, highest_frequency / frequencies)
    return TrussModes(
        positions=structure.points,
        masses=structure.point_masses,
        shapes=(structure.carried @ found * signs).reshape(
            len(structure.points), 3, len(frequencies)
        ),
        frequencies=np.minimum(frequencies, highest_frequency),
        damping_ratios=np.zeros(len(frequencies)),
        grasp_positions=np.array([p.position for p in places]).reshape(-1, 3),
        grasp_translations=at_grasps[:, :3],
        grasp_rotations=at_grasps[:, 3:],
        source=f"{structure.source}: {number_of_modes} modes, {len(kinetic)} attachment shapes",
    )


def upward_signs(translations: Vector) -> Vector:
    """Return the signs that make shapes independent of the eigensolver.

    Parameters
    ----------
    translations : array, shape (3, h)
        Translations of one point in h shapes [kg^-½].

    Returns
    -------
    array, shape (h,)
        Sign ±1 per shape that makes its largest component positive [1].
    """
    largest = np.argmax(np.abs(translations), axis=0)
    return np.where(
        translations[largest, np.arange(translations.shape[1])] < 0.0, -1.0, 1.0
    )


def _flexibility(
    structure: Structure,
    free: npt.NDArray[np.intp],
    weighted: scipy.sparse.csr_array,
    rigid: Vector,
) -> Callable[[Vector], Vector]:
    """Return a function of loads for the deflections, without rigid motion if the body floats."""
    stiffness = structure.stiffness[free][:, free]
    # Inertia relief: the inertial forces of the rigid acceleration balance the loads.
    momentum = weighted.T @ (weighted @ rigid)
    whole = stiffness
    if rigid.size:
        # Any scale of the multipliers is right; this one balances the matrix.
        border = scipy.sparse.csr_array(
            momentum * (np.max(stiffness.diagonal()) / np.max(np.abs(momentum)))
        )
        beside = scipy.sparse.csr_array((6, 6))
        whole = scipy.sparse.csr_array(
            scipy.sparse.block_array(
                [[stiffness, border], [scipy.sparse.csr_array(border.T), beside]]
            )
        )
    try:
        factors = scipy.sparse.linalg.splu(scipy.sparse.csc_array(whole))
    except RuntimeError as error:
        raise ModelError(
            _MECHANISM.format(structure.source, "it has freedoms without stiffness")
        ) from error

    def deflection(loads: Vector) -> Vector:
        ending = np.zeros((rigid.shape[1], *loads.shape[1:]))
        return np.asarray(factors.solve(np.concatenate([loads, ending]))[: len(free)])

    # A mechanism may have factors by round-off, but then K^-1 K x differs from x.
    shaken = np.random.default_rng(0).standard_normal(len(free))
    shaken -= rigid @ np.linalg.solve(rigid.T @ momentum, momentum.T @ shaken)
    strange = np.abs(deflection(stiffness @ shaken) - shaken)
    if not np.max(strange) < _STATIC_TOLERANCE * np.max(np.abs(shaken)):
        worst = structure.name_of(int(free[np.argmax(strange)]))
        raise ModelError(_MECHANISM.format(structure.source, f"check {worst}"))
    return deflection


def _lowest_modes(
    deflection: Callable[[Vector], Vector],
    weighted: scipy.sparse.csr_array,
    stiffness: scipy.sparse.csr_array,
    number: int,
) -> tuple[Vector, Vector]:
    """Return ascending squared frequencies [rad²/s²], and mass-normalized modes of the free freedoms."""
    size = weighted.shape[0]
    if size <= 3 * _MAX_DENSE_POINTS:
        # The flexibility in mass-weighted coordinates has the eigenvalues 1 / omega^2.
        values, vectors = scipy.linalg.eigh(weighted @ deflection(weighted.T.toarray()))
    else:
        operator = scipy.sparse.linalg.LinearOperator(
            (size, size),
            matvec=lambda y: weighted @ deflection(weighted.T @ y),
            dtype=float,
        )
        # A fixed start vector makes the iteration reproducible.
        start = np.random.default_rng(0).standard_normal(size)
        values, vectors = scipy.sparse.linalg.eigsh(operator, number + 1, v0=start)
    shapes = deflection(weighted.T @ vectors[:, np.argsort(-values)[:number]])
    # Round-off leaves the shapes orthonormal to nine digits only, hence a second Rayleigh-Ritz step.
    moving = weighted @ shapes
    if not number:
        return values[:0], shapes
    squares, mix = scipy.linalg.eigh(shapes.T @ (stiffness @ shapes), moving.T @ moving)
    return squares, shapes @ mix


def node_index(structure: Structure, number: int) -> int:
    """Return the index of a node among all nodes.

    Parameters
    ----------
    structure : Structure
        Structure with the node.
    number : int
        Number of the node.

    Raises
    ------
    ModelError
        If there is no such node; the message states the valid numbers.
    """
    nodes = structure.nodes[: len(structure.nodes) - structure.inner]
    if number not in nodes:
        raise ModelError(
            f"node {number} does not exist in {structure.source}; its {len(nodes)} nodes have the "
            f"numbers {min(nodes)} to {max(nodes)}"
        )
    return nodes.index(number)


def nearest(positions: Vector, point: Vector) -> int:
    """Return the index of the node at a grasp point, within 2 mm.

    Parameters
    ----------
    positions : array, shape (n, 3)
        Positions of the nodes [m].
    point : array, shape (3,)
        Grasp point [m].

    Raises
    ------
    ModelError
        If no node is within 2 mm.
    """
    distances = np.linalg.norm(positions - point, axis=1)
    node = int(np.argmin(distances))
    if distances[node] > _GRASP_DISTANCE:
        raise ModelError(
            f"no mesh point at grasp point {point.tolist()} m: the nearest is "
            f"{positions[node].tolist()} m, {distances[node]:.3g} m away; move it, or refine the "
            "mesh"
        )
    return node


def _interface(structure: Structure, grasp: Grasp) -> _Interface:
    """Return the motion of a grasp: that of its node, or the mean motion of several by least squares."""
    if isinstance(grasp, int | np.integer | set | frozenset):
        numbers = grasp if isinstance(grasp, set | frozenset) else {int(grasp)}
        nodes = sorted(node_index(structure, n) for n in numbers)
        position = structure.positions[nodes].mean(axis=0)
    else:
        position = frozen_array("grasp point", grasp, (3,))
        nodes = [nearest(structure.positions, position)]
    rows = np.ravel([6 * n + np.arange(6) for n in nodes])
    rigid = structure.rigid_motions(structure.positions[nodes].mean(axis=0))[rows]
    if len(nodes) > 1:
        # The mean rotation of several nodes follows from their displacements alone, as in RBE3 elements.
        rigid[np.arange(len(rigid)) % 6 > 2] = 0.0
    size = np.linalg.norm(rigid, axis=0)
    if (
        np.linalg.matrix_rank(
            (rigid / np.where(size, size, 1.0))[structure.elastic[rows]], 1e-6
        )
        < 6
    ):
        raise ModelError(
            f"grasp at nodes {[structure.nodes[n] for n in nodes]}: they do not define its rotation; a grasp "
            "must be one node with rotations, or a set of three or more nodes that are not in line"
        )
    motion = np.zeros((6, len(structure.elastic)))
    motion[:, rows] = np.linalg.pinv(rigid)
    return _Interface(position, tuple(nodes), motion)

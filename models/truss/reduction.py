r"""Component modes of any structure: its lowest modes, and what they leave out at the grasps.

No mode of the structure alone bends it at a grasp point as the force or the torque of a robot
does, however many are taken. So each unit force and moment on a grasp point adds the static
deflection that is missing, :math:`G f - \sum_k \phi_k \phi_k^T f / \omega_k^2`, the residual
attachment shape of MacNeal, with the flexibility G of the structure clamped at some nodes, or
floating freely (inertia relief). Attachment shapes are orthogonal to the modes; among each other they
are made so (Rayleigh–Ritz), and come out as shapes with frequencies of their own.

Some of those frequencies are far above all that matters, and nothing but a burden to the solver:
hardly any mass moves when a rod twists. A shape of frequency f above the highest wanted, F, is
**condensed**: its frequency becomes F, and its displacements and rotations at the grasps become
F / f of what they were. What it gives way under a static load on the grasps, the square of the
quotient, stays exactly the same; that it does so within a vibration of F rather than f is what is
given up. Energy and momentum are conserved as before, since the equations hold for any shapes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy

from trussflow.blocks.framework.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.truss.structure import Structure
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.validation import frozen_array

Grasp = int | Collection[int] | npt.ArrayLike
"""A node's number; a set of three or more, which move it on average; or a position [m] where a node is."""

# Kinetic energies of shapes of equal strain energy, the least to the greatest; below this they
# are round-off.
_LEAST_KINETIC = 1e-8

_TOO_MANY = (
    "cannot add attachment shapes to {} modes: these move all the mass there is near the grasp points, or "
    "it is hardly any mass; ask for fewer modes, or give an inertia to a node that only twists"
)

# More point masses than this: the lowest modes by iteration, not all by a dense solution.
_DENSE = 500

# A deflection that its own forces do not bring back within this share belongs to a mechanism.
_STRANGE = 1e-3
_MECHANISM = (
    "{} is a mechanism, has parts that nothing connects, or no inertia about some axis: {}; its only motions "
    "without forces must be the six of a rigid body"
)

# Relative to the largest strength of loads on the grasps, of one each.
_ROUND_OFF = 1e-9

# A grasp point is at a node that is this close [m].
_GRASP_DISTANCE = 2e-3


class _Interface(NamedTuple):
    """How a grasp point follows the freedoms: its position, and six rows."""

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
        The body.
    number_of_modes : int
        Modes, h, from 0 on [-].
    grasps : sequence of int, set of int, or array_like of shape (3,)
        A node's number; a set of nodes, whose mean motion by least squares it has; or the position
        of a node within 2 mm [m].
    clamped : sequence of int
        Nodes that stay where they are in the body's own frame; by default that frame floats with
        the body, so that its shapes carry no momentum.
    highest_frequency : float
        Attachment shapes of higher frequencies are condensed [Hz].
    attachments : bool
        Whether there are such shapes; without them the model is small, and the grasps do not give way as
        the missing modes would.

    Returns
    -------
    TrussModes
        First the h modes, then six attachment shapes per grasp that is not clamped, fewer if grasps
        share nodes. Each shape's sign
        makes its largest translation at the last grasp positive.

    Raises
    ------
    ModelError
        If there is no such node, the structure is a mechanism, so many shapes cannot be had, or a mode
        lies above `highest_frequency`.

    References
    ----------
    MacNeal (1971), *A hybrid method of component mode synthesis*; Craig (2000), *Coupling of
    substructures for dynamic analyses: an overview*.
    """
    held = np.isin(structure.nodes, [structure.nodes[node_index(structure, n)] for n in clamped])
    free = np.flatnonzero(structure.elastic & np.repeat(~held, 6))
    places = [_interface(structure, grasp) for grasp in grasps]
    pulled = {p.nodes: p for p in places if attachments and not np.all(held[list(p.nodes)])}
    weights = scipy.sparse.diags_array(np.sqrt(np.repeat(structure.point_masses, 3)))
    weighted = scipy.sparse.csr_array(weights @ structure.carried)[:, free]
    rigid = structure.rigid_motions(structure.centre)[free][:, : 0 if held.any() else 6]
    deflection = _flexibility(structure, free, weighted, rigid)
    limit = min(np.count_nonzero(np.diff(m.indptr)) for m in (weighted, weighted.tocsc())) - rigid.shape[1]
    if not 0 <= number_of_modes < limit - 6 * len(pulled):
        shapes = f" and {6 * len(pulled)} attachment shapes" if pulled else ""
        raise ModelError(
            f"cannot compute {number_of_modes} modes{shapes} of {structure.source}: its mass has {limit} "
            f"elastic freedoms; choose 0 to {limit - 6 * len(pulled) - 1} modes"
        )
    stiffness = structure.stiffness[free][:, free]
    squares, modes = _lowest_modes(deflection, weighted, stiffness, number_of_modes)

    # What the modes leave out: all deflections without theirs.
    loads = np.hstack([np.zeros((len(free), 0)), *(p.motion[:, free].T for p in pulled.values())])
    residual = deflection(loads) - modes / squares @ (modes.T @ loads)
    residual -= modes @ ((weighted @ modes).T @ (weighted @ residual))  # what round-off left of them
    # In shapes of unit strain energy; their kinetic energies are then 1 / omega^2. Grasps that share nodes
    # may have loads in common, which count once.
    energy = residual.T @ (stiffness @ residual)
    scale = 1.0 / np.sqrt(np.diag(energy))
    strengths, mix = np.linalg.eigh(energy * np.outer(scale, scale))
    own = strengths > _ROUND_OFF
    shapes = residual * scale @ mix[:, own] / np.sqrt(strengths[own])
    moving = weighted @ shapes
    kinetic, vectors = np.linalg.eigh(moving.T @ moving)
    if np.any(kinetic < _LEAST_KINETIC * np.max(kinetic, initial=0.0)):
        raise ModelError(_TOO_MANY.format(number_of_modes))
    attachments = (shapes @ vectors / np.sqrt(kinetic))[:, ::-1]

    frequencies = np.sqrt(np.concatenate([squares, 1.0 / kinetic[::-1]])) / (2.0 * np.pi)
    if number_of_modes and not frequencies[number_of_modes - 1] < highest_frequency:
        raise ModelError(
            f"highest_frequency is {highest_frequency} Hz, but mode {number_of_modes} has "
            f"{frequencies[number_of_modes - 1]:.4g} Hz; only attachment shapes can be condensed: "
            "ask for fewer modes or a higher frequency"
        )
    found = np.zeros((len(structure.elastic), len(frequencies)))
    found[free] = np.hstack([modes, attachments])
    at_grasps = np.array([p.motion @ found for p in places]).reshape(len(places), 6, len(frequencies))
    signs = upward_signs(at_grasps[-1, :3]) if places else np.ones(len(frequencies))
    at_grasps = at_grasps * signs * np.minimum(1.0, highest_frequency / frequencies)
    return TrussModes(
        positions=structure.points,
        masses=structure.point_masses,
        shapes=(structure.carried @ found * signs).reshape(len(structure.points), 3, len(frequencies)),
        frequencies=np.minimum(frequencies, highest_frequency),
        damping_ratios=np.zeros(len(frequencies)),
        grasp_positions=np.array([p.position for p in places]).reshape(-1, 3),
        grasp_translations=at_grasps[:, :3],
        grasp_rotations=at_grasps[:, 3:],
        source=f"{structure.source}: {number_of_modes} modes, {len(kinetic)} attachment shapes",
    )


def upward_signs(translations: Vector) -> Vector:
    """Return the signs that make shapes the same whatever eigensolver they come from.

    Parameters
    ----------
    translations : array, shape (3, h)
        Of one point in h shapes [kg^-½].

    Returns
    -------
    array, shape (h,)
        ±1 per shape, with which its largest component is positive [1].
    """
    largest = np.argmax(np.abs(translations), axis=0)
    return np.where(translations[largest, np.arange(translations.shape[1])] < 0.0, -1.0, 1.0)


def _flexibility(
    structure: Structure, free: npt.NDArray[np.intp], weighted: scipy.sparse.csr_array, rigid: Vector
) -> Callable[[Vector], Vector]:
    """Return what gives the deflections under loads; of a floating body, less its rigid motion."""
    stiffness = structure.stiffness[free][:, free]
    # The body accelerates under loads that are not balanced, and its own inertia balances them.
    momentum = weighted.T @ (weighted @ rigid)
    whole = stiffness
    if rigid.size:
        border = scipy.sparse.csr_array(momentum * (np.max(stiffness.diagonal()) / np.max(np.abs(momentum))))
        beside = scipy.sparse.csr_array((6, 6))
        whole = scipy.sparse.csr_array(
            scipy.sparse.block_array([[stiffness, border], [scipy.sparse.csr_array(border.T), beside]])
        )
    try:
        factors = scipy.sparse.linalg.splu(scipy.sparse.csc_array(whole))
    except RuntimeError as error:
        raise ModelError(_MECHANISM.format(structure.source, "it has freedoms that nothing holds")) from error

    def deflection(loads: Vector) -> Vector:
        ending = np.zeros((rigid.shape[1], *loads.shape[1:]))
        return np.asarray(factors.solve(np.concatenate([loads, ending]))[: len(free)])

    shaken = np.random.default_rng(0).standard_normal(len(free))
    shaken -= rigid @ np.linalg.solve(rigid.T @ momentum, momentum.T @ shaken)
    strange = np.abs(deflection(stiffness @ shaken) - shaken)
    if not np.max(strange) < _STRANGE * np.max(np.abs(shaken)):
        worst = structure.name_of(int(free[np.argmax(strange)]))
        raise ModelError(_MECHANISM.format(structure.source, f"look at {worst}"))
    return deflection


def _lowest_modes(
    deflection: Callable[[Vector], Vector],
    weighted: scipy.sparse.csr_array,
    stiffness: scipy.sparse.csr_array,
    number: int,
) -> tuple[Vector, Vector]:
    """Return squares of frequencies [rad²/s²], ascending, and mass-normalized modes of the free freedoms."""
    size = weighted.shape[0]
    if size <= 3 * _DENSE:
        values, vectors = scipy.linalg.eigh(weighted @ deflection(weighted.T.toarray()))
    else:
        operator = scipy.sparse.linalg.LinearOperator(
            (size, size), matvec=lambda y: weighted @ deflection(weighted.T @ y), dtype=float
        )
        # A fixed start: the iteration then gives the same numbers every time.
        start = np.random.default_rng(0).standard_normal(size)
        values, vectors = scipy.sparse.linalg.eigsh(operator, number + 1, v0=start)
    shapes = deflection(weighted.T @ vectors[:, np.argsort(-values)[:number]])
    # Round-off left them orthonormal to nine digits only.
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
            f"there is no node {number} in {structure.source}; its {len(nodes)} nodes have the "
            f"numbers {min(nodes)} to {max(nodes)}"
        )
    return nodes.index(number)


def nearest(positions: Vector, point: Vector) -> int:
    """Return which node is at a grasp point, within 2 mm.

    Parameters
    ----------
    positions : array, shape (n, 3)
        Of the nodes [m].
    point : array, shape (3,)
        [m].

    Raises
    ------
    ModelError
        If none is.
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
    """Return the motion of a grasp: that of its node, or the mean one of several by least squares."""
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
        # Displacements alone say how a face turns: the mean that a force on it is shared by.
        rigid[np.arange(len(rigid)) % 6 > 2] = 0.0
    size = np.linalg.norm(rigid, axis=0)
    if np.linalg.matrix_rank((rigid / np.where(size, size, 1.0))[structure.elastic[rows]], 1e-6) < 6:
        raise ModelError(
            f"grasp at nodes {[structure.nodes[n] for n in nodes]}: they do not say how it turns; a grasp is "
            "one node with rotations, or a set of three or more nodes that are not in line"
        )
    motion = np.zeros((6, len(structure.elastic)))
    motion[:, rows] = np.linalg.pinv(rigid)
    return _Interface(position, tuple(nodes), motion)

"""Natural frequencies of a structure with rigid bodies on its nodes, from all finite elements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from trussflow.blocks.support.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.truss.reduction import node_index
from trussflow.models.truss.structure import Structure

# Shift of the eigensolver [1/s²]: below all eigenvalues, so that the shifted stiffness of a free body is
# positive definite.
_SHIFT = -10.0


def natural_frequencies(
    structure: Structure,
    count: int,
    bodies: Mapping[int, Vector] | None = None,
    *,
    clamped: Sequence[int] = (),
    rigid: Sequence[int] = (),
) -> Vector:
    r"""Return the lowest elastic natural frequencies of a structure with rigid bodies on its nodes.

    .. math:: K \phi = \omega^2 (M + M_b) \phi

    Parameters
    ----------
    structure : Structure
        Undamped structure.
    count : int
        Number of frequencies; the zero frequencies of a free body do not count [-].
    bodies : mapping of int to array, shape (6, 6), optional
        Inertia matrix of the rigid body on a node, about the node, by the number of the node
        [kg, kg·m, kg·m²].
    clamped : sequence of int
        Numbers of the nodes that are held.
    rigid : sequence of int
        Numbers of the nodes that move together as one rigid body.

    Returns
    -------
    array, shape (count,)
        Frequencies in ascending order [Hz].

    Raises
    ------
    ModelError
        If there is no such node, or `count` is out of range.
    """
    held, face = (
        np.isin(
            np.arange(len(structure.nodes)), [node_index(structure, n) for n in part]
        )
        for part in (clamped, rigid)
    )
    inertias = {
        node_index(structure, n): inertia for n, inertia in (bodies or {}).items()
    }
    blocks = [
        inertias.get(node, np.zeros((6, 6))) for node in range(len(structure.nodes))
    ]
    added = scipy.sparse.csr_array(scipy.sparse.block_diag(blocks))
    moves = structure.elastic & ~np.repeat(held | face, 6)
    # All nodes of the rigid face share the six coordinates of one rigid body.
    together = structure.rigid_motions(np.zeros(3)) * np.repeat(face, 6)[:, None]
    single = scipy.sparse.eye_array(len(moves), format="csc")[:, moves]
    basis = scipy.sparse.hstack(
        [single, scipy.sparse.csc_array(together[:, : 6 * any(face)])]
    )
    mass, stiffness = (
        scipy.sparse.csc_array(basis.T @ matrix @ basis)
        for matrix in (structure.mass + added, structure.stiffness)
    )
    free = 0 if any(held) else 6
    limit = np.count_nonzero(mass.diagonal()) - free
    if not 1 <= count < limit:
        raise ModelError(
            f"cannot compute {count} natural frequencies of {structure.source}; choose 1 to {limit - 1}"
        )
    # A fixed start vector makes the iteration repeatable.
    start = np.random.default_rng(0).standard_normal(mass.shape[0])
    squares = scipy.sparse.linalg.eigsh(
        stiffness, count + free, mass, sigma=_SHIFT, v0=start, return_eigenvectors=False
    )
    return np.asarray(np.sqrt(np.sort(squares)[free:]) / (2.0 * np.pi))

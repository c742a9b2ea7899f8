r"""Finite-element model of a free flexible body: nodes, mass matrix, stiffness matrix, from any program.

All mass is represented by point masses, as the equations of motion require. A node with mass and inertia
becomes a rigid body of up to six point masses, without error. Mass terms that couple nodes ("consistent" mass
matrices) are lumped to the nodes, which preserves total mass, centre and inertia; `Structure.assumptions`
states it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.units import factor
from trussflow.blocks.support.files import reading
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import MOST_ELEMENTS
from trussflow.models.errors import ModelError
from trussflow.models.geometry.rotation import cross_matrix
from trussflow.models.validation import (
    check_choice,
    check_rotation,
    frozen_array,
    set_fields,
)

_SYMMETRY_TOLERANCE = 1e-9  # relative to the largest element
_RIGID_FORCE_TOLERANCE = (
    1e-6  # relative to the forces of the single elements of the matrix
)
_MASS_TOLERANCE = 1e-6  # of the point masses, relative to the total mass
_DIAGONAL_SHIFT = 1e-8  # of the stiffness matrix for its Cholesky-like factors, relative to the diagonal

# Squared extents below this, relative to the largest of the node, are round-off.
_EXTENT_TOLERANCE = 1e-9

_FREEDOMS = ("x", "y", "z", "rotation about x", "rotation about y", "rotation about z")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Structure:
    """Free elastic body of n nodes with six freedoms each, in SI units and one system of axes.

    Attributes
    ----------
    nodes : tuple of int
        Numbers of the nodes, for grasps and messages.
    positions : array, shape (n, 3)
        Positions of the nodes [m].
    mass, stiffness : sparse array, shape (6 n, 6 n)
        Matrices for displacements [m] and rotations [rad], node by node [kg, kg·m, kg·m²; N/m, N, N·m].
    source : str
        Origin of the data.
    assumptions : tuple of str
        Assumptions made when the data were read.
    inner : int
        Number of the last nodes, which are inside members and cannot be grasped [-].
    points, point_masses : array, shapes (p, 3) and (p,)
        Derived: the point masses that represent the mass [m, kg].
    carried : sparse array, shape (3 p, 6 n)
        Derived: matrix from the freedoms of the nodes to the displacements of the points [-, m].
    elastic : array of bool, shape (6 n,)
        Derived: whether each freedom has stiffness; the others must have no mass, and are ignored.

    Raises
    ------
    ModelError
        If the data are not those of a free body: asymmetric matrices, negative mass or stiffness,
        elastic forces in a rigid motion, freedoms with mass but without stiffness, or equal node numbers.
    """

    nodes: tuple[int, ...]
    positions: Vector
    mass: scipy.sparse.csr_array
    stiffness: scipy.sparse.csr_array
    source: str
    assumptions: tuple[str, ...] = ()
    inner: int = 0
    points: Vector = field(init=False, repr=False)
    point_masses: Vector = field(init=False, repr=False)
    carried: scipy.sparse.csr_array = field(init=False, repr=False)
    elastic: npt.NDArray[np.bool_] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        nodes = tuple(int(n) for n in self.nodes)
        positions = frozen_array(
            "structure: positions", self.positions, (len(nodes), 3)
        )
        set_fields(self, nodes=nodes, positions=positions)
        if len(set(nodes)) < len(nodes):
            twice = next(n for n in nodes if nodes.count(n) > 1)
            raise ModelError(
                f"structure: node number {twice} is used twice; each number must be unique"
            )
        set_fields(self, mass=self._checked("mass"))
        set_fields(self, stiffness=self._checked("stiffness"))
        set_fields(self, elastic=self.stiffness.diagonal() > 0.0)
        self._check_free()
        self._set_point_masses()

    @classmethod
    def from_matrices(
        cls,
        mass: Any,
        stiffness: Any,
        positions: npt.ArrayLike | Path,
        *,
        units: Sequence[str],
        nodes: Sequence[int] | None = None,
        axes: npt.ArrayLike | None = None,
        source: str = "matrices",
    ) -> Structure:
        """Return a structure from matrices with three or six freedoms per node, node by node.

        Parameters
        ----------
        mass, stiffness : sparse or dense matrix, str or pathlib.Path
            Matrix, or file: Matrix Market (.mtx), .npy, or .npz by `scipy.sparse.save_npz` or `numpy.savez`.
            The latter has the array ``mass`` or ``stiffness`` [`units`].
        positions : array_like, shape (n, 3), str or pathlib.Path
            Positions of the nodes, or a file of the same kinds; in .npz as ``positions`` [`units`].
        units : sequence of str
            Units of length, mass and time, for example ``("mm", "t", "s")``; the others are derived.
        nodes : sequence of int, optional
            Numbers of the nodes [-]; by default 1 to n.
        axes : array_like, shape (3, 3) or (n, 3, 3), optional
            Rotations from the axes of a node's freedoms to the axes of the positions [-].
        source : str
            Origin of the data.

        Raises
        ------
        ModelError
            If a file cannot be read, a size or unit is wrong, axes are not a rotation, or the data are not
            those of a free body.
        """
        length, kilogram, second = _factors(units)
        if isinstance(positions, str | Path):
            matrix = _matrix("positions", positions)
            if math.prod(matrix.shape) > MOST_ELEMENTS:
                raise ModelError(
                    f"structure: positions has shape {matrix.shape}, more than {MOST_ELEMENTS:,} elements"
                )
            positions = matrix.toarray()
        places = frozen_array("structure: positions", positions, (None, 3)) * length
        count = len(places)
        given = np.asarray(np.eye(3) if axes is None else axes)
        turns = frozen_array(
            "structure: axes", given, (count, 3, 3) if given.ndim == 3 else (3, 3)
        )
        turns = np.broadcast_to(turns, (count, 3, 3))
        for turn in turns:
            check_rotation("structure", "axes", turn)
        # Each node has one rotation for its displacements and one for its rotations.
        turned = scipy.sparse.block_diag(
            [turn for turn in turns for _ in range(2)], format="csr"
        )
        found: dict[str, Any] = {}
        for name, what, unit in (
            ("mass", mass, kilogram),
            ("stiffness", stiffness, kilogram / second**2),
        ):
            matrix = _matrix(name, what)
            freedoms = matrix.shape[0] // max(count, 1)
            if matrix.shape != (freedoms * count,) * 2 or freedoms not in (3, 6):
                raise ModelError(
                    f"structure: the {name} matrix has shape {matrix.shape}; with three or six freedoms at "
                    f"each of {count} nodes it must be {(3 * count,) * 2} or {(6 * count,) * 2}"
                )
            # Rotations are in radians in any unit of length.
            scale = np.tile([1.0, 1.0, 1.0, length, length, length][:freedoms], count)
            # Rows among six freedoms per node; with three, those of rotations stay
            # zero.
            place = np.arange(6 * count).reshape(-1, 6)[:, :freedoms].ravel()
            row, column = matrix.coords
            entries = unit * matrix.data * scale[row] * scale[column]
            whole = scipy.sparse.coo_array(
                (entries, (place[row], place[column])), shape=(6 * count,) * 2
            )
            found[name] = scipy.sparse.csr_array(turned @ whole.tocsr() @ turned.T)
        stated = f"lengths are in {units[0]}, masses in {units[1]}, times in {units[2]}, as the user stated"
        numbers = tuple(range(1, count + 1)) if nodes is None else tuple(nodes)
        return cls(
            nodes=numbers,
            positions=places,
            source=source,
            assumptions=(stated,),
            **found,
        )

    @property
    def rigid_mass(self) -> Vector:
        """Mass matrix of the rigid body about the origin, shape (6, 6) [kg, kg·m, kg·m²]."""
        rigid = self.rigid_motions(np.zeros(3))
        return np.asarray(rigid.T @ (self.mass @ rigid))

    @property
    def centre(self) -> Vector:
        """Centre of mass, shape (3,) [m]."""
        centre: Vector = self.point_masses @ self.points / np.sum(self.point_masses)
        return centre

    def rigid_motions(self, about: Vector) -> Vector:
        """Return the motions of all freedoms in the six rigid motions, shape (6 n, 6) [-, m].

        Parameters
        ----------
        about : array, shape (3,)
            Centre of the rotations [m].
        """
        motions = np.tile(np.eye(6), (len(self.positions), 1, 1))
        motions[:, :3, 3:] = [-cross_matrix(p - about) for p in self.positions]
        return motions.reshape(-1, 6)

    def rods(self, points: Vector) -> npt.NDArray[np.int_]:
        """Return the lines of a picture: pairs of the points nearest to nodes that elements connect.

        Parameters
        ----------
        points : array, shape (k, 3)
            Points, such as the `positions` of its `TrussModes` [m].

        Returns
        -------
        array, shape (m, 2)
            Indices of points, from 0 [-].
        """
        from scipy.spatial import KDTree

        joining = np.abs(self.stiffness.data) > _SYMMETRY_TOLERANCE * np.max(
            self.stiffness.data
        )
        nodes = np.column_stack(
            [part[joining] // 6 for part in self.stiffness.tocoo().coords]
        )
        nearest = np.asarray(KDTree(points).query(self.positions)[1])
        pairs = np.unique(np.sort(nearest[nodes], axis=1), axis=0)
        return pairs[pairs[:, 0] < pairs[:, 1]]

    def name_of(self, freedom: int) -> str:
        """Return the name of a freedom in messages.

        Parameters
        ----------
        freedom : int
            Row of the freedom in the matrices [-].
        """
        return f"node {self.nodes[freedom // 6]}, {_FREEDOMS[freedom % 6]}"

    def _checked(self, name: str) -> scipy.sparse.csr_array:
        """Return a matrix made exactly symmetric, or raise `ModelError` if it is invalid."""
        given = scipy.sparse.csr_array(getattr(self, name))
        what, size = f"structure: the {name} matrix", 6 * len(self.nodes)
        if given.shape != (size, size):
            raise ModelError(
                f"{what} has shape {given.shape}; it must be {(size, size)}"
            )
        if given.nnz == 0 or not np.all(np.isfinite(given.data)):
            raise ModelError(
                f"{what} {'has elements that are not finite' if given.nnz else 'is zero'}"
            )
        off = (given - given.T).tocoo()
        largest = float(np.max(np.abs(given.data)))
        if off.nnz and np.max(np.abs(off.data)) > _SYMMETRY_TOLERANCE * largest:
            worst = int(np.argmax(np.abs(off.data)))
            row, column = (self.name_of(int(c[worst])) for c in off.coords)
            raise ModelError(
                f"{what} is not symmetric: at ({row}) and ({column}) its elements differ by "
                f"{abs(off.data[worst]):.4g}; was only one triangle of it written?"
            )
        diagonal = given.diagonal()
        if np.any(diagonal < 0.0):
            worst = int(np.argmin(diagonal))
            raise ModelError(
                f"{what} is negative at {self.name_of(worst)}: {diagonal[worst]:.4g}"
            )
        return scipy.sparse.csr_array((given + given.T) / 2.0)

    def _check_free(self) -> None:
        """Raise `ModelError` if a rigid motion causes forces, or a freedom with mass has no stiffness."""
        loose = ~self.elastic & (self.mass.diagonal() > 0.0)
        if np.any(loose):
            raise ModelError(
                f"structure: {self.name_of(int(np.argmax(loose)))} has mass but no stiffness; "
                "the structure is a mechanism; connect the node"
            )
        rigid = self._even_motions()
        forces = np.abs(self.stiffness @ rigid)
        # The exact forces are zero, so round-off is relative to the sum of magnitudes.
        wrong = forces - _RIGID_FORCE_TOLERANCE * np.max(
            abs(self.stiffness) @ np.abs(rigid), axis=1, keepdims=True
        )
        if np.max(wrong) > 0.0:
            freedom, motion = np.unravel_index(np.argmax(wrong), wrong.shape)
            raise ModelError(
                f"structure: it is not free: a rigid motion ({_FREEDOMS[int(motion)]}) causes an elastic "
                f"force of {forces[freedom, motion]:.4g} at {self.name_of(int(freedom))}; remove supports "
                "and springs to ground, and check the axes of the nodes"
            )
        held = self.stiffness[self.elastic][:, self.elastic]
        # Rigid motions have zero eigenvalues, which round-off may make negative.
        raised = scipy.sparse.csc_array(
            held + scipy.sparse.diags_array(_DIAGONAL_SHIFT * held.diagonal())
        )
        # Without row exchanges the pivots have the signs of the eigenvalues (Sylvester's law of inertia).
        factors = scipy.sparse.linalg.splu(
            raised,
            "MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        if np.min(factors.U.diagonal(), initial=1.0) <= 0.0:
            raise ModelError(
                "structure: the stiffness matrix is not positive semidefinite; check its signs"
            )

    def _even_motions(self) -> Vector:
        """Return rigid motions about the middle of the nodes, scaled to displacements of similar size."""
        size = float(
            np.max(np.ptp(self.positions, axis=0), initial=np.finfo(float).tiny)
        )
        return np.asarray(
            self.rigid_motions(self.positions.mean(axis=0)) / np.repeat([1.0, size], 3)
        )

    def _set_point_masses(self) -> None:
        """Set the point masses that represent the mass, and their matrix from the nodes' freedoms."""
        count = len(self.nodes)
        # Row sums over all nodes: coupled mass is lumped to the node of its row.
        moved = (self.mass @ self.rigid_motions(np.zeros(3))).reshape(count, 6, 6)
        points, masses, blocks = [], [], []
        for node in np.flatnonzero(np.any(moved, axis=(1, 2))):
            for mass, offset in _rigid_points(moved[node], self.positions[node]):
                masses.append(mass)
                points.append(self.positions[node] + offset)
                blocks.append((node, np.hstack([np.eye(3), -cross_matrix(offset)])))
        rows = np.repeat(np.arange(3 * len(points)).reshape(-1, 3, 1), 6, axis=2)
        columns = np.array(
            [6 * n + np.tile(np.arange(6), (3, 1)) for n, _ in blocks], dtype=int
        )
        entries = np.array([block for _, block in blocks]).ravel()
        carried = scipy.sparse.coo_array(
            (entries, (rows.ravel(), columns.ravel())),
            shape=(3 * len(points), 6 * count),
        )
        set_fields(
            self,
            points=np.array(points),
            point_masses=np.array(masses),
            carried=carried.tocsr(),
        )
        row, column = self.mass.tocoo().coords
        if np.any(row // 6 != column // 6):
            lumped = "mass that couples nodes was lumped to them; total mass, centre and inertia are preserved"
            set_fields(self, assumptions=(*self.assumptions, lumped))
        rigid = self._even_motions()
        kept = self.carried @ rigid
        error = rigid.T @ (self.mass @ rigid) - (kept.T * np.repeat(masses, 3)) @ kept
        total = float(np.sum(masses))
        if not total > 0.0 or np.max(np.abs(error)) > _MASS_TOLERANCE * total:
            raise ModelError(
                f"structure: point masses cannot represent its mass (total {total:.4g} kg, error "
                f"{np.max(np.abs(error)):.4g} kg): each node must have the same mass in x, y and z, and the "
                "inertia of a rigid body; export lumped masses"
            )


def _rigid_points(moved: Vector, position: Vector) -> list[tuple[float, Vector]]:
    """Return masses and offsets [kg, m] of the point masses that represent a node's rigid body.

    Parameters
    ----------
    moved : array, shape (6, 6)
        Momentum of the node in the six rigid motions about the origin.
    position : array, shape (3,)
        Position of the node.
    """
    moved = moved.copy()
    moved[:, 3:] += moved[:, :3] @ cross_matrix(position)  # about the node
    block = (moved + moved.T) / 2.0
    mass = float(block[0, 0])  # must be equal for y and z
    if not mass > 0.0:
        return []
    # The coupling blocks of a rigid body are m c^x and -m c^x, with its centre c.
    tilt = (block[3:, :3] - block[:3, 3:]) / (2.0 * mass)
    centre = np.array([tilt[2, 1], tilt[0, 2], tilt[1, 0]])
    # Parallel-axis theorem, divided by the mass.
    about_centre = (
        block[3:, 3:] / mass + np.outer(centre, centre) - centre @ centre * np.eye(3)
    )
    # Eigenvalues of the second moment of mass per mass: squares of the extents.
    squares, along = np.linalg.eigh(
        np.trace(about_centre) / 2.0 * np.eye(3) - about_centre
    )
    wide = squares > _EXTENT_TOLERANCE * max(
        centre @ centre, float(np.max(squares)), np.finfo(float).tiny
    )
    # One of d pairs has the mass share 1/d, so points at +-sqrt(d s) have the moment s.
    offsets = np.sqrt(np.count_nonzero(wide) * squares[wide]) * along[:, wide]
    places = [
        centre + sign * offset for offset in offsets.T for sign in (1.0, -1.0)
    ] or [centre]
    return [(mass / len(places), place) for place in places]


def _factors(units: Sequence[str]) -> list[float]:
    """Return the units in metres, kilograms and seconds."""
    wanted = "m", "kg", "s"
    try:
        if isinstance(units, str) or len(units) != len(wanted):
            raise BlockError("there are not three texts")
        return [factor(unit, si) for unit, si in zip(units, wanted, strict=True)]
    except BlockError as error:
        raise ModelError(
            f"structure: units are {units!r}; they must be three, of length, mass and time, "
            f'such as ("mm", "t", "s"): {error}'
        ) from error


def _matrix(name: str, given: Any) -> scipy.sparse.coo_array:
    """Return a sparse matrix from a matrix or a file."""
    what = f"structure: the {name}" + " matrix" * (name != "positions")
    if isinstance(given, str | Path):
        from scipy.io import mminfo, mmread

        def market(path: Path) -> Any:
            _, _, entries, *_ = mminfo(path)
            # An entry has at least one byte; a false header would allocate without
            # limit.
            if entries > path.stat().st_size:
                raise ValueError(
                    f"the file is too short for the {entries:,} entries that it declares"
                )
            return mmread(path)

        def archived(path: Path) -> Any:
            with np.load(path) as arrays:
                if "format" in arrays:
                    return scipy.sparse.load_npz(path)
                check_choice(f"array in {path.name}:", name, arrays)
                return arrays[name]

        # Memory-mapped, since numpy then compares the size in the header with the size of the file.
        readers: dict[str, Any] = {
            ".mtx": market,
            ".npz": archived,
            ".npy": partial(np.load, mmap_mode="r"),
        }
        suffix = Path(given).suffix
        check_choice(f"reader of {what} for files", suffix, readers)
        with reading(given, ModelError, f"{what} cannot be read from") as path:
            given = readers[suffix](path)
    try:
        entries = given if scipy.sparse.issparse(given) else np.asarray(given)
        matrix: scipy.sparse.coo_array = scipy.sparse.coo_array(entries)  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        raise ModelError(f"{what} must be a matrix of numbers: {error}") from error
    if matrix.ndim != 2 or matrix.dtype.kind not in "iuf":
        raise ModelError(
            f"{what} must be a matrix of real numbers, not {matrix.ndim}-dimensional {matrix.dtype}"
        )
    return matrix.astype(float)

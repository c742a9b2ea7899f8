"""User-defined frames: nodes, and members with sections and materials, from TOML or in a script."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from trussflow.blocks.support.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.geometry.spatial import (
    SpatialInertia,
    inertia_matrix,
    moved_inertia,
)
from trussflow.models.parameter_files import ParameterTable
from trussflow.models.truss.stiffness import Rigidity, assembled_stiffness
from trussflow.models.truss.structure import Structure
from trussflow.models.validation import (
    check_body,
    check_choice,
    check_number,
    frozen_array,
    set_fields,
)

# Least distance of two nodes, relative to the size of the frame.
_SAME_PLACE = 1e-6

_MAX_ELEMENTS = 1000


class FrameMember(NamedTuple):
    """Straight rod between two nodes.

    Attributes
    ----------
    start, end : int
        Numbers of its nodes, from 1.
    elements : int
        Number of beam elements: even, since Simpson's rule lumps the mass, or 1. Hinged rods have 1.
    rigidity : Rigidity
        Rigidities; a hinged rod has no bending and no torsional rigidity.
    density : float
        Mass per length [kg/m].
    """

    start: int
    end: int
    elements: int
    rigidity: Rigidity
    density: float


class FrameMass(NamedTuple):
    """Rigid body attached to a node.

    Attributes
    ----------
    node : int
        Number of the node, from 1.
    mass : float
        Mass [kg].
    offset : array, shape (3,)
        Centre of mass relative to the node, in the axes of the frame [m].
    inertia : array, shape (3, 3)
        Inertia about the centre of mass; zero for a point mass [kg·m²].
    """

    node: int
    mass: float
    offset: Vector
    inertia: Vector


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """Frame of nodes, members and attached masses.

    Members are rigidly connected Euler–Bernoulli beams, or hinged rods. They have no inertia about their
    own axis.

    Attributes
    ----------
    positions : array, shape (n, 3)
        Positions of nodes 1 to n [m].
    members : tuple of FrameMember
        Members, at least one.
    masses : tuple of FrameMass
        Masses attached to nodes.
    source : str
        Origin of the data.

    Raises
    ------
    ModelError
        If two nodes coincide; a member has no length, an unknown node, an odd number of elements, no
        stiffness or negative mass; or a mass is physically impossible.
    """

    positions: Vector
    members: tuple[FrameMember, ...]
    masses: tuple[FrameMass, ...] = ()
    source: str = "frame"

    def __post_init__(self) -> None:
        from scipy.spatial import KDTree  # slow to import

        positions = frozen_array(f"{self.source}: positions", self.positions, (None, 3))
        set_fields(self, positions=positions)
        if not self.members:
            raise ModelError(
                f"{self.source}: there are no members; a frame needs at least one"
            )
        numbers = range(1, len(positions) + 1)
        size = np.max(np.ptp(positions, axis=0), initial=0.0)
        for i, j in sorted(KDTree(positions).query_pairs(_SAME_PLACE * size)):
            raise ModelError(
                f"{self.source}: nodes {i + 1} and {j + 1} are at the same place"
            )
        for member in self.members:
            name = f"{self.source}: member {member.start}-{member.end}"
            for end in member[:2]:
                check_choice(f"node for {name}:", end, numbers)
            if member.start == member.end:
                raise ModelError(f"{name} has no length; it must connect two nodes")
            hinged = not np.any(member.rigidity.bending)
            if member.elements != 1 and (
                hinged or member.elements not in range(2, _MAX_ELEMENTS + 1, 2)
            ):
                raise ModelError(
                    f"{name} has {member.elements} elements; it must be 1 or an even number up to "
                    f"{_MAX_ELEMENTS}, since Simpson's rule lumps the mass, and 1 for a hinged rod"
                )
            check_number(name, stretching=member.rigidity.stretching)
            check_number(name, zero=True, density=member.density)
        for mass in self.masses:
            check_choice(f"node for a mass in {self.source}:", mass.node, numbers)
            check_number(f"{self.source}: mass on node {mass.node}", mass=mass.mass)
            if np.any(mass.inertia):
                check_body(
                    self.source,
                    f"the mass on node {mass.node}",
                    mass.mass,
                    np.zeros(3),
                    mass.inertia,
                )

    @classmethod
    def from_file(cls, path: str | Path) -> Frame:
        """Read a frame from a TOML file; examples/missions/boom.toml has all keys.

        Parameters
        ----------
        path : str or pathlib.Path
            File with the tables ``nodes``, ``materials``, ``sections``, ``[[members]]`` and, optionally,
            ``[[masses]]``.

        Raises
        ------
        ModelError
            If the file cannot be read, a key is unknown or missing, a unit is wrong, or the frame is invalid.
        """
        table = ParameterTable.read(path)
        table.only("source", "nodes", "materials", "sections", "members", "masses")
        nodes, names = table.table("nodes"), {}
        nodes.only("positions")
        for kind in ("materials", "sections"):
            found = table.table(kind)
            names[kind] = {name: found.table(name) for name in found.content}
        positions = nodes.array("positions", "m", (None, 3))
        members = [
            m for t in table.tables("members") for m in _members(t, positions, **names)
        ]
        masses = [
            m
            for t in (table.tables("masses") if "masses" in table else [])
            for m in _masses(t)
        ]
        return cls(
            positions=positions,
            members=tuple(members),
            masses=tuple(masses),
            source=table.place,
        )

    def structure(self) -> Structure:
        """Return the finite-element model: first the nodes, then the points inside members."""
        ends = [(m.start - 1, m.end - 1, m.elements) for m in self.members]
        positions, chains, lengths = meshed(self.positions, ends)
        # Lengths are summed before they are multiplied by a density, so that equal rods have equal masses.
        lumped = {member.density: np.zeros(len(positions)) for member in self.members}
        for chain, length, member in zip(chains, lengths, self.members, strict=True):
            lumped[member.density][chain] += length
        masses = np.sum(
            [density * length for density, length in lumped.items()], axis=0
        )
        blocks = [np.diag([m, m, m, 0.0, 0.0, 0.0]) for m in masses]
        for node, mass, offset, inertia in self.masses:
            body = moved_inertia(
                SpatialInertia(mass, np.zeros(3), inertia), np.eye(3), offset
            )
            blocks[node - 1] += inertia_matrix(body)
        elements = [pair for chain in chains for pair in pairwise(chain)]
        rods = [m.rigidity for m in self.members for _ in range(m.elements)]
        return Structure(
            nodes=tuple(range(1, len(positions) + 1)),
            positions=positions,
            mass=scipy.sparse.csr_array(scipy.sparse.block_diag(blocks)),
            stiffness=assembled_stiffness(positions, elements, rods),
            source=self.source,
            inner=len(positions) - len(self.positions),
            assumptions=(
                "beams have no shear deformation and no inertia about their own axis",
            ),
        )


def meshed(
    nodes: Vector, members: Sequence[tuple[int, int, int]]
) -> tuple[Vector, list[list[int]], list[Vector]]:
    """Return the mesh points of a frame, and the length of rod lumped to each.

    Simpson's rule along each member makes mass, static moment and inertia of rods exact.

    Parameters
    ----------
    nodes : array, shape (k, 3)
        Positions of the nodes [m].
    members : sequence of (int, int, int)
        First node, second node, number of elements: an even number, or 1.

    Returns
    -------
    positions : array, shape (n, 3)
        First the nodes, then the points inside members [m].
    chains : list of list of int
        Indices of the points along each member.
    lengths : list of array
        Length lumped to each point of each member [m].
    """
    positions, chains, lengths = list(nodes), [], []
    for start, end, elements in members:
        span = nodes[end] - nodes[start]
        # Simpson's weights 1, 4, 2, ..., 4, 1; one element has half its length at each
        # end.
        weights = np.array([1.0, *([4.0, 2.0] * elements)[: elements - 1], 1.0])
        lengths.append(weights * (np.linalg.norm(span) / np.sum(weights)))
        chains.append(
            [start, *range(len(positions), len(positions) + elements - 1), end]
        )
        positions += [nodes[start] + span * (i / elements) for i in range(1, elements)]
    return np.array(positions), chains, lengths


def _members(
    table: ParameterTable,
    positions: Vector,
    materials: dict[str, ParameterTable],
    sections: dict[str, ParameterTable],
) -> list[FrameMember]:
    """Return the members of one table, with one material and section."""
    table.only("ends", "material", "section", "elements", "hinged", "across")
    for key, known in (("material", materials), ("section", sections)):
        check_choice(f"{key} for {table.place}:", table.text(key), known)
    material, section = (
        materials[table.text("material")],
        sections[table.text("section")],
    )
    material.only("youngs_modulus", "poissons_ratio", "density")
    stuff = material.scalars(youngs_modulus="Pa", poissons_ratio="1", density="kg/m^3")
    check_number(
        material.place, **{k: v for k, v in stuff.items() if k != "poissons_ratio"}
    )
    if not -1.0 < stuff["poissons_ratio"] <= 0.5:
        raise ModelError(
            f"{material.place}: poissons_ratio is {stuff['poissons_ratio']}; it must be in (-1, 0.5]"
        )
    area, moments, torsion = _section(section)
    modulus = stuff["youngs_modulus"]
    hinged, elements = (
        table.content.get("hinged", False),
        table.content.get("elements", 2),
    )
    if (
        not isinstance(hinged, bool)
        or type(elements) is not int
        or (hinged and "elements" in table)
    ):
        raise ModelError(
            f"{table.place}: hinged is {hinged!r} and elements is {elements!r}; hinged must be true or "
            "false, elements a whole number that a hinged rod must not have"
        )
    if hinged:
        # A hinged rod transmits only the force along its axis.
        elements, moments, torsion = 1, np.zeros(2), 0.0
    # Shear modulus of an isotropic material: G = E / (2 (1 + nu)).
    twisting = modulus / (2.0 * (1.0 + stuff["poissons_ratio"])) * torsion
    found = []
    for start, end in _numbers(table, "ends", 2):
        bending = modulus * _bending(table, positions, (start, end), moments)
        rigidity = Rigidity(modulus * area, bending, twisting)
        found.append(
            FrameMember(start, end, elements, rigidity, stuff["density"] * area)
        )
    return found


def _section(table: ParameterTable) -> tuple[float, Vector, float]:
    """Return area [m²], two second moments of area and torsion constant [m⁴]."""
    if "diameter" in table:
        table.only("diameter", "wall")
        outer = table.scalar("diameter", "m")
        inner = outer - 2.0 * table.scalar("wall", "m") if "wall" in table else 0.0
        if not 0.0 <= inner < outer:
            raise ModelError(
                f"{table.place}: diameter and wall must be above 0, and the wall at most the radius"
            )
        moment = pi * (outer**4 - inner**4) / 64.0
        # The torsion constant of a round section is its polar moment, twice the other.
        return pi * (outer**2 - inner**2) / 4.0, np.full(2, moment), 2.0 * moment
    table.only("area", "second_moments", "torsion_constant")
    area, torsion = table.scalar("area", "m^2"), table.scalar("torsion_constant", "m^4")
    moments = table.array("second_moments", "m^4", (2,))
    check_number(
        table.place, area=area, torsion_constant=torsion, second_moments=np.min(moments)
    )
    return area, moments, torsion


def _bending(
    table: ParameterTable, positions: Vector, ends: tuple[int, int], moments: Vector
) -> Vector:
    """Return the second moments of area as a tensor: the first for bending in the plane of `across`."""
    if moments[0] == moments[1]:
        return np.asarray(moments[0] * np.eye(3))
    if "across" not in table or not all(1 <= n <= len(positions) for n in ends):
        raise ModelError(
            f"{table.place}: 'across' is missing; a section with two different second moments needs a vector "
            "that defines, with the rod, the bending plane of the first"
        )
    across = frozen_array(f"{table.place}: 'across'", table.content["across"], (3,))
    along = positions[ends[1] - 1] - positions[ends[0] - 1]
    normal = np.cross(along, across)
    if np.linalg.norm(normal) <= _SAME_PLACE * np.linalg.norm(along) * np.linalg.norm(
        across
    ):
        raise ModelError(
            f"{table.place}: 'across' is parallel to member {ends[0]}-{ends[1]}; the two must span a plane"
        )
    # Bending in the plane of `across` rotates about the normal of this plane.
    axes = [v / np.linalg.norm(v) for v in (normal, np.cross(normal, along))]
    return np.asarray(
        sum(moment * np.outer(v, v) for moment, v in zip(moments, axes, strict=True))
    )


def _masses(table: ParameterTable) -> list[FrameMass]:
    """Return the equal masses of one table."""
    table.only("nodes", "mass", "offset", "inertia")
    mass = table.scalar("mass", "kg")
    offset = table.array("offset", "m", (3,)) if "offset" in table else np.zeros(3)
    inertia = (
        table.array("inertia", "kg*m^2", (3, 3))
        if "inertia" in table
        else np.zeros((3, 3))
    )
    return [
        FrameMass(node, mass, offset, inertia)
        for (node,) in _numbers(table, "nodes", 1)
    ]


def _numbers(table: ParameterTable, key: str, count: int) -> list[tuple[int, ...]]:
    """Return tuples of `count` node numbers."""
    rows = table.rows(key)
    if {len(row) for row in rows} != {count}:
        raise table.error(
            key, f"must have {count} node number{'s' * (count > 1)} each, got {rows}"
        )
    return [tuple(row) for row in rows]

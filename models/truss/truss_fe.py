"""Finite-element model of the L-shaped space truss, reduced to its lowest modes.

Pynite (PyNiteFEA) analyses the frame. ``python -m trussflow.models.truss.truss_fe`` writes the data
file of the package.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, pi, sin
from pathlib import Path

import numpy as np
import scipy

from trussflow.blocks.framework.types import Array, Vector
from trussflow.models.errors import ModelError
from trussflow.models.parameter_files import ParameterTable
from trussflow.models.truss.frame import meshed
from trussflow.models.truss.frame_analysis import CLAMPED_NODES, eigenmodes
from trussflow.models.truss.reduction import nearest, upward_signs
from trussflow.models.truss.stiffness import stiffness_matrix
from trussflow.models.truss.structure import Structure
from trussflow.models.truss.truss_modes import TrussModes

# The iterative eigensolver starts from a random vector. Further decimals [kg^-1/2] of its results are not
# reproducible, so they are rounded off.
_DECIMALS = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class TrussFrame:
    """L-shaped truss of two arms of box modules, of rigidly connected round rods without diagonals.

    Each arm is a row of modules: square frames connected by four longerons. The arms share one
    mitred frame at the bend. The four corners of the first frame are clamped.

    Attributes
    ----------
    first_arm_modules, second_arm_modules : int
        Number of modules along x, and after the bend [-].
    module_length : float
        Length of a module along its outer edge [m].
    width : float
        Side of the square section [m].
    bend_angle : float
        Direction of the second arm from the x axis, in the x-y plane; negative towards the
        inner edge [rad].
    rod_radius : float
        Radius of the solid round rods [m].
    youngs_modulus : float
        Young's modulus [Pa].
    poissons_ratio : float
        Poisson's ratio [1].
    mass : float
        Mass of the whole truss [kg], which determines the density.
    elements_per_longeron, elements_per_edge : int
        Number of beam elements per member, even [-].

    Raises
    ------
    ModelError
        If a value is out of its range.
    """

    first_arm_modules: int
    second_arm_modules: int
    module_length: float
    width: float
    bend_angle: float
    rod_radius: float
    youngs_modulus: float
    poissons_ratio: float
    mass: float
    elements_per_longeron: int
    elements_per_edge: int

    def __post_init__(self) -> None:
        lengths = ("module_length", "width", "rod_radius", "youngs_modulus", "mass")
        for name in (*lengths, "first_arm_modules", "second_arm_modules"):
            if not 0 < getattr(self, name) < np.inf:
                raise ModelError(f"truss frame: {name} is {getattr(self, name)}; it must be positive")
        if not -1.0 < self.poissons_ratio <= 0.5:
            raise ModelError(f"truss frame: poissons_ratio is {self.poissons_ratio}; it must be in (-1, 0.5]")
        if not -pi / 2 < self.bend_angle < pi / 2:
            raise ModelError(f"truss frame: bend_angle is {self.bend_angle} rad; it must be within ±pi/2")
        for name in ("elements_per_longeron", "elements_per_edge"):
            if getattr(self, name) < 2 or getattr(self, name) % 2:
                raise ModelError(
                    f"truss frame: {name} is {getattr(self, name)}; Simpson's rule, which lumps the "
                    "mass, needs an even number of elements"
                )

    @classmethod
    def reconstructed(cls) -> TrussFrame:
        """Return the frame that reproduces the paper's truss."""
        table = ParameterTable.shipped("space_truss.toml").table("frame")
        counts = ("first_arm_modules", "second_arm_modules", "elements_per_longeron", "elements_per_edge")
        values = table.scalars(
            module_length="m",
            width="m",
            bend_angle="rad",
            rod_radius="m",
            youngs_modulus="Pa",
            poissons_ratio="1",
            mass="kg",
        )
        return cls(**{name: int(table.scalar(name, "1")) for name in counts}, **values)

    def corners(self) -> Vector:
        """Return the corner nodes, four per frame, shape (4 (modules + 1), 3) [m].

        The order in each frame is: outer low, inner low, inner high, outer high.
        """
        first = np.array([1.0, 0.0])
        second = np.array([cos(self.bend_angle), sin(self.bend_angle)])
        right = [np.array([d[1], -d[0]]) for d in (first, second)]
        # The mitre is along the bisector, with the length that gives both arms their width.
        mitre = (right[0] + right[1]) / (1.0 + right[0] @ right[1])
        n = self.first_arm_modules
        frames = []
        for k in range(n + self.second_arm_modules + 1):
            outer = self.module_length * (min(k, n) * first + max(k - n, 0) * second)
            inwards = right[0] if k < n else right[1] if k > n else mitre
            inner = outer + self.width * inwards
            frames += [[*outer, 0.0], [*inner, 0.0], [*inner, self.width], [*outer, self.width]]
        return np.array(frames)

    def members(self) -> list[tuple[int, int, int]]:
        """Return the members as (first corner, second corner, number of elements)."""
        frames = self.first_arm_modules + self.second_arm_modules + 1
        edges = [
            (4 * k + c, 4 * k + (c + 1) % 4, self.elements_per_edge) for k in range(frames) for c in range(4)
        ]
        longerons = [
            (4 * k + c, 4 * k + 4 + c, self.elements_per_longeron)
            for k in range(frames - 1)
            for c in range(4)
        ]
        return edges + longerons

    def point_masses(self) -> tuple[Vector, Vector]:
        """Return all mesh points and their masses.

        Simpson's rule along each member makes mass, static moment and inertia of the rods
        exact.

        Returns
        -------
        positions : array, shape (n, 3)
            First the corners, then the points inside members [m].
        masses : array, shape (n,)
            Point masses [kg].
        """
        positions, chains, lengths = meshed(self.corners(), self.members())
        shares = np.zeros(len(positions))
        for chain, length in zip(chains, lengths, strict=True):
            shares[chain] += length
        return positions, self.mass / np.sum(shares) * shares

    def elements(self) -> list[tuple[int, int]]:
        """Return the beam elements as (first, second mesh point), numbered as in `point_masses`."""
        _, chains, _ = meshed(self.corners(), self.members())
        return [pair for chain in chains for pair in itertools.pairwise(chain)]

    def structure(self) -> Structure:
        """Return the free finite-element model; nodes are the mesh points, numbered from 1."""
        positions, masses = self.point_masses()
        return Structure(
            nodes=tuple(range(1, len(positions) + 1)),
            positions=positions,
            mass=scipy.sparse.csr_array(
                scipy.sparse.diags_array(np.ravel([[m, m, m, 0.0, 0.0, 0.0] for m in masses]))
            ),
            stiffness=stiffness_matrix(self),
            source=__name__,
        )

    def mesh_points(self, points: Array) -> list[int]:
        """Return the indices of mesh points at given points, as in `point_masses`.

        Parameters
        ----------
        points : array, shape (k, 3)
            Points, each within 2 mm of a mesh point [m].

        Returns
        -------
        list of int

        Raises
        ------
        ModelError
            If a point is not at a mesh point.
        """
        positions, _ = self.point_masses()
        return [nearest(positions, point) for point in np.asarray(points, dtype=float)]

    def check_number_of_modes(self, count: int) -> None:
        """Raise `ModelError` unless the clamped mesh has more than `count` modes."""
        limit = 3 * (len(self.point_masses()[1]) - CLAMPED_NODES)
        if not 1 <= count < limit:
            raise ModelError(f"cannot compute {count} modes of this mesh; choose 1 to {limit - 1}")

    def modes(self, number_of_modes: int, grasp_points: Array) -> TrussModes:
        """Return the lowest modes of the frame, undamped.

        Parameters
        ----------
        number_of_modes : int
            Number of modes, at least one [-].
        grasp_points : array, shape (k, 3)
            Grasp points, each within 2 mm of a mesh point, whose mode shapes it has [m].

        Returns
        -------
        TrussModes
            Modes with ascending frequencies. The sign of each mode makes its largest translation
            component at the last grasp point positive.

        Raises
        ------
        ModelError
            If a grasp point is not at a mesh point, or the mesh has fewer modes.
        """
        positions, masses = self.point_masses()
        self.check_number_of_modes(number_of_modes)
        points = np.asarray(grasp_points, dtype=float)
        nodes = self.mesh_points(points)
        frequencies, translations, rotations = eigenmodes(self, number_of_modes)
        order = np.argsort(frequencies)
        translations, rotations = translations[:, :, order], rotations[:, :, order]
        # Pynite gives massless freedoms a small mass, so its modes are orthonormal to 1e-6 only.
        overlap = np.einsum("n,nia,nib->ab", masses, translations, translations)
        values, vectors = np.linalg.eigh(overlap)
        normalize = (vectors / np.sqrt(values)) @ vectors.T
        normalize = normalize * upward_signs(translations[nodes[-1]] @ normalize)
        translations = np.round(translations @ normalize, _DECIMALS) + 0.0
        rotations = np.round(rotations @ normalize, _DECIMALS) + 0.0
        return TrussModes(
            positions=positions,
            masses=masses,
            shapes=translations,
            frequencies=np.round(frequencies[order], _DECIMALS),
            damping_ratios=np.zeros(number_of_modes),
            grasp_positions=points,
            grasp_translations=translations[nodes],
            grasp_rotations=rotations[nodes],
            source="trussflow.models.truss.truss_fe, frame analysis by Pynite",
        )


def reconstructed_modes(number_of_modes: int = 6) -> TrussModes:
    """Return the paper's truss: shapes of the frame, with printed frequencies and grasp points.

    Parameters
    ----------
    number_of_modes : int
        Number of modes. The paper prints six frequencies; the others are those of the frame [-].

    Returns
    -------
    TrussModes

    Raises
    ------
    ModelError
        If the mesh has fewer modes.
    """
    return with_printed_frequencies(TrussFrame.reconstructed().modes(number_of_modes, printed_grasps()))


def printed_grasps() -> Vector:
    """Return the grasp points of the paper's Table 2, shape (4, 3) [m]."""
    return ParameterTable.shipped("space_truss.toml").table("modes").array("grasp_points", "m", (None, 3))


def printed_frequencies() -> Vector:
    """Return the natural frequencies of the paper's Table 1, shape (6,) [Hz]."""
    return ParameterTable.shipped("space_truss.toml").table("modes").array("frequencies", "Hz", (None,))


def with_printed_frequencies(modes: TrussModes) -> TrussModes:
    """Return modes of a frame with its lowest frequencies replaced by the paper's.

    Parameters
    ----------
    modes : TrussModes
        Modes by `TrussFrame.modes`; frequencies beyond the printed ones are kept.
    """
    printed = printed_frequencies()[: modes.modes]
    frequencies = np.concatenate([printed, modes.frequencies[len(printed) :]])
    source = (
        "Mode shapes: trussflow.models.truss.truss_fe (reconstructed frame, Pynite). Mass, the "
        "first six frequencies, grasp points: Li, Wei, Chen (2026), Actuators 15(2), 108, Tables 1, 2."
    )
    return replace(modes, frequencies=frequencies, source=source)


def main(arguments: Sequence[str] | None = None) -> None:
    """Compute the modes of the truss and write the data file.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command-line arguments; by default those of the process.
    """
    parser = argparse.ArgumentParser(
        prog="python -m trussflow.models.truss.truss_fe",
        description="Compute the modes of the reconstructed space truss and write them to a file.",
    )
    parser.add_argument("--modes", type=int, default=6, help="number of modes (default: %(default)s)")
    parser.add_argument(
        "--output", type=Path, default=Path("truss_modes.json"), help="file to write (default: %(default)s)"
    )
    options = parser.parse_args(arguments)
    modes = reconstructed_modes(options.modes)
    modes.save(options.output)
    frequencies = ", ".join(f"{f:.4f}" for f in modes.frequencies)
    sys.stdout.write(f"{options.output}: {modes.mass:.4f} kg; {frequencies} Hz\n")


if __name__ == "__main__":
    main()

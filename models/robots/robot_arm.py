"""Space robot as a chain of rigid bodies: hand, links, base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.geometry.rotation import fixed_rotation
from trussflow.models.geometry.spatial import SpatialInertia, combined, moved_inertia
from trussflow.models.parameter_files import ParameterTable, shipped_file
from trussflow.models.robots.joint import Joint
from trussflow.models.robots.urdf_chain import chain
from trussflow.models.robots.visuals import Visual
from trussflow.models.validation import (
    check_body,
    check_rotation,
    frozen_array,
    set_fields,
)

_SHAPES: dict[str, tuple[int | str, ...]] = {
    "hand_rotation": (3, 3),
    "joint_origins": ("joints", 3),
    "joint_rotations": ("joints", 3, 3),
    "masses": ("bodies",),
    "static_moments": ("bodies", 3),
    "inertias": ("bodies", 3, 3),
    "base_origin": (3,),
    "base_rotation": (3, 3),
    "base_centroid": (3,),
    "base_inertia": (3, 3),
    "rest_angles": ("joints",),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotArm:
    r"""Geometry and masses of one robot, from the truss outward.

    The hand :math:`B_{i,0}` is fixed to the truss at its grasp point. Link :math:`B_{i,j}`,
    j = 1..n, rotates about the z axis of its frame :math:`O_{i,j}` at joint :math:`C_{i,j}`,
    or slides along it. The base :math:`B_i` is fixed to the last link, which may be massless.
    Without joints hand and base are one body, such as a thruster module bolted to the truss.
    `dataclasses.replace` makes a changed copy, with all checks.

    Attributes
    ----------
    name : str
        Name for messages.
    hand_rotation : array, shape (3, 3)
        Rotation from :math:`O_{i,0}` to the axes of the undeformed truss [1].
    joint_origins : array, shape (n, 3)
        :math:`r_{O_{i,j},i,j-1}`: joint j in the frame of body j - 1 [m].
    joint_rotations : array, shape (n, 3, 3)
        Rotations from :math:`O_{i,j}` to :math:`O_{i,j-1}` at joint coordinate zero [1].
    masses : array, shape (n + 1,)
        Masses of hand and links [kg].
    static_moments : array, shape (n + 1, 3)
        Mass times centre of mass, in the frame of each body [kg·m].
    inertias : array, shape (n + 1, 3, 3)
        Inertias about the origin of each body's frame, in its axes [kg·m²].
    base_origin : array, shape (3,)
        :math:`r_{O_i,i,n}`: origin of the base frame in the frame of the last link [m].
    base_rotation : array, shape (3, 3)
        Rotation from base frame :math:`O_i` to the frame of the last link [1].
    base_centroid : array, shape (3,)
        :math:`r_{O_{ci},i}`: centroid of the base in :math:`O_i` [m].
    base_mass : float
        Mass of the base [kg].
    base_inertia : array, shape (3, 3)
        Inertia of the base about its centroid, in the axes of :math:`O_i` [kg·m²].
    rest_angles : array, shape (n,)
        Joint coordinates of the initial posture [rad; m of sliding joints].
    joint_data : tuple of Joint
        Kinds, names, limits and drive inertias of the joints; by default revolute without limits or drives.
    visuals : tuple of Visual
        Shapes of the bodies for pictures. Without them, a picture has lines between the joints and a box.
    bodies : tuple of SpatialInertia
        Derived: inertias of hand and links; that of the last link includes the base.
    base_position : array, shape (3,)
        Derived: centroid of the base in the frame of the last link [m].

    Raises
    ------
    ModelError
        If a shape is wrong, a number is not finite, or an inertia is physically impossible.

    References
    ----------
    Li, Wei, Chen (2026), section 2.2 and Tables 1 and 2.
    """

    name: str
    hand_rotation: Vector
    joint_origins: Vector
    joint_rotations: Vector
    masses: Vector
    static_moments: Vector
    inertias: Vector
    base_origin: Vector
    base_rotation: Vector
    base_centroid: Vector
    base_mass: float
    base_inertia: Vector
    rest_angles: Vector
    joint_data: tuple[Joint, ...] = ()
    visuals: tuple[Visual, ...] = ()
    bodies: tuple[SpatialInertia, ...] = field(init=False, repr=False)
    base_position: Vector = field(init=False, repr=False)

    def __post_init__(self) -> None:
        owner = f"robot arm {self.name!r}"
        joints = len(self.joint_origins)
        sizes = {"joints": joints, "bodies": joints + 1}
        for name, shape in _SHAPES.items():
            numbers = tuple(sizes[n] if isinstance(n, str) else n for n in shape)
            array = frozen_array(f"{owner}: {name}", getattr(self, name), numbers)
            set_fields(self, **{name: array})
        base_mass = float(frozen_array(f"{owner}: base_mass", self.base_mass, ()))
        known = tuple(self.joint_data) or tuple(
            Joint(f"joint_{j + 1}") for j in range(joints)
        )
        set_fields(self, base_mass=base_mass, joint_data=known)
        self._check(owner)
        # About the centroid of the base the static moment is zero.
        base = SpatialInertia(base_mass, np.zeros(3), self.base_inertia)
        position = self.base_origin + self.base_rotation @ self.base_centroid
        links = [
            SpatialInertia(float(m), s, j)
            for m, s, j in zip(
                self.masses, self.static_moments, self.inertias, strict=True
            )
        ]
        # The base is fixed to the last link, so that both are one body of the
        # recursion.
        links[-1] = combined(
            links[-1], moved_inertia(base, self.base_rotation, position)
        )
        set_fields(self, bodies=tuple(links), base_position=position)

    def _check(self, owner: str) -> None:
        check_rotation(owner, "hand_rotation", self.hand_rotation)
        check_rotation(owner, "base_rotation", self.base_rotation)
        for j, rotation in enumerate(self.joint_rotations):
            check_rotation(owner, f"joint_rotations[{j}]", rotation)
        if len({joint.name for joint in self.joint_data}) != self.joints:
            raise ModelError(
                f"{owner}: joint_data must name each of {self.joints} joints once, got "
                f"{', '.join(joint.name for joint in self.joint_data)}"
            )
        for joint in self.joint_data:
            joint.check(owner)
        for j in range(self.joints + 1):
            # The last link may be massless, since it is one body with the base.
            if j == self.joints and not (
                self.masses[j] or self.static_moments[j].any() or self.inertias[j].any()
            ):
                continue
            name = f"link {j}" if j else "link 0 (the hand)"
            check_body(
                owner, name, self.masses[j], self.static_moments[j], self.inertias[j]
            )
        check_body(owner, "the base", self.base_mass, np.zeros(3), self.base_inertia)

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.joint_origins)

    @property
    def sliding(self) -> tuple[bool, ...]:
        """Whether each joint slides."""
        return tuple(joint.sliding for joint in self.joint_data)

    @property
    def drive_inertias(self) -> tuple[float, ...]:
        """Reflected inertia of the drive of each joint [kg·m²; kg of sliding joints]."""
        return tuple(joint.inertia for joint in self.joint_data)

    @property
    def mass(self) -> float:
        """Mass of the whole robot [kg]."""
        return float(np.sum(self.masses)) + self.base_mass

    def same_as(self, other: RobotArm) -> bool:
        """Return whether another arm has the same dynamics; name, rest posture and visuals may differ.

        Parameters
        ----------
        other : RobotArm
            Arm to compare.

        Returns
        -------
        bool
        """
        names = {*_SHAPES, "base_mass", "sliding", "drive_inertias"} - {"rest_angles"}
        return all(np.array_equal(getattr(self, n), getattr(other, n)) for n in names)

    @classmethod
    def literal(cls) -> RobotArm:
        """Return the robot of the paper's Table 2, with all numbers as printed."""
        return cls.from_file(shipped_file("robot_arm_literal.toml"))

    @classmethod
    def jaco(cls) -> RobotArm:
        """Return the Kinova JACO2, which Table 2 describes, with its true inertias."""
        return cls.from_file(shipped_file("robot_arm_jaco.toml"))

    @classmethod
    def from_file(cls, path: str | Path) -> RobotArm:
        """Read a robot from a parameter file, such as the two shipped ones.

        Parameters
        ----------
        path : str or pathlib.Path
            TOML file with the tables ``hand``, ``[[links]]``, ``base`` and ``posture``.

        Returns
        -------
        RobotArm

        Raises
        ------
        ModelError
            If the file cannot be read, or a value is missing, of wrong shape, or physically impossible.
        """
        file = ParameterTable.read(path)
        hand, links, base = file.table("hand"), file.tables("links"), file.table("base")
        bodies = [_body(table) for table in (hand, *links)]
        return cls(
            name=file.text("name"),
            hand_rotation=_rotation(hand),
            joint_origins=np.reshape(
                [table.array("origin", "m", (3,)) for table in links], (-1, 3)
            ),
            joint_rotations=np.reshape(
                [_rotation(table) for table in links], (-1, 3, 3)
            ),
            masses=np.array([body.mass for body in bodies]),
            static_moments=np.array([body.static_moment for body in bodies]),
            inertias=np.array([body.inertia for body in bodies]),
            base_origin=base.array("origin", "m", (3,)),
            base_rotation=_rotation(base),
            base_centroid=base.array("centroid", "m", (3,)),
            base_mass=base.scalar("mass", "kg"),
            base_inertia=np.diag(base.array("inertia_about_centroid", "kg*m^2", (3,))),
            rest_angles=file.table("posture").array(
                "rest_angles", "rad", (len(links),)
            ),
        )

    @classmethod
    def from_urdf(
        cls,
        path: str | Path,
        *,
        hand: str,
        base: str,
        locked: Mapping[str, float | str] | None = None,
    ) -> RobotArm:
        """Read a robot from a URDF file: the chain from the grasping link to the free-floating base.

        The chain may run in either direction of the file's tree; joint coordinates keep their sign.
        Links fixed to a link belong to its body.

        Parameters
        ----------
        path : str or pathlib.Path
            URDF file with expanded macros.
        hand : str
            Link fixed to the truss; the origin of its frame is the grasp point.
        base : str
            Link of the base with its thrusters. If it has no inertia, all links fixed to it form the base.
        locked : mapping of str to float or str, optional
            Coordinates of locked joints, as a number [rad or m] or as text with a unit. All joints outside
            the chain, such as those of fingers, must be locked.

        Returns
        -------
        RobotArm
            Robot with the joint names and limits of the file. The axes of the hand are those of the truss.
            The rest coordinate of a joint is zero, or the limit nearest to zero.

        Raises
        ------
        ModelError
            If the file cannot be read or is not valid URDF, or the chain is not one of rigid bodies. The
            message names the line.

        Notes
        -----
        Shapes of links are kept for pictures: boxes, cylinders, spheres, and meshes in STL or OBJ files.
        Colours, collisions, transmissions and friction are ignored. A joint without `limit` is unlimited.
        """
        return cls(hand_rotation=np.eye(3), **chain(path, hand, base, locked or {}))


def _rotation(table: ParameterTable) -> Vector:
    """Return the fixed rotation of a table, which has three angles."""
    return fixed_rotation(table.array("rotation", "rad", (3,)))


def _body(table: ParameterTable) -> SpatialInertia:
    """Return the inertia of a link about its frame origin, from that or from the central inertia."""
    mass = table.scalar("mass", "kg")
    centre = table.array("centre_of_mass", "m", (3,))
    if "inertia_about_origin" in table:
        inertia = np.diag(table.array("inertia_about_origin", "kg*m^2", (3,)))
        return SpatialInertia(mass, mass * centre, inertia)
    central = np.diag(table.array("inertia_about_centre_of_mass", "kg*m^2", (3,)))
    return moved_inertia(SpatialInertia(mass, np.zeros(3), central), np.eye(3), centre)

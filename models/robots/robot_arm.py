"""A space robot as a chain of rigid bodies: hand, links, base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from trussflow.blocks.framework.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.geometry.rotation import fixed_rotation
from trussflow.models.geometry.spatial import SpatialInertia, combined, moved_inertia
from trussflow.models.parameter_files import ParameterTable, shipped_file
from trussflow.models.robots.joint import Joint
from trussflow.models.robots.urdf_chain import chain
from trussflow.models.robots.urdf_writing import urdf_text
from trussflow.models.robots.visuals import Visual
from trussflow.models.validation import check_body, check_rotation, frozen_array

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

    The hand :math:`B_{i,0}` is fixed to the truss at its grasp point. Each link
    :math:`B_{i,j}`, j = 1..n, turns about the z axis of its frame :math:`O_{i,j}`, which sits
    at joint :math:`C_{i,j}`, or slides along it. The base :math:`B_i` is fixed to the last link,
    which may have no mass of its own. Without joints hand and base are one body, such as a thruster
    module that is bolted on. Change a value with `dataclasses.replace`, which checks everything again.

    Attributes
    ----------
    name : str
        For messages.
    hand_rotation : array, shape (3, 3)
        :math:`O_{i,0}` to the truss axes, truss undeformed [1].
    joint_origins : array, shape (n, 3)
        :math:`r_{O_{i,j},i,j-1}`: joint j in the frame of body j - 1 [m].
    joint_rotations : array, shape (n, 3, 3)
        :math:`O_{i,j}` to :math:`O_{i,j-1}` at joint angle (or travel) zero [1].
    masses : array, shape (n + 1,)
        Of hand and links [kg].
    static_moments : array, shape (n + 1, 3)
        Mass times centre of mass, in each body's own frame [kg·m].
    inertias : array, shape (n + 1, 3, 3)
        About each body's own frame origin, in its axes [kg·m²].
    base_origin : array, shape (3,)
        :math:`r_{O_i,i,n}`: origin of the base frame in the last link's frame [m].
    base_rotation : array, shape (3, 3)
        Base frame :math:`O_i` to the last link's frame [1].
    base_centroid : array, shape (3,)
        :math:`r_{O_{ci},i}`: centroid of the base in :math:`O_i` [m].
    base_mass : float
        [kg].
    base_inertia : array, shape (3, 3)
        About the centroid, in the axes of :math:`O_i` [kg·m²].
    rest_angles : array, shape (n,)
        Joint angles of the posture the robot starts in [rad; m where joints slide].
    joint_data : tuple of Joint
        Kinds, names and limits of the joints; by default they turn, without limits.
    visuals : tuple of Visual
        What its bodies look like in pictures; without, a picture has lines between the joints and a box.
    bodies : tuple of SpatialInertia
        Derived: hand and links, the base counted with the last link.
    base_position : array, shape (3,)
        Derived: centroid of the base in the last link's frame [m].

    Raises
    ------
    ModelError
        If a shape is wrong, a number is not finite, or a body is not physically possible.

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
            object.__setattr__(self, name, frozen_array(f"{owner}: {name}", getattr(self, name), numbers))
        base_mass = float(frozen_array(f"{owner}: base_mass", self.base_mass, ()))
        object.__setattr__(self, "base_mass", base_mass)
        known = tuple(self.joint_data) or tuple(Joint(f"joint_{j + 1}") for j in range(joints))
        object.__setattr__(self, "joint_data", known)
        self._check(owner)
        base = SpatialInertia(base_mass, np.zeros(3), self.base_inertia)
        position = self.base_origin + self.base_rotation @ self.base_centroid
        links = [
            SpatialInertia(float(m), s, j)
            for m, s, j in zip(self.masses, self.static_moments, self.inertias, strict=True)
        ]
        links[-1] = combined(links[-1], moved_inertia(base, self.base_rotation, position))
        object.__setattr__(self, "bodies", tuple(links))
        object.__setattr__(self, "base_position", position)

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
            # The last link is one body with the base, and may be no more than a frame.
            if j == self.joints and not (
                self.masses[j] or self.static_moments[j].any() or self.inertias[j].any()
            ):
                continue
            name = f"link {j}" if j else "link 0 (the hand)"
            check_body(owner, name, self.masses[j], self.static_moments[j], self.inertias[j])
        check_body(owner, "the base", self.base_mass, np.zeros(3), self.base_inertia)

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.joint_origins)

    @property
    def sliding(self) -> tuple[bool, ...]:
        """Which joints slide."""
        return tuple(joint.sliding for joint in self.joint_data)

    @property
    def mass(self) -> float:
        """Mass of the whole robot [kg]."""
        return float(np.sum(self.masses)) + self.base_mass

    def same_as(self, other: RobotArm) -> bool:
        """Tell whether another arm has the same numbers, whatever its name, rest posture and looks.

        Parameters
        ----------
        other : RobotArm
            The arm to compare with.

        Returns
        -------
        bool
        """
        names = {*_SHAPES, "base_mass", "sliding"} - {"rest_angles"}
        return all(np.array_equal(getattr(self, n), getattr(other, n)) for n in names)

    @classmethod
    def literal(cls) -> RobotArm:
        """Return the robot of the paper's Table 2, every printed number taken as it stands."""
        return cls.from_file(shipped_file("robot_arm_literal.toml"))

    @classmethod
    def jaco(cls) -> RobotArm:
        """Return the real arm behind Table 2, the Kinova JACO2, with its true inertias."""
        return cls.from_file(shipped_file("robot_arm_jaco.toml"))

    @classmethod
    def from_file(cls, path: str | Path) -> RobotArm:
        """Read a robot from a parameter file; the two shipped files show the layout.

        Parameters
        ----------
        path : str or pathlib.Path
            A file with the tables ``hand``, ``[[links]]``, ``base`` and ``posture``.

        Returns
        -------
        RobotArm

        Raises
        ------
        ModelError
            If the file cannot be read, or a value is missing, misshapen or not physical.
        """
        file = ParameterTable.read(path)
        hand, links, base = file.table("hand"), file.tables("links"), file.table("base")
        bodies = [_body(table) for table in (hand, *links)]
        return cls(
            name=file.text("name"),
            hand_rotation=_rotation(hand),
            joint_origins=np.reshape([table.array("origin", "m", (3,)) for table in links], (-1, 3)),
            joint_rotations=np.reshape([_rotation(table) for table in links], (-1, 3, 3)),
            masses=np.array([body.mass for body in bodies]),
            static_moments=np.array([body.static_moment for body in bodies]),
            inertias=np.array([body.inertia for body in bodies]),
            base_origin=base.array("origin", "m", (3,)),
            base_rotation=_rotation(base),
            base_centroid=base.array("centroid", "m", (3,)),
            base_mass=base.scalar("mass", "kg"),
            base_inertia=np.diag(base.array("inertia_about_centroid", "kg*m^2", (3,))),
            rest_angles=file.table("posture").array("rest_angles", "rad", (len(links),)),
        )

    @classmethod
    def from_urdf(
        cls,
        path: str | Path,
        *,
        hand: str,
        base: str,
        hand_rotation: Vector | None = None,
        locked: Mapping[str, float | str] | None = None,
    ) -> RobotArm:
        """Read a robot from a URDF file: the chain from the link that grasps to the one that flies freely.

        Links may be named in either order of the file's tree: where the chain runs against it,
        the coordinates of the joints keep their sign. What is fixed to a link belongs to its body.

        Parameters
        ----------
        path : str or pathlib.Path
            The file, with macros expanded.
        hand : str
            Link that is fixed to the truss; the origin of its frame is at the grasp point.
        base : str
            Link that is the base with its thrusters. Without inertia, the base is all that is fixed to it.
        hand_rotation : array, shape (3, 3), optional
            Frame of the hand to the truss axes [1]; the identity by default.
        locked : mapping of str to float or str, optional
            Joints that are held, and where, as a number [rad or m] or as text with a unit: those beside the
            chain, such as fingers, must be.

        Returns
        -------
        RobotArm
            Its joints are `joint_data`, with the file's names, limits and efforts. Each rests at zero, or at
            the limit that is nearest to zero.

        Raises
        ------
        ModelError
            If the file cannot be read, says what no robot is, or the chain is none of rigid bodies; the
            message says where.

        Notes
        -----
        Shapes of links are kept for pictures: boxes, cylinders, spheres, and meshes in STL or OBJ files.
        Colours, collisions, transmissions and friction are not read. A joint without `limit` has none.
        """
        return cls(
            hand_rotation=np.eye(3) if hand_rotation is None else hand_rotation,
            **chain(path, hand, base, locked or {}),
        )

    def to_urdf(self) -> str:
        """Return the robot as URDF, from link ``hand`` over ``link_1`` to ``base``.

        How it grasps and rests is not part of a URDF: `hand_rotation` and `rest_angles` are left out. So are
        `visuals`.
        """
        return urdf_text(self)


def _rotation(table: ParameterTable) -> Vector:
    """Return the fixed rotation a table gives as three angles."""
    return fixed_rotation(table.array("rotation", "rad", (3,)))


def _body(table: ParameterTable) -> SpatialInertia:
    """Return a link's inertia about its frame origin, from whichever of the two is given."""
    mass = table.scalar("mass", "kg")
    centre = table.array("centre_of_mass", "m", (3,))
    if "inertia_about_origin" in table:
        inertia = np.diag(table.array("inertia_about_origin", "kg*m^2", (3,)))
        return SpatialInertia(mass, mass * centre, inertia)
    central = np.diag(table.array("inertia_about_centre_of_mass", "kg*m^2", (3,)))
    return moved_inertia(SpatialInertia(mass, np.zeros(3), central), np.eye(3), centre)

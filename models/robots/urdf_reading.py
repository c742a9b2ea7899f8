"""Reading of URDF files into links and joints, each with its line in the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from math import inf
from pathlib import Path
from sys import float_info
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from trussflow.blocks.support.files import reading
from trussflow.blocks.support.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.geometry.rotation import fixed_rotation
from trussflow.models.geometry.spatial import SpatialInertia, moved_inertia
from trussflow.models.robots.joint import Joint
from trussflow.models.validation import check_body

JOINT_KINDS = ("revolute", "continuous", "prismatic", "fixed")

# Tolerance of the length of an axis from 1, since files have axes of three digits.
_AXIS_SLACK = 1e-3


class Pose(NamedTuple):
    """Pose of a child frame in a parent frame.

    Attributes
    ----------
    rotation : array, shape (3, 3)
        Rotation from child to parent axes [1].
    position : array, shape (3,)
        Origin of the child frame [m].
    """

    rotation: Vector
    position: Vector

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(
            self.rotation @ other.rotation,
            self.position + self.rotation @ other.position,
        )

    def inverse(self) -> Pose:
        """Return the pose of the parent frame in the child frame."""
        return Pose(self.rotation.T, -self.rotation.T @ self.position)


@dataclass(frozen=True, slots=True)
class Element:
    """XML element of the file.

    Attributes
    ----------
    tag : str
        Name of the element.
    attributes : dict
        Attributes as text.
    place : str
        File and line, for messages.
    children : list of Element
        Child elements.
    """

    tag: str
    attributes: dict[str, str]
    place: str
    children: list[Element]

    def refused(self, why: str) -> ModelError:
        """Return an error with the place and the reason `why`."""
        return ModelError(f"{self.place}, {self.title}: {why}")

    @property
    def title(self) -> str:
        """Name of the element in messages."""
        return (
            f"{self.tag} {self.attributes['name']!r}"
            if "name" in self.attributes
            else f"<{self.tag}>"
        )

    def find(self, tag: str) -> Element | None:
        """Return the child with that `tag`, or None; two of them raise `ModelError`."""
        found = [child for child in self.children if child.tag == tag]
        if len(found) > 1:
            raise found[1].refused(f"{self.title} has two <{tag}>; remove one")
        return found[0] if found else None

    def child(self, tag: str) -> Element:
        """Return the child with that `tag`, which must exist."""
        found = self.find(tag)
        if found is None:
            raise self.refused(f"<{tag}> is missing")
        return found

    def text(self, name: str) -> str:
        """Return the attribute `name`, which must exist."""
        if name not in self.attributes:
            raise self.refused(f"attribute {name!r} is missing")
        return self.attributes[name]

    def numbers(
        self, name: str, count: int, default: Sequence[float] | None = None
    ) -> Vector:
        """Return an attribute as `count` finite numbers [any].

        Parameters
        ----------
        name : str
            Name of the attribute.
        count : int
            Required number of numbers [-].
        default : sequence of float, optional
            Value of a missing attribute [any].

        Raises
        ------
        ModelError
            If the attribute is missing or has another value.
        """
        if default is not None and name not in self.attributes:
            return np.array(default)
        text = self.text(name)
        try:
            numbers = np.array([float(word) for word in text.split()])
        except ValueError:
            # Words that are no numbers get the message of nan and infinity below.
            numbers = np.full(count, np.nan)
        if numbers.shape != (count,) or not np.isfinite(numbers).all():
            raise self.refused(
                f"{name} is {text!r}; it must be {count} finite number{'s' * (count > 1)}"
            )
        return numbers

    def number(self, name: str) -> float:
        """Return an attribute as one finite number [any]; it must exist.

        Parameters
        ----------
        name : str
            Name of the attribute.
        """
        return float(self.numbers(name, 1)[0])

    def origin(self) -> Pose:
        """Return the pose in the child ``origin``; by default the identity."""
        found = self.find("origin")
        if found is None:
            return Pose(np.eye(3), np.zeros(3))
        # Roll, pitch and yaw about fixed axes are the inverse of the opposite rotations about moving axes.
        turns = found.numbers("rpy", 3, (0.0, 0.0, 0.0))
        return Pose(fixed_rotation(-turns).T, found.numbers("xyz", 3, (0.0, 0.0, 0.0)))


class UrdfJoint(NamedTuple):
    """Joint between two links of a URDF file.

    Attributes
    ----------
    data : Joint
        Kind, name and limits.
    movable : bool
        Whether the joint is not a fixed one.
    parent, child : str
        Names of the two links.
    placement : Pose
        Pose of the child's frame in the parent's, at coordinate zero.
    axis : array, shape (3,)
        Axis in the frame of the child [1].
    element : Element
        Element of the file.
    """

    data: Joint
    movable: bool
    parent: str
    child: str
    placement: Pose
    axis: Vector
    element: Element


class UrdfTree(NamedTuple):
    """Tree of links and joints of a URDF file.

    Attributes
    ----------
    robot : Element
        Root element of the file.
    links : dict of str to Element
        Links, keyed by name.
    bodies : dict of str to SpatialInertia
        Inertias of the links with mass, in their own frames.
    joints : dict of str to UrdfJoint
        Joints, keyed by the name of the child link.
    """

    robot: Element
    links: dict[str, Element]
    bodies: dict[str, SpatialInertia]
    joints: dict[str, UrdfJoint]


def read_urdf(path: str | Path) -> UrdfTree:
    """Read a URDF file.

    Parameters
    ----------
    path : str or pathlib.Path
        URDF file.

    Raises
    ------
    ModelError
        If the file cannot be read, or does not describe a tree of physically possible rigid bodies.
    """
    robot = _parsed(Path(path))
    if robot.tag != "robot":
        raise robot.refused("the root element of a URDF file must be <robot>")
    for child in robot.children:
        if child.tag.startswith("xacro:"):
            raise child.refused(
                "macros are not expanded; run xacro first, and read its output"
            )
    links = _named(robot, "link")
    bodies = {
        name: body for name, link in links.items() if (body := _body(link)) is not None
    }
    joints: dict[str, UrdfJoint] = {}
    for element in _named(robot, "joint").values():
        joint = _joint(element)
        for end in (joint.parent, joint.child):
            if end not in links:
                raise element.refused(
                    f"link {end!r} does not exist; there are: {', '.join(links)}"
                )
        if joint.child in joints:
            other = joints[joint.child].element
            raise element.refused(
                f"its child {joint.child!r} is also the child of {other.title} ({other.place}); remove one, "
                "since a robot must be a tree"
            )
        joints[joint.child] = joint
    # The root has no joint above it; a second root is an unconnected part. A cycle has
    # no root, hence the check after this one.
    roots = [name for name in links if name not in joints]
    if len(roots) > 1:
        raise links[roots[1]].refused(
            f"no joints connect it to {roots[0]!r}; all links must be one tree"
        )
    try:
        TopologicalSorter({name: [j.parent] for name, j in joints.items()}).prepare()
    except CycleError as error:
        link = next(name for name in joints if name in error.args[1])
        raise joints[link].element.refused(
            f"it closes a cycle: link {link!r} is its own ancestor"
        ) from None
    return UrdfTree(robot, links, bodies, joints)


def _parsed(path: Path) -> Element:
    """Return the root element of an XML file."""
    # Unlike ElementTree, expat gives line numbers, which the messages contain.
    parser = expat.ParserCreate()
    # Stack of open elements; the first one is a parent for the root element.
    opened = [Element("", {}, path.name, [])]

    def enter(tag: str, attributes: dict[str, str]) -> None:
        place = f"{path.name}, line {parser.CurrentLineNumber}"
        opened.append(Element(tag, attributes, place, []))
        opened[-2].children.append(opened[-1])

    def refuse(*_: object) -> None:
        # Entities, which can expand a few lines to gigabytes, need such a declaration.
        raise ModelError(
            f"refused to read {path.name}: it declares a document type, which URDF does not use"
        )

    parser.StartElementHandler = enter
    parser.EndElementHandler = lambda _: opened.pop()
    parser.StartDoctypeDeclHandler = refuse
    with reading(path, ModelError, "cannot read robot", "it is not XML ({})") as file:
        parser.Parse(file.read_bytes(), True)
    return opened[0].children[0]


def _named(robot: Element, tag: str) -> dict[str, Element]:
    """Return the children with that tag, keyed by their unique names."""
    found: dict[str, Element] = {}
    for child in robot.children:
        if child.tag == tag:
            name = child.text("name")
            if name in found:
                raise child.refused(
                    f"the name is already used ({found[name].place}); rename it"
                )
            found[name] = child
    return found


def _body(link: Element) -> SpatialInertia | None:
    """Return the inertia of a link in its own frame, or None without mass."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    frame, given = inertial.origin(), inertial.child("inertia")
    mass = inertial.child("mass").number("value")
    xx, xy, xz, yy, yz, zz = (
        given.number(f"i{axes}") for axes in ("xx", "xy", "xz", "yy", "yz", "zz")
    )
    central = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # An <inertial> of zeros means a frame without a body, as does no <inertial>.
    if mass == 0.0 and not central.any():
        return None
    check_body(
        inertial.place,
        f"link {link.text('name')!r}",
        mass,
        np.zeros(3),
        central,
        thin=True,
    )
    return moved_inertia(SpatialInertia(mass, np.zeros(3), central), *frame)


def _joint(element: Element) -> UrdfJoint:
    """Return a joint."""
    kind = element.text("type")
    if kind not in JOINT_KINDS:
        raise element.refused(
            f"joint type {kind!r} is not supported; the types are {', '.join(JOINT_KINDS)}"
        )
    axis = np.array([0.0, 0.0, 1.0])
    if kind != "fixed":
        found = element.find("axis")
        # The default axis of URDF is x; internally joints use z.
        axis = np.array([1.0, 0.0, 0.0]) if found is None else found.numbers("xyz", 3)
        length = np.linalg.norm(axis)
        if abs(length - 1.0) > _AXIS_SLACK:
            raise element.refused(
                f"its axis has length {length:g}; it must be a unit vector"
            )
        axis = axis / length
    limit = element.find("limit")
    limits: dict[str, float] = {}
    if limit is not None and kind != "fixed":
        limits = {
            "effort": _limit(limit, "effort", inf),
            "speed": _limit(limit, "velocity", inf),
        }
        # URDF ignores these limits for continuous joints; elsewhere their default is 0.
        if kind != "continuous":
            limits |= {end: _limit(limit, end, 0.0) for end in ("lower", "upper")}
    data = Joint(element.text("name"), kind == "prismatic", **limits)
    data.check(element.place)
    parent, child = (element.child(end).text("link") for end in ("parent", "child"))
    return UrdfJoint(
        data, kind != "fixed", parent, child, element.origin(), axis, element
    )


def _limit(limit: Element, name: str, default: float) -> float:
    """Return a limit; URDF has no infinity, which the largest number represents."""
    if name not in limit.attributes:
        return default
    value = limit.number(name)
    return value if abs(value) < float_info.max else float(np.copysign(inf, value))

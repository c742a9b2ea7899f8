"""A URDF file as links and joints, each with its place in the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from sys import float_info
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from trussflow.blocks.framework.files import reading
from trussflow.blocks.framework.types import Vector
from trussflow.models.errors import ModelError
from trussflow.models.geometry.rotation import fixed_rotation
from trussflow.models.geometry.spatial import SpatialInertia, moved_inertia
from trussflow.models.robots.joint import Joint
from trussflow.models.validation import check_body

KINDS = ("revolute", "continuous", "prismatic", "fixed")

# How far from 1 the length of an axis may be: files have axes of three digits.
_AXIS_SLACK = 1e-3


class Pose(NamedTuple):
    """One frame in another.

    Attributes
    ----------
    rotation : array, shape (3, 3)
        Axes of the one in those of the other [1].
    position : array, shape (3,)
        Its origin [m].
    """

    rotation: Vector
    position: Vector

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.rotation @ other.rotation, self.position + self.rotation @ other.position)

    def inverse(self) -> Pose:
        """Return the other frame in this one."""
        return Pose(self.rotation.T, -self.rotation.T @ self.position)


@dataclass(frozen=True, slots=True)
class Element:
    """An element of the file.

    Attributes
    ----------
    tag : str
        Its name.
    attributes : dict
        As written.
    place : str
        File and line, for messages.
    children : list of Element
        What is in it.
    """

    tag: str
    attributes: dict[str, str]
    place: str
    children: list[Element]

    def refused(self, why: str) -> ModelError:
        """Return the error that says where and `why`."""
        return ModelError(f"{self.place}, {self.title}: {why}")

    @property
    def title(self) -> str:
        """What it is called in messages."""
        return f"{self.tag} {self.attributes['name']!r}" if "name" in self.attributes else f"<{self.tag}>"

    def find(self, tag: str) -> Element | None:
        """Return the one child of that `tag`, if there is one; two are refused."""
        found = [child for child in self.children if child.tag == tag]
        if len(found) > 1:
            raise found[1].refused(f"a second <{tag}> of the same {self.title}; remove one")
        return found[0] if found else None

    def child(self, tag: str) -> Element:
        """Return the one child of that `tag`, which must be there."""
        found = self.find(tag)
        if found is None:
            raise self.refused(f"<{tag}> is missing")
        return found

    def text(self, name: str) -> str:
        """Return the attribute `name`, which must be there."""
        if name not in self.attributes:
            raise self.refused(f"attribute {name!r} is missing")
        return self.attributes[name]

    def numbers(self, name: str, count: int, default: Sequence[float] | None = None) -> Vector:
        """Return an attribute as `count` finite numbers [any].

        Parameters
        ----------
        name : str
            Of the attribute.
        count : int
            How many it must be [-].
        default : sequence of float, optional
            What it is if it is missing [any].

        Raises
        ------
        ModelError
            If it is missing, or something else.
        """
        if default is not None and name not in self.attributes:
            return np.array(default)
        text = self.text(name)
        try:
            numbers = np.array([float(word) for word in text.split()])
        except ValueError:
            numbers = np.full(count, np.nan)
        if numbers.shape != (count,) or not np.isfinite(numbers).all():
            raise self.refused(f"{name} is {text!r}; it must be {count} finite number{'s' * (count > 1)}")
        return numbers

    def number(self, name: str) -> float:
        """Return an attribute as one finite number [any], which must be there.

        Parameters
        ----------
        name : str
            Of the attribute.
        """
        return float(self.numbers(name, 1)[0])

    def origin(self) -> Pose:
        """Return the frame that its child ``origin`` describes; without one, its own."""
        found = self.find("origin")
        if found is None:
            return Pose(np.eye(3), np.zeros(3))
        # Roll, pitch and yaw about fixed axes are the inverse of the opposite turns about moving ones.
        turns = found.numbers("rpy", 3, (0.0, 0.0, 0.0))
        return Pose(fixed_rotation(-turns).T, found.numbers("xyz", 3, (0.0, 0.0, 0.0)))


class UrdfJoint(NamedTuple):
    """What joins two links.

    Attributes
    ----------
    data : Joint
        Kind, name and limits.
    movable : bool
        False if the file says that it is fixed.
    parent, child : str
        The links.
    placement : Pose
        Frame of the child in the parent's, at coordinate zero.
    axis : array, shape (3,)
        In the child's frame [1].
    element : Element
        Its place.
    """

    data: Joint
    movable: bool
    parent: str
    child: str
    placement: Pose
    axis: Vector
    element: Element


class UrdfTree(NamedTuple):
    """All of a file: one tree.

    Attributes
    ----------
    robot : Element
        The root of the file.
    links : dict of str to Element
        By name.
    bodies : dict of str to SpatialInertia
        About and in the frames of those links that have mass.
    joints : dict of str to UrdfJoint
        By the name of the link that is the child.
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
        The file.

    Raises
    ------
    ModelError
        If it cannot be read, or what it says is no tree of possible rigid bodies.
    """
    robot = _parsed(Path(path))
    if robot.tag != "robot":
        raise robot.refused("a URDF file has <robot> at its root")
    for child in robot.children:
        if child.tag.startswith("xacro:"):
            raise child.refused("macros are not expanded; run xacro first, and read what it writes")
    links = _named(robot, "link")
    bodies = {name: body for name, link in links.items() if (body := _body(link)) is not None}
    joints: dict[str, UrdfJoint] = {}
    for element in _named(robot, "joint").values():
        joint = _joint(element)
        for end in (joint.parent, joint.child):
            if end not in links:
                raise element.refused(f"there is no link {end!r}; there are: {', '.join(links)}")
        if joint.child in joints:
            other = joints[joint.child].element
            raise element.refused(
                f"its child {joint.child!r} is the child of {other.title} too ({other.place}); a loop must "
                "be cut open, for robots here are trees"
            )
        joints[joint.child] = joint
    roots = [name for name in links if name not in joints]
    if len(roots) > 1:
        raise links[roots[1]].refused(f"no joints join it to {roots[0]!r}; all links must be one tree")
    rooted = set(roots)  # links known to hang on the root: each joint is followed once
    for name in links:
        above, seen = name, set[str]()
        while above not in rooted:
            if above in seen:
                raise joints[above].element.refused(f"it closes a cycle: link {above!r} hangs on itself")
            seen.add(above)
            above = joints[above].parent
        rooted |= seen
    return UrdfTree(robot, links, bodies, joints)


def _parsed(path: Path) -> Element:
    """Return the root of an XML file."""
    parser = expat.ParserCreate()
    opened = [Element("", {}, path.name, [])]

    def enter(tag: str, attributes: dict[str, str]) -> None:
        place = f"{path.name}, line {parser.CurrentLineNumber}"
        opened.append(Element(tag, attributes, place, []))
        opened[-2].children.append(opened[-1])

    def refuse(*_: object) -> None:
        # Entities, with which a few lines grow to gigabytes, need such a declaration.
        raise ModelError(f"refused to read {path.name}: it declares a document type, which URDF does not use")

    parser.StartElementHandler = enter
    parser.EndElementHandler = lambda _: opened.pop()
    parser.StartDoctypeDeclHandler = refuse
    with reading(path, ModelError, "cannot read robot", "it is not XML ({})") as file:
        parser.Parse(file.read_bytes(), True)
    return opened[0].children[0]


def _named(robot: Element, tag: str) -> dict[str, Element]:
    """Return the children of that tag by name, which no two may share."""
    found: dict[str, Element] = {}
    for child in robot.children:
        if child.tag == tag:
            name = child.text("name")
            if name in found:
                raise child.refused(f"there is one of that name already ({found[name].place}); rename it")
            found[name] = child
    return found


def _body(link: Element) -> SpatialInertia | None:
    """Return a link's mass and inertia about and in its frame, None if it has none."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    frame, given = inertial.origin(), inertial.child("inertia")
    mass = inertial.child("mass").number("value")
    xx, xy, xz, yy, yz, zz = (given.number(f"i{axes}") for axes in ("xx", "xy", "xz", "yy", "yz", "zz"))
    central = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if mass == 0.0 and not central.any():
        return None
    check_body(inertial.place, f"link {link.text('name')!r}", mass, np.zeros(3), central, thin=True)
    return moved_inertia(SpatialInertia(mass, np.zeros(3), central), *frame)


def _joint(element: Element) -> UrdfJoint:
    """Return a joint."""
    kind = element.text("type")
    if kind not in KINDS:
        raise element.refused(f"joints of type {kind!r} cannot be used; a chain has {', '.join(KINDS)} ones")
    axis = np.array([0.0, 0.0, 1.0])
    if kind != "fixed":
        found = element.find("axis")
        axis = np.array([1.0, 0.0, 0.0]) if found is None else found.numbers("xyz", 3)
        length = np.linalg.norm(axis)
        if abs(length - 1.0) > _AXIS_SLACK:
            raise element.refused(f"its axis has length {length:g}; it must be a unit vector")
        axis = axis / length
    limit = element.find("limit")
    limits: dict[str, float] = {}
    if limit is not None and kind != "fixed":
        limits = {"effort": _limit(limit, "effort", inf), "speed": _limit(limit, "velocity", inf)}
        if kind != "continuous":
            limits |= {end: _limit(limit, end, 0.0) for end in ("lower", "upper")}
    data = Joint(element.text("name"), kind == "prismatic", **limits)
    data.check(element.place)
    parent, child = (element.child(end).text("link") for end in ("parent", "child"))
    return UrdfJoint(data, kind != "fixed", parent, child, element.origin(), axis, element)


def _limit(limit: Element, name: str, default: float) -> float:
    """Return a limit; URDF has no infinity, and the largest number stands for it."""
    if name not in limit.attributes:
        return default
    value = limit.number(name)
    return value if abs(value) < float_info.max else float(np.copysign(inf, value))

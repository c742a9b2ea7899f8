"""Chain of rigid bodies between two links of a URDF file, as arguments of `RobotArm`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.models.geometry.rotation import rotation_about_z
from trussflow.models.geometry.spatial import SpatialInertia, combined, moved_inertia
from trussflow.models.parameter_files import ParameterTable
from trussflow.models.robots.urdf_reading import Pose, UrdfJoint, UrdfTree, read_urdf
from trussflow.models.robots.visuals import Visual, visuals_of
from trussflow.models.validation import central_inertia, check_choice, frozen_array

_NOTHING = SpatialInertia(0.0, np.zeros(3), np.zeros((3, 3)))


def chain(
    path: str | Path, hand: str, base: str, locked: Mapping[str, float | str]
) -> dict[str, Any]:
    """Return the arguments of `RobotArm` except the orientation of its hand.

    Parameters
    ----------
    path : str or pathlib.Path
        URDF file.
    hand, base : str
        Links at the ends of the chain.
    locked : mapping of str to float or str
        Coordinates of locked joints: numbers [rad or m], or text with a unit.

    Raises
    ------
    ModelError
        If a link or joint does not exist, a joint outside the chain is movable, or a body has no mass.
    """
    tree = read_urdf(path)
    file, folder = Path(path).name, Path(path).resolve().parent
    for end in (hand, base):
        check_choice(f"link in {file}", end, tree.links)
    movable = {
        joint.data.name: joint.data for joint in tree.joints.values() if joint.movable
    }
    given, places_of = ParameterTable(locked, f"{file}, locked"), {}
    for name, value in locked.items():
        check_choice(f"movable joint in {file}", name, movable)
        if isinstance(value, str):
            places_of[name] = given.scalar(name, movable[name].unit)
        else:
            places_of[name] = float(
                frozen_array(f"{file}: locked joint {name!r}", value, ())
            )
    touching: dict[str, list[UrdfJoint]] = {name: [] for name in tree.links}
    for joint in tree.joints.values():
        touching[joint.parent].append(joint)
        touching[joint.child].append(joint)
    # Joints above both ends cancel; the others are the path between hand and base.
    on_chain = set(_above(tree, hand)) ^ set(_above(tree, base))

    # Outward from the hand, link by link; `pose` is the frame of the link in that of its body.
    bodies, places, crossed = [_NOTHING], [hand], []
    steps: list[Pose] = []
    loose: list[UrdfJoint] = []
    visuals: list[Visual] = []
    mount, own = Pose(np.eye(3), np.zeros(3)), _NOTHING
    todo = [(hand, "", mount, 0)]
    while todo:
        link, came_from, pose, body = todo.pop()
        inertia = tree.bodies.get(link, _NOTHING)
        visuals += visuals_of(tree.links[link], folder, body, pose)
        if link == base:
            mount, own = pose, inertia
        else:
            bodies[body] = combined(bodies[body], moved_inertia(inertia, *pose))
        for joint in touching[link]:
            outward = joint.parent == link
            beyond = joint.child if outward else joint.parent
            if beyond == came_from:
                continue
            before, after = _sides(joint, outward)
            if not joint.movable or joint.data.name in locked:
                held = _moved(joint, places_of.get(joint.data.name, 0.0))
                todo.append((beyond, link, pose @ before @ held @ after, body))
            elif joint.child in on_chain:
                _refuse_mimic(joint)
                steps.append(pose @ before)
                crossed.append(joint.data)
                bodies.append(_NOTHING)
                places.append(beyond)
                todo.append((beyond, link, after, len(bodies) - 1))
            else:
                loose.append(joint)
                # to list all movable joints behind it
                todo.append((beyond, link, pose, body))
    if loose:
        named = ", ".join(f"{joint.data.name!r}: 0.0" for joint in loose)
        raise loose[0].element.refused(
            f"it is movable but outside the chain from {hand!r} to {base!r}; lock it and the "
            f"joints behind it: locked={{{named}}}"
        )
    if not own.mass:
        # The base link is a frame only: the links fixed to it become the base, about
        # it.
        back = mount.inverse()
        own, bodies[-1] = moved_inertia(bodies[-1], *back), _NOTHING
    # The last link may be empty, since it is one body with the base.
    for name, one in zip(places, [*bodies[:-1], own], strict=True):
        if not one.mass:
            raise tree.links[name].refused(
                "neither it nor a link fixed to it has an <inertial>; add one"
            )
    return {
        "name": tree.robot.attributes.get("name", file),
        "joint_origins": np.reshape([step.position for step in steps], (-1, 3)),
        "joint_rotations": np.reshape([step.rotation for step in steps], (-1, 3, 3)),
        "masses": np.array([one.mass for one in bodies]),
        "static_moments": np.array([one.static_moment for one in bodies]),
        "inertias": np.array([one.inertia for one in bodies]),
        "base_origin": mount.position,
        "base_rotation": mount.rotation,
        "base_centroid": own.static_moment / own.mass,
        "base_mass": own.mass,
        "base_inertia": central_inertia(*own),
        "rest_angles": np.array(
            [np.clip(0.0, joint.lower, joint.upper) for joint in crossed]
        ),
        "joint_data": tuple(crossed),
        "visuals": tuple(visuals),
    }


def _above(tree: UrdfTree, link: str) -> Iterator[str]:
    """Yield a link and its ancestors except the root; each link identifies the joint to its parent."""
    while link in tree.joints:
        yield link
        link = tree.joints[link].parent


def _sides(joint: UrdfJoint, outward: bool) -> tuple[Pose, Pose]:
    """Return the joint frame, with z along its axis, in the previous link, and the next link in it.

    Against the direction of the file the parent moves about the opposite axis, so that the coordinate
    keeps its sign.
    """
    here = Pose(_along(joint.axis if outward else -joint.axis), np.zeros(3))
    if outward:
        return joint.placement @ here, here.inverse()
    return here, here.inverse() @ joint.placement.inverse()


def _along(axis: Vector) -> Vector:
    """Return a rotation whose z axis is the given unit vector; the identity for z itself."""
    # An axis of coordinates that is not parallel to `axis`: x for z itself.
    x = np.eye(3)[(np.argmax(np.abs(axis)) + 1) % 3]
    x = x - (x @ axis) * axis
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _moved(joint: UrdfJoint, value: float) -> Pose:
    """Return the pose of a joint coordinate in the frame of the joint."""
    if joint.data.sliding:
        return Pose(np.eye(3), np.array([0.0, 0.0, value]))
    return Pose(rotation_about_z(value), np.zeros(3))


def _refuse_mimic(joint: UrdfJoint) -> None:
    mimic = joint.element.find("mimic")
    if mimic is not None:
        raise mimic.refused(
            f"{joint.element.title} mimics another joint, which is not supported; lock it"
        )

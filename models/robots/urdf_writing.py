"""Writing of a robot as URDF text."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.support.types import Array, Vector
from trussflow.models.geometry.rotation import roll_pitch_yaw
from trussflow.models.robots.joint import Joint
from trussflow.models.validation import central_inertia

if TYPE_CHECKING:
    from trussflow.models.robots.robot_arm import RobotArm


def urdf_text(arm: RobotArm) -> str:
    """Return a robot as URDF text.

    Parameters
    ----------
    arm : RobotArm
        Robot to write.
    """
    names = ["hand", *(f"link_{j + 1}" for j in range(arm.joints)), "base"]
    lines = ['<?xml version="1.0"?>', f"<robot name={_quoted(arm.name)}>"]
    for name, mass, moment, inertia in zip(
        names[:-1], arm.masses, arm.static_moments, arm.inertias, strict=True
    ):
        centre = moment / mass if mass else moment
        lines += _link(
            name,
            mass,
            centre,
            central_inertia(mass, moment, inertia) if mass else inertia,
        )
    lines += _link("base", arm.base_mass, arm.base_centroid, arm.base_inertia)
    origins, rotations = (
        [*arm.joint_origins, arm.base_origin],
        [*arm.joint_rotations, arm.base_rotation],
    )
    for j, joint in enumerate([*arm.joint_data, None]):
        lines += _joint(joint, names[j : j + 2], origins[j], rotations[j])
    return "\n".join([*lines, "</robot>", ""])


def _link(name: str, mass: float, centre: Vector, inertia: Vector) -> list[str]:
    moments = {
        f"i{'xyz'[i]}{'xyz'[k]}": inertia[i, k] for i in range(3) for k in range(i, 3)
    }
    return [
        f'  <link name="{name}">',
        "    <inertial>",
        f"      <origin {_numeric_attributes(xyz=centre)}/>",
        f"      <mass {_numeric_attributes(value=mass)}/>",
        f"      <inertia {_numeric_attributes(**moments)}/>",
        "    </inertial>",
        "  </link>",
    ]


def _joint(
    joint: Joint | None, ends: list[str], origin: Vector, rotation: Vector
) -> list[str]:
    """Return the lines of a joint; None is the fixed joint of the base."""
    kind, name = "fixed", "base_mount"
    body = [
        f'    <parent link="{ends[0]}"/>',
        f'    <child link="{ends[1]}"/>',
        f"    <origin {_numeric_attributes(xyz=origin, rpy=roll_pitch_yaw(rotation))}/>",
    ]
    if joint is not None:
        name, limits = joint.name, np.array(joint[2:])
        kind = (
            "prismatic"
            if joint.sliding
            else "revolute"
            if np.isfinite(limits[:2]).any()
            else "continuous"
        )
        body.append('    <axis xyz="0 0 1"/>')
        if kind == "prismatic" or np.isfinite(limits).any():
            # URDF has no infinity; the largest number represents it.
            lower, upper, effort, speed = np.nan_to_num(limits)
            ends_of_way = (
                {} if kind == "continuous" else {"lower": lower, "upper": upper}
            )
            body.append(
                f"    <limit {_numeric_attributes(**ends_of_way, effort=effort, velocity=speed)}/>"
            )
    return [f'  <joint name={_quoted(name)} type="{kind}">', *body, "  </joint>"]


def _numeric_attributes(**values: Array) -> str:
    """Return numbers as XML attributes, to the last digit."""
    return " ".join(
        f'{name}="{" ".join(repr(float(value) + 0.0) for value in np.ravel(numbers))}"'
        for name, numbers in values.items()
    )


def _quoted(name: str) -> str:
    """Return a name as the value of an XML attribute."""
    from xml.sax.saxutils import quoteattr  # slow to import: it imports urllib

    return quoteattr(name)

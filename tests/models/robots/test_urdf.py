"""Robots from URDF files: reading, errors, and writing."""

import re
import sys

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near

from trussflow.models import (
    Joint,
    ModelError,
    RobotArm,
    SpaceTruss,
    TrussDynamics,
    arm_terms,
)

ROUND_OFF = 1e-13  # of numbers of order 1

INERTIAL = """<inertial><origin xyz="0.1 0 0"/><mass value="2"/>
  <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"""
ARM = f"""<?xml version="1.0"?>
<robot name="two">
  <link name="body">{INERTIAL}</link>
  <link name="upper">{INERTIAL}</link>
  <link name="lower">{INERTIAL}</link>
  <link name="tool"/>
  <link name="finger">{INERTIAL}</link>
  <joint name="shoulder" type="revolute">
    <parent link="body"/><child link="upper"/><origin xyz="0 0 1" rpy="0 0 0.5"/>
    <axis xyz="0 1 0"/><limit lower="0.2" upper="2" effort="5" velocity="3"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="upper"/><child link="lower"/><axis xyz="0 0 -1"/>
    <limit lower="-1" upper="1" effort="7" velocity="0.1"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="lower"/><child link="tool"/><origin xyz="0 0 0.3"/>
  </joint>
  <joint name="grip" type="continuous"><parent link="tool"/><child link="finger"/></joint>
</robot>
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    return path


def read(path, **changed):
    return RobotArm.from_urdf(
        path, **{"hand": "tool", "base": "body", "locked": {"grip": 0.3}, **changed}
    )


def test_names_limits_and_kinds_are_those_of_the_file(file):
    """From the hand, so against the order of the file; a joint rests at zero, or as near as it can."""
    arm = read(file)
    assert arm.joint_data == (
        Joint("slide", sliding=True, lower=-1.0, upper=1.0, effort=7.0, speed=0.1),
        Joint("shoulder", lower=0.2, upper=2.0, effort=5.0, speed=3.0),
    )
    assert_array_equal(arm.rest_angles, [0.0, 0.2])
    assert (arm.name, arm.mass, arm.base_mass) == ("two", 8.0, 2.0)
    assert_array_equal(arm.masses, [4.0, 2.0, 0.0])  # the finger is held by the hand
    shorter = read(file, base="upper", locked={"grip": 0.3, "shoulder": 1.0})
    # the body is held beside the base
    assert_array_equal(shorter.masses, [4.0, 2.0])
    assert shorter.joint_data == arm.joint_data[:1]


def test_coordinates_keep_their_sign_against_the_direction_of_the_file(file):
    """Place of the base in the hand's frame is the inverse of that of the hand in the base's."""
    there, back = read(file), read(file, hand="body", base="tool")
    still, angles = np.zeros(6), np.array([0.4, 0.7])
    one = arm_terms(there, angles, 0.0 * angles, np.eye(3), np.zeros(3), still, still)
    other = arm_terms(
        back, angles[::-1], 0.0 * angles, np.eye(3), np.zeros(3), still, still
    )
    # Centroids of body and tool, less where they are in the frames of these links.
    origin = one.base_position - one.base_rotation @ there.base_centroid
    assert_near(one.base_rotation, other.base_rotation.T, ROUND_OFF)
    returned = other.base_position - other.base_rotation @ back.base_centroid
    assert_near(returned, -other.base_rotation @ origin, ROUND_OFF)


def test_units_follow_the_kinds_of_the_joints(file, modes):
    arms = (
        read(file),
        RobotArm.literal(),
        read(file, hand="lower", base="lower", locked=LOCKED),
        read(file),
    )
    truss = SpaceTruss(TrussDynamics(modes=modes, arms=arms, elastic_integrals=True))
    assert truss.task_units[6:] == ("m", *("rad",) * 8, "m", "rad")
    assert truss.actuator_units[24:] == ("N", *("N*m",) * 8, "N", "N*m")
    assert truss.joints == 11


LOCKED = {"grip": 0.0, "slide": 0.0, "shoulder": 1.0}

ERROR_CASES = {
    "it is not XML": ("</robot>", ""),
    "declares a document type": ("<robot", "<!DOCTYPE x><robot"),
    "line 2, <sdf>: the root element of a URDF file must be <robot>": (
        ('<robot name="two">', "</robot>"),
        ("<sdf>", "</sdf>"),
    ),
    "line 3, xacro:macro 'a': macros are not expanded": (
        '<link name="body">',
        '<xacro:macro name="a"/><link name="body">',
    ),
    "line 7, link 'upper': the name is already used (arm.urdf, line 5)": (
        '"lower">',
        '"upper">',
    ),
    "joint 'slide': link 'arm' does not exist; there are: body, upper": (
        '<parent link="upper"/>',
        '<parent link="arm"/>',
    ),
    "is also the child of joint 'slide' (arm.urdf, line 16); remove one": (
        '<child link="finger"/>',
        '<child link="lower"/>',
    ),
    "it closes a cycle": ('<parent link="body"/>', '<parent link="finger"/>'),
    "link 'spare': no joints connect it to 'body'": (
        "</robot>",
        '<link name="spare"/></robot>',
    ),
    "line 12, joint 'shoulder': joint type 'floating' is not supported": (
        '"revolute"',
        '"floating"',
    ),
    "attribute 'type' is missing": ('type="fixed"', ""),
    "line 3, <mass>: value is 'two'": ('<mass value="2"/>', '<mass value="two"/>'),
    "mass of link 'body' is -2.0 kg; it must be positive": (
        '<mass value="2"/>',
        '<mass value="-2"/>',
    ),
    "<inertial>: <mass> is missing": ('<mass value="2"/>', ""),
    "no rigid body has the inertia of link 'body'": ('izz="1"', 'izz="3"'),
    "line 3, link 'body': neither it nor a link fixed to it has an <inertial>": (
        INERTIAL,
        "",
    ),
    "ixx is 'nan'; it must be 1 finite number": ('ixx="1"', 'ixx="nan"'),
    "<origin>: xyz is '0.1 0'; it must be 3 finite numbers": (
        'xyz="0.1 0 0"',
        'xyz="0.1 0"',
    ),
    "rpy is '0 0 ${pi}'": ('rpy="0 0 0.5"', 'rpy="0 0 ${pi}"'),
    "link 'body' has two <inertial>": (INERTIAL, INERTIAL + INERTIAL),
    "joint 'shoulder': its axis has length 2; it must be a unit vector": (
        'xyz="0 1 0"',
        'xyz="0 2 0"',
    ),
    "joint 'shoulder': <parent> is missing": ('<parent link="body"/>', ""),
    "the upper limit must not be below the lower one": ('lower="0.2"', 'lower="3"'),
    "effort is 'much'": ('effort="5"', 'effort="much"'),
    "and effort and speed must not be negative": ('velocity="3"', 'velocity="-3"'),
    "joint 'shoulder' mimics another joint": (
        '<axis xyz="0 1 0"/>',
        '<mimic joint="grip"/><axis xyz="0 1 0"/>',
    ),
}


@pytest.mark.parametrize("message, change", ERROR_CASES.items(), ids=ERROR_CASES)
def test_errors_of_files(file, message, change):
    old, new = ((each,) if isinstance(each, str) else each for each in change)
    text = ARM
    for before, after in zip(old, new, strict=True):
        assert before in text
        text = text.replace(before, after, 1)
    file.write_text(text)
    with pytest.raises(ModelError, match=re.escape(message)) as refused:
        read(file)
    assert "arm.urdf" in str(refused.value)


def test_each_link_of_a_chain_takes_the_same_number_of_lines(tmp_path):
    """The number of executed lines of the reader is linear in the number of links."""
    path, lines = tmp_path / "chain.urdf", []

    def trace(frame, event, _):
        lines[-1] += event == "line"
        return trace if "urdf" in frame.f_code.co_filename else None

    for count in (20, 40, 60):
        links = (f'<link name="l{k}">{INERTIAL}</link>' for k in range(count))
        joints = (
            f'<joint name="j{k}" type="fixed"><parent link="l{k}"/><child link="l{k + 1}"/></joint>'
            for k in range(count - 1)
        )
        path.write_text(f"<robot>{''.join([*links, *joints])}</robot>")
        lines.append(0)
        usual = sys.gettrace()
        sys.settrace(trace)
        try:
            RobotArm.from_urdf(path, hand="l0", base=f"l{count - 1}")
        finally:
            sys.settrace(usual)
    assert lines[2] - lines[1] == lines[1] - lines[0] > 0


@pytest.mark.campaign
def test_every_wrong_attribute_is_read_or_raises_a_model_error(file):
    """Most values that are no number and no name raise the error."""
    errors = 0
    values = list(re.finditer(r'"([^"]*)"', ARM))
    for value in values:
        for junk in ("", "nan", "1e308", "x", "1 2", "\u0663", "&#0;", "base"):
            file.write_text(
                ARM[: value.start(1)] + junk + ARM[value.end(1) :], encoding="utf-8"
            )
            try:
                read(file)
            except ModelError:
                errors += 1
    assert errors > 6 * len(values)


@pytest.mark.parametrize(
    "changed, message",
    [
        (
            {"hand": "gripper"},
            r"no link in arm.urdf 'gripper'; choose from: body, upper",
        ),
        (
            {"locked": {"flange": 0.0}},
            r"no movable joint in arm.urdf 'flange'; choose from: shoulder",
        ),
        ({"locked": {"grip": np.nan}}, r"locked joint 'grip' is not finite"),
        ({"path": "none.urdf"}, r"cannot read robot 'none.urdf': No such file"),
    ],
)
def test_errors_of_arguments(file, changed, message):
    with pytest.raises(ModelError, match=message):
        read(**{"path": file, **changed})


def test_joints_beside_the_chain_must_be_held(file):
    """The error names them all, ready to be pasted: also those that hang on others."""
    with pytest.raises(
        ModelError, match=r"joint 'grip': it is movable but outside the chain"
    ):
        read(file, locked=None)
    named = re.escape("locked={'shoulder': 0.0, 'slide': 0.0, 'grip': 0.0}")
    with pytest.raises(ModelError, match=named):
        read(file, hand="body", base="body", locked={})


def test_a_mount_without_joints_has_all_the_mass(file):
    arm = read(file, hand="lower", base="tool", locked=LOCKED)
    assert (arm.joints, arm.mass, arm.base_mass) == (0, 8.0, 8.0)

"""Shapes and meshes of URDF files as triangles."""

import struct

import numpy as np
import pytest

from trussflow.models import ModelError, RobotArm
from trussflow.models.robots.visuals import BOX_CORNERS, BOX_FACES

INERTIAL = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
TWO = f"""<robot name="two">
  <link name="body">{INERTIAL}
    <visual><origin xyz="0 0 0.5" rpy="0.1 0.2 0.3"/><geometry>GEOMETRY</geometry></visual>
  </link>
  <link name="tool">{INERTIAL}</link>
  <joint name="wrist" type="revolute">
    <parent link="body"/><child link="tool"/><origin xyz="0 0.2 1" rpy="0 0 0.5"/><axis xyz="0 1 0"/>
  </joint>
</robot>"""


def volume(triangles):
    """Return what a closed surface encloses, by Gauss; negative if its triangles look inward."""
    a, b, c = np.moveaxis(triangles[0][triangles[1]], 1, 0)
    return np.sum(a * np.cross(b, c)) / 6.0


def arm_with(folder, geometry):
    path = folder / "two.urdf"
    path.write_text(TWO.replace("GEOMETRY", geometry), encoding="utf-8")
    return RobotArm.from_urdf(path, hand="tool", base="body")


@pytest.mark.parametrize(
    "geometry, expected, share",
    [
        ('<box size="1 2 3"/>', 6.0, 1.0),
        # A prism of 16 sides in place of the cylinder; of the sphere, 8 rings of them.
        (
            '<cylinder radius="0.5" length="2"/>',
            np.pi / 2.0,
            16.0 * np.sin(np.pi / 8.0) / (2.0 * np.pi),
        ),
        ('<sphere radius="0.5"/>', np.pi / 6.0, 0.937),
    ],
)
def test_shapes_have_their_volume(tmp_path, geometry, expected, share):
    (visual,) = arm_with(tmp_path, geometry).visuals
    assert volume(visual.triangles()) == pytest.approx(expected * share, rel=2e-3)
    assert visual.body == 1


def corners(size):
    """Return the three corners of each triangle of a box."""
    return (BOX_CORNERS * size)[BOX_FACES]


def stl(triangles):
    facets = [struct.pack("<12fH", 0, 0, 0, *facet.ravel(), 0) for facet in triangles]
    return b"binary".ljust(80) + struct.pack("<I", len(facets)) + b"".join(facets)


def stl_text(triangles):
    lines = ["solid box"]
    for facet in triangles:
        lines += ["facet normal 0 0 0", " outer loop"]
        lines += [f"  vertex {x:.9g} {y:.9g} {z:.9g}" for x, y, z in facet]
        lines += [" endloop", "endfacet"]
    return "\n".join([*lines, "endsolid box"]).encode()


def obj(triangles):
    """Return a box of quadrilaterals: with textures, and the last ones counted back from the end."""
    points = BOX_CORNERS * np.ptp(triangles.reshape(-1, 3), axis=0)
    lines = ["# box", *(f"v {x} {y} {z}" for x, y, z in points), "vt 0 0"]
    lines += [
        "f 1/1 2/1 4/1 3/1",
        "f 5 7 8 6",
        "f 1 5 6 2",
        "f -6 -5 -1 -2",
        "f 1//1 3//1 7//1 5//1",
        "f 2 6 8 4",
    ]
    return "\n".join(lines).encode()


@pytest.mark.parametrize(
    "name, write", [("box.stl", stl), ("BOX.STL", stl_text), ("box.obj", obj)]
)
def test_meshes_of_both_locations(tmp_path, name, write):
    """Beside the URDF file, or in a package around it; scaled from millimetres."""
    size = np.array([100.0, 200.0, 300.0])
    places = {name: name, f"meshes/{name}": f"package://some_robot/meshes/{name}"}
    for place, reference in places.items():
        folder = tmp_path / "some_robot" / "urdf"
        folder.mkdir(parents=True, exist_ok=True)
        path = (folder if place == name else folder.parent) / place
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(write(corners(size)))
        geometry = f'<mesh filename="{reference}" scale="0.001 0.001 0.001"/>'
        (visual,) = arm_with(folder, geometry).visuals
        assert abs(volume(visual.triangles())) == pytest.approx(6e-3, rel=1e-6)
        path.unlink()


ERROR_CASES = [
    ('<mesh filename="arm.dae"/>', "arm.dae, which is none of .stl, .obj"),
    ('<mesh filename="package://nowhere/arm.stl"/>', "arm.stl, which cannot be read: "),
    (f'<mesh filename="{"a" * 300}.stl"/>', f"{'a' * 300}.stl, which cannot be read: "),
    (
        f'<mesh filename="package://x/{"a" * 300}.stl"/>',
        f"{'a' * 300}.stl, which cannot be read: ",
    ),
    ('<mesh filename="broken.stl"/>', "broken.stl, which cannot be read: "),
    ('<mesh filename="broken.obj"/>', "broken.obj, which cannot be read: "),
    ('<capsule radius="1" length="2"/>', "a capsule, which is no shape of URDF"),
]


@pytest.mark.parametrize("geometry, message", ERROR_CASES)
def test_errors_of_shapes(tmp_path, geometry, message):
    """The arm is read all the same, as its equations need no picture."""
    for name, content in (
        ("broken.stl", b"solid nothing"),
        ("broken.obj", b"v 0 0 0\nf 1 2 3"),
    ):
        (tmp_path / name).write_bytes(content)
    arm = arm_with(tmp_path, geometry)
    with pytest.raises(ModelError) as raised:
        arm.visuals[0].triangles()
    assert str(raised.value).startswith(message)


def test_error_of_a_shape_without_size(tmp_path):
    with pytest.raises(
        ModelError, match=r"two.urdf, line 3, <box>: attribute 'size' is missing"
    ):
        arm_with(tmp_path, "<box/>")

"""Chains of URDF files against a second library: Pinocchio, on the same files.

Pinocchio has the root of the file fly freely, we have the hand do so: the motions of root and joints become
those of hand and joints by Pinocchio's own Jacobian of the hand's frame.
"""

import ast
import re
from importlib.metadata import files
from pathlib import Path

import numpy as np
import pytest
from systems import assert_near, relative_error

from trussflow.models import ModelError, RobotArm, arm_terms
from trussflow.models.geometry.rotation import rotation_about_z
from trussflow.models.geometry.spatial import SpatialInertia, inertia_matrix
from trussflow.models.robots.visuals import BOX_CORNERS

pin = pytest.importorskip("pinocchio", reason="Pinocchio has no wheels for Windows")

TOLERANCE = 1e-12  # of the largest element

# Package, file, hand, base, number of joints: in the direction of the file, against it, and across.
PUBLIC = [
    ("airo-models", "ur3e.urdf", "tool0", "base_link", 6),
    ("airo-models", "ur5e.urdf", "base_link_inertia", "tool0", 6),
    ("gym-ignition-models", "panda.urdf", "panda_hand", "panda_link0", 7),
    ("gym-ignition-models", "panda.urdf", "panda_leftfinger", "panda_link0", 8),
    ("gym-ignition-models", "panda.urdf", "panda_leftfinger", "panda_rightfinger", 2),
    ("gym-ignition-models", "cartpole.urdf", "pole", "rail", 2),
    ("gym-ignition-models", "pendulum.urdf", "pendulum", "support", 1),
    ("gym-ignition-models", "iCubGazeboV2_5/icub.urdf", "l_hand", "root_link", 10),
    ("gym-ignition-models", "iCubGazeboV2_5/icub.urdf", "l_foot", "r_foot", 12),
    ("airo-models", "table8080.urdf", "table_centre", "base_link", 0),
]


def public_file(package, name):
    return next(
        Path(str(file.locate()))
        for file in files(package) or ()
        if str(file).endswith(name)
    )


def held(path, hand, base):
    """Return the joints beside the chain, as the error proposes them, each at an angle of its own."""
    try:
        RobotArm.from_urdf(path, hand=hand, base=base)
    except ModelError as error:
        proposed = re.search(r"locked=(\{.*\})", str(error))
        if proposed is None:
            raise
        return {
            name: 0.1 + 0.01 * k for k, name in enumerate(ast.literal_eval(proposed[1]))
        }
    return {}


def configuration(model, values):
    """Return Pinocchio's neutral configuration with the named joints moved."""
    q = pin.neutral(model)
    for name, value in values.items():
        joint = model.joints[model.getJointId(name)]
        # A continuous joint is a point on the unit circle.
        q[joint.idx_q : joint.idx_q + joint.nq] = (
            [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
        )
    return q


def names_of(arm):
    return [joint.name for joint in arm.joint_data]


def assert_equals_pinocchio(path, arm, hand, locked, rng):
    """Compare mass matrix and bias at a random state."""
    whole = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    ids = [whole.getJointId(name) for name in locked]
    model = pin.buildReducedModel(whole, ids, configuration(whole, locked))
    model.gravity = pin.Motion.Zero()
    data, n = model.createData(), arm.joints
    order = [model.joints[model.getJointId(name)].idx_v for name in names_of(arm)]
    assert sorted(order) == list(range(6, model.nv))
    angles, v = rng.uniform(-2.0, 2.0, n), rng.standard_normal(6 + n)
    q = configuration(model, dict(zip(names_of(arm), angles, strict=True)))
    mass = np.triu(pin.crba(model, data, q))
    mass = mass + np.triu(mass, 1).T
    bias = pin.nonLinearEffects(model, data, q, v)
    pin.forwardKinematics(model, data, q, v, np.zeros(6 + n))
    frame = model.getFrameId(hand, pin.FrameType.BODY)
    motion = np.asarray(pin.getFrameVelocity(model, data, frame, pin.LOCAL))
    drift = np.asarray(pin.getFrameAcceleration(model, data, frame, pin.LOCAL))
    T = np.concatenate(
        [
            pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL),
            np.eye(6 + n)[order],
        ]
    )
    terms = arm_terms(arm, angles, v[order], np.eye(3), np.zeros(3), motion, drift)
    root = inertia_matrix(SpatialInertia(arm.mass, terms.static_moment, terms.inertia))
    own = np.block(
        [[root, terms.root_coupling.T], [terms.root_coupling, terms.mass_matrix]]
    )
    forces = np.concatenate([terms.root_bias, terms.joint_bias])
    assert relative_error(T.T @ own @ T, mass) < TOLERANCE
    assert relative_error(T.T @ forces, bias) < TOLERANCE


@pytest.mark.parametrize("package, name, hand, base, joints", PUBLIC)
def test_public_robots_equal_pinocchio(package, name, hand, base, joints, rng):
    path = public_file(package, name)
    locked = held(path, hand, base)
    arm = RobotArm.from_urdf(path, hand=hand, base=base, locked=locked)
    assert arm.joints == joints
    assert_equals_pinocchio(path, arm, hand, locked, rng)


@pytest.mark.parametrize("package, name, hand, base, joints", [PUBLIC[1], PUBLIC[8]])
def test_visuals_of_public_robots_are_where_pinocchio_has_them(
    package, name, hand, base, joints, rng, monkeypatch
):
    """A box of one metre in place of each mesh, in the frame of the hand."""
    path = public_file(package, name)
    monkeypatch.chdir(path.parent)  # there Pinocchio finds "file://meshes"
    locked = held(path, hand, base)
    arm = RobotArm.from_urdf(path, hand=hand, base=base, locked=locked)
    model = pin.buildModelFromUrdf(str(path))
    shapes = pin.buildGeomFromUrdf(
        model, str(path), pin.GeometryType.VISUAL, package_dirs=[str(path.parent)]
    )
    angles = rng.uniform(-1.0, 1.0, joints)
    data = model.createData()
    values = dict(zip(names_of(arm), angles, strict=True)) | locked
    pin.framesForwardKinematics(model, data, configuration(model, values))
    theirs = {
        Path(s.meshPath).name: data.oMi[s.parentJoint] * s.placement
        for s in shapes.geometryObjects
    }
    bodies = [(np.eye(3), np.zeros(3))]
    for origin, rotation, angle in zip(
        arm.joint_origins, arm.joint_rotations, angles, strict=True
    ):
        axes, place = bodies[-1]
        bodies.append(
            (axes @ rotation @ rotation_about_z(angle), place + axes @ origin)
        )
    assert len(arm.visuals) > 5
    for visual in arm.visuals:
        axes, place = bodies[visual.body]
        ours = (
            visual._replace(kind="box", size=np.ones(3)).triangles()[0] @ axes.T + place
        )
        placed = data.oMf[model.getFrameId(hand)].actInv(theirs[visual.file.name])
        assert_near(ours, [placed.act(c) for c in BOX_CORNERS], TOLERANCE)


def random_urdf(rng, links):
    """Return a random tree: joints of all kinds, any axes, frames and inertias; some frames without mass."""

    def written(numbers):
        return " ".join(map(repr, numbers.tolist()))

    def origin():
        return f'<origin xyz="{written(rng.standard_normal(3))}" rpy="{written(rng.uniform(-3, 3, 3))}"/>'

    lines = ['<robot name="random">']
    for k in range(links):
        lines.append(f'<link name="L{k}">')
        if k == 0 or rng.random() < 0.9:
            points = rng.standard_normal((8, 3))
            points = points - points.mean(axis=0)
            J = np.sum(points**2) * np.eye(3) - points.T @ points
            elements = zip(
                ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
                J[np.triu_indices(3)],
                strict=True,
            )
            moments = " ".join(f'{name}="{value}"' for name, value in elements)
            lines.append(
                f'<inertial>{origin()}<mass value="8"/><inertia {moments}/></inertial>'
            )
        lines.append("</link>")
        if k:
            axis = rng.standard_normal(3)
            if rng.random() < 0.5:
                axis = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
            kind = rng.choice(["revolute", "continuous", "prismatic", "fixed"])
            lines.append(
                f'<joint name="J{k}" type="{kind}"><parent link="L{rng.integers(k)}"/><child link="L{k}"/>'
                f'{origin()}<axis xyz="{written(axis / np.linalg.norm(axis))}"/>'
                '<limit lower="-1" upper="2" effort="3" velocity="4"/></joint>'
            )
    return "\n".join([*lines, "</robot>"])


@pytest.mark.parametrize("seed", range(20))
def test_any_two_links_of_any_tree_equal_pinocchio(seed, tmp_path):
    rng = np.random.default_rng(seed)
    path, links = tmp_path / "random.urdf", rng.integers(1, 10)
    path.write_text(random_urdf(rng, links))
    hand, base = (f"L{rng.integers(links)}" for _ in range(2))
    try:
        locked = held(path, hand, base)
        arm = RobotArm.from_urdf(path, hand=hand, base=base, locked=locked)
    except ModelError as error:
        if "give it one" not in str(error):
            raise
        return
    assert_equals_pinocchio(path, arm, hand, locked, rng)

"""The arms: printed numbers, known geometry, and errors."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial.transform import Rotation
from systems import assert_near

from trussflow.models import Joint, ModelError, RobotArm, arm_terms, shipped_file

# Table 2, bodies B_i,0 to B_i,7: masses [kg] and diagonals of J [kg m²].
MASSES = [0.99, 0.463, 0.463, 0.6763, 0.8447, 0.8447, 0.7477, 0.4678]
INERTIAS = [
    [0.0102, 0.0102, 0.0006],
    [0.0018, 0.0018, 0.0001],
    [0.0016, 0.0004, 0.0012],
    [0.0122, 0.0111, 0.0014],
    [0.0114, 0.0025, 0.0093],
    [0.0112, 0.0091, 0.0025],
    [0.0041, 0.0015, 0.0031],
    [0.0014, 0.0014, 0.0004],
]
PRINTED_DIGIT = 1e-4  # kg m²; Table 2 has four decimals
LITERAL = RobotArm.literal()


def base_of(arm, angles):
    """Return place and orientation of the base's centroid relative to the grasp point."""
    still = np.zeros(6)
    terms = arm_terms(arm, angles, 0.0 * angles, np.eye(3), np.zeros(3), still, still)
    return terms.base_position, terms.base_rotation


def test_literal_arm_has_the_printed_numbers():
    assert_array_equal(LITERAL.masses, MASSES)
    assert_array_equal([np.diag(j) for j in LITERAL.inertias], INERTIAS)
    assert LITERAL.base_mass == 13.9
    assert_array_equal(np.diag(LITERAL.base_inertia), [0.8494, 0.4894, 1.194])
    assert LITERAL.mass == pytest.approx(19.3972, rel=1e-12)


def test_literal_arm_at_zero_angles_ends_where_table_2_leads():
    """Computed by hand from the eight rows: the base turned over, 0.33 m beside the grasp."""
    position, rotation = base_of(LITERAL, np.zeros(7))
    assert_near(position, [0.3264, 0.0, -0.272], 1e-12)
    assert_array_equal(rotation, [[0, 1, 0], [1, 0, 0], [0, 0, -1]])


@pytest.mark.parametrize("arm, rank", [(LITERAL, 3), (RobotArm.jaco(), 6)])
def test_rest_posture_is_singular_as_printed_and_regular_for_the_real_arm(arm, rank):
    still = np.zeros(6)
    terms = arm_terms(
        arm, arm.rest_angles, np.zeros(7), np.eye(3), np.zeros(3), still, still
    )
    assert np.linalg.matrix_rank(terms.screws, tol=1e-6) == rank


def test_data_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        LITERAL.masses[0] = 1.0


def test_arms_are_compared_by_their_numbers():
    assert LITERAL.same_as(replace(LITERAL, name="other", rest_angles=np.ones(7)))
    assert not LITERAL.same_as(RobotArm.jaco())
    assert not LITERAL.same_as(replace(LITERAL, base_mass=14.0))
    limited, slider = (Joint("a", upper=1.0), Joint("a", sliding=True))
    assert LITERAL.same_as(
        replace(LITERAL, joint_data=(limited, *LITERAL.joint_data[1:]))
    )
    assert not LITERAL.same_as(
        replace(LITERAL, joint_data=(slider, *LITERAL.joint_data[1:]))
    )


def changed(name, index, value):
    """Return a field of the arm with one element changed."""
    values = getattr(LITERAL, name).copy()
    values[index] = value
    return {name: values}


def massless(link):
    """Return the fields of the arm with a link that is only a frame."""
    names = ("masses", "static_moments", "inertias")
    return {
        name: values
        for part in names
        for name, values in changed(part, link, 0.0).items()
    }


def test_the_last_link_may_be_no_more_than_a_frame():
    """It is one body with the base."""
    assert replace(LITERAL, **massless(7)).bodies[7].mass == LITERAL.base_mass


SKEWED = np.diag([0.8494, 0.4894, 1.194]) + 0.1 * np.eye(3, k=1)
ERROR_CASES = [
    *((massless(7) | {name: getattr(LITERAL, name)}, "link 7") for name in massless(7)),
    (massless(6), r"mass of link 6 is 0.0 kg"),
    (changed("masses", 2, -0.463), r"robot arm 'literal': mass of link 2 is -0.463 kg"),
    ({"base_mass": 0.0}, r"mass of the base is 0.0 kg"),
    # An inertia about the centre given as if about the joint: the usual mistake.
    (
        changed("inertias", 5, 0.3 * LITERAL.inertias[5]),
        r"inertia of link 5 about its centre of mass is not positive definite.*kg",
    ),
    (
        {"base_inertia": np.diag([0.2, 0.4, 1.194])},
        r"no rigid body has the inertia of the base.*triangle",
    ),
    ({"base_inertia": SKEWED}, "inertia of the base is not symmetric"),
    ({"masses": np.ones(7)}, r"masses has shape \(7,\); it must be \(8,\)"),
    (
        {"joint_origins": np.zeros((0, 3))},
        r"joint_rotations has shape \(7, 3, 3\); it must be \(0, 3, 3\)",
    ),
    (
        changed("joint_origins", 3, np.nan),
        "robot arm 'literal': joint_origins is not finite",
    ),
    ({"masses": np.array(["heavy"] * 8)}, "masses must be numeric, not"),
    ({"hand_rotation": 2.0 * np.eye(3)}, r"hand_rotation is not a rotation matrix"),
    (
        changed("joint_rotations", 2, -LITERAL.joint_rotations[2]),
        r"joint_rotations\[2\] is not a rotation matrix",
    ),
    (
        {"joint_data": (Joint("a"), Joint("a"))},
        "joint_data must name each of 7 joints once, got a, a",
    ),
    (
        {"joint_data": (Joint("a", lower=1.0, upper=0.0), *LITERAL.joint_data[1:])},
        r"robot arm 'literal': joint 'a' has the limits 1 to 0 rad",
    ),
]


@pytest.mark.parametrize("values, message", ERROR_CASES)
def test_errors(values, message):
    with pytest.raises(ModelError, match=message):
        replace(LITERAL, **values)


def test_own_files_are_read(tmp_path):
    """A file with another mass gives another arm; the error for a file without a value names it."""
    text = shipped_file("robot_arm_literal.toml").read_text(encoding="utf-8")
    own = tmp_path / "own.toml"
    own.write_text(text.replace("value = 13.9,", "value = 15.0,"), encoding="utf-8")
    assert RobotArm.from_file(own).base_mass == 15.0
    own.write_text(text.replace("centroid =", "centre ="), encoding="utf-8")
    with pytest.raises(ModelError, match=r"own.toml, base: 'centroid' is missing"):
        RobotArm.from_file(own)


# Kinova j2s7s300 description: each joint's origin [m] and roll, pitch, yaw [rad] in its parent.
QUARTER_TURN = np.pi / 2
DESCRIPTION = [
    ([0.0, 0.0, 0.15675], [0.0, np.pi, 0.0]),
    ([0.0, 0.0016, -0.11875], [-QUARTER_TURN, 0.0, np.pi]),
    ([0.0, -0.205, 0.0], [-QUARTER_TURN, 0.0, 0.0]),
    ([0.0, 0.0, -0.205], [QUARTER_TURN, 0.0, np.pi]),
    ([0.0, 0.2073, -0.0114], [-QUARTER_TURN, 0.0, np.pi]),
    ([0.0, 0.0, -0.10375], [QUARTER_TURN, 0.0, np.pi]),
    ([0.0, 0.10375, 0.0], [-QUARTER_TURN, 0.0, np.pi]),
]
END_EFFECTOR = [0.0, 0.0, -0.16]


def test_jaco_arm_is_the_description_reversed(rng):
    """From base to hand by the description, at q_(8-j) = -theta_j: the same pose, inverted."""
    arm = RobotArm.jaco()
    angles = rng.uniform(-3.0, 3.0, 7)
    rotation, origin = np.eye(3), np.zeros(3)
    for (place, (roll, pitch, yaw)), angle in zip(
        DESCRIPTION, -angles[::-1], strict=True
    ):
        origin = origin + rotation @ place
        turn = Rotation.from_euler("xyz", [roll, pitch, yaw]) * Rotation.from_euler(
            "z", angle
        )
        rotation = rotation @ turn.as_matrix()
    hand = origin + rotation @ END_EFFECTOR
    # Base frame as the hand sees it, then in truss axes. The paper's base frame is turned by
    # half a turn about z against the description's, which its inertia does not see.
    to_truss = arm.hand_rotation @ rotation.T
    expected_origin = -to_truss @ hand
    expected_rotation = to_truss @ np.diag([-1.0, -1.0, 1.0])
    position, base_rotation = base_of(arm, angles)
    assert_near(position - base_rotation @ arm.base_centroid, expected_origin, 1e-12)
    assert_near(base_rotation, expected_rotation, 1e-12)


def test_printed_inertias_are_those_of_the_description_s_cylinders():
    """About the joint, all 24 to the printed digit, with the tensors of links 2 to 6 not rotated.

    This is what shows that Table 2 is about the frame origins, and pins the centres of mass.
    """
    for j, (mass, printed) in enumerate(zip(MASSES, INERTIAS, strict=True)):
        centre = LITERAL.static_moments[j] / mass
        central = RobotArm.jaco().inertias[j] - mass * (centre @ centre * np.eye(3))
        cylinder = np.diag(central) + mass * centre**2
        if 2 <= j <= 6:
            # an error of the table: y and z of the link's tensor are not exchanged
            cylinder = cylinder[[0, 2, 1]]
        shift = mass * (centre @ centre - centre**2)
        assert_near(cylinder + shift, printed, PRINTED_DIGIT / 2, err_msg=str(j))

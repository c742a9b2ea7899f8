"""The arms: printed numbers, known geometry, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trussflow.models import ModelError, RobotArm, arm_terms, shipped_file

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


def base_of(arm, angles):
    """Return place and orientation of the base's centroid relative to the grasp point."""
    still = np.zeros(6)
    terms = arm_terms(arm, angles, 0.0 * angles, np.eye(3), np.zeros(3), still, still)
    return terms.base_position, terms.base_rotation


def test_literal_arm_has_the_printed_numbers():
    arm = RobotArm.literal()
    assert np.array_equal(arm.masses, MASSES)
    assert np.array_equal([np.diag(j) for j in arm.inertias], INERTIAS)
    assert arm.base_mass == 13.9
    assert np.array_equal(np.diag(arm.base_inertia), [0.8494, 0.4894, 1.194])
    assert arm.mass == pytest.approx(19.3972, rel=1e-12)


def test_literal_arm_at_zero_angles_ends_where_table_2_leads():
    """Computed by hand from the eight rows: the base turned over, 0.33 m beside the grasp."""
    position, rotation = base_of(RobotArm.literal(), np.zeros(7))
    assert np.allclose(position, [0.3264, 0.0, -0.272], rtol=0, atol=1e-12)
    assert np.array_equal(rotation, [[0, 1, 0], [1, 0, 0], [0, 0, -1]])


def test_jaco_arm_stretched_reaches_as_far_as_the_real_one():
    """Joints 2, 4, 6 at half a turn: all lengths of the real arm along z add up."""
    arm = RobotArm.jaco()
    angles = np.array([0.0, np.pi, 0.0, np.pi, 0.0, np.pi, 0.0])
    position, _ = base_of(arm, angles)
    links = 0.16 + 0.10375 + 0.10375 + 0.2073 + 0.205 + 0.205 + 0.11875
    base = 0.15675 + 0.125
    assert np.allclose(position, [-0.0098, 0.0, -links - base], rtol=0, atol=1e-12)


def test_jaco_inertias_are_the_printed_ones_where_the_paper_is_right():
    """Links 0, 1 and 7 were rotated before the parallel-axis term; the others were not."""
    arm = RobotArm.jaco()
    for j in (0, 1, 7):
        assert np.allclose(np.diag(arm.inertias[j]), INERTIAS[j], rtol=0, atol=PRINTED_DIGIT / 2)
    assert arm.inertias[4][1, 1] == pytest.approx(0.00038, abs=1e-5)  # printed: 0.0025
    # The parallel-axis term has off-diagonal elements, which the table omits.
    assert arm.inertias[3][1, 2] == pytest.approx(2.4e-4, abs=1e-5)


@pytest.mark.parametrize(("arm", "rank"), [(RobotArm.literal(), 3), (RobotArm.jaco(), 6)])
def test_rest_posture_is_singular_as_printed_and_regular_for_the_real_arm(arm, rank):
    still = np.zeros(6)
    terms = arm_terms(arm, arm.rest_angles, np.zeros(7), np.eye(3), np.zeros(3), still, still)
    assert np.linalg.matrix_rank(terms.screws, tol=1e-6) == rank


def test_data_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        RobotArm.literal().masses[0] = 1.0


def test_arms_are_compared_by_their_numbers():
    arm = RobotArm.literal()
    assert arm.same_as(RobotArm.literal())
    assert arm.same_as(replace(arm, name="other", rest_angles=np.ones(7)))
    assert not arm.same_as(RobotArm.jaco())
    assert not arm.same_as(replace(arm, base_mass=14.0))


def changed(name, index, factor):
    arm = RobotArm.literal()
    values = getattr(arm, name).copy()
    values[index] = factor * values[index]
    return replace(arm, **{name: values})


def test_the_last_link_may_be_no_more_than_a_frame():
    """It is one body with the base; half a body is refused, and so is a frame elsewhere."""
    arm = RobotArm.literal()
    names = ("masses", "static_moments", "inertias")

    def without(link):
        return {
            name: np.concatenate([v[:link], 0.0 * v[:1], v[link + 1 :]])
            for name in names
            for v in [getattr(arm, name)]
        }

    assert replace(arm, **without(7)).bodies[7].mass == arm.base_mass
    for name in names:
        with pytest.raises(ModelError, match="link 7"):
            replace(arm, **without(7) | {name: getattr(arm, name)})
    with pytest.raises(ModelError, match=r"mass of link 6 is 0.0 kg"):
        replace(arm, **without(6))


def test_masses_must_be_positive():
    with pytest.raises(ModelError, match=r"robot arm 'literal': mass of link 2 is -0.463 kg"):
        changed("masses", 2, -1.0)
    with pytest.raises(ModelError, match=r"mass of the base is 0.0 kg"):
        replace(RobotArm.literal(), base_mass=0.0)


def test_inertia_must_be_positive_definite_about_the_centre_of_mass():
    """An inertia about the centre given as if about the joint: the usual mistake."""
    with pytest.raises(
        ModelError, match=r"inertia of link 5 about its centre of mass is not positive definite.*kg"
    ):
        changed("inertias", 5, 0.3)


def test_inertia_must_obey_the_triangle_inequality():
    with pytest.raises(ModelError, match=r"no rigid body has the inertia of the base.*triangle"):
        replace(RobotArm.literal(), base_inertia=np.diag([0.2, 0.4, 1.194]))


def test_inertia_must_be_symmetric():
    skewed = np.diag([0.8494, 0.4894, 1.194])
    skewed[0, 1] = 0.1
    with pytest.raises(ModelError, match="inertia of the base is not symmetric"):
        replace(RobotArm.literal(), base_inertia=skewed)


def test_inertia_of_the_hand_lies_on_the_limit_and_is_accepted():
    """Printed with four digits, two links come out as flat bodies: the check has slack."""
    arm = RobotArm.literal()
    centre = arm.static_moments[0] / arm.masses[0]
    central = arm.inertias[0] - arm.masses[0] * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    small, middle, large = np.linalg.eigvalsh(central)
    assert abs(small + middle - large) < 1e-15


def test_shapes_are_checked():
    with pytest.raises(ModelError, match=r"masses has shape \(7,\); it must be \(8,\)"):
        replace(RobotArm.literal(), masses=np.ones(7))
    with pytest.raises(ModelError, match=r"joint_rotations has shape \(7, 3, 3\); it must be \(0, 3, 3\)"):
        replace(RobotArm.literal(), joint_origins=np.zeros((0, 3)))


def test_numbers_must_be_finite_numbers():
    origins = RobotArm.literal().joint_origins.copy()
    origins[3, 1] = np.nan
    with pytest.raises(ModelError, match="robot arm 'literal': joint_origins is not finite"):
        replace(RobotArm.literal(), joint_origins=origins)
    with pytest.raises(ModelError, match="masses must be numeric, not"):
        replace(RobotArm.literal(), masses=np.array(["heavy"] * 8))


def test_rotations_must_be_rotations():
    with pytest.raises(ModelError, match=r"hand_rotation is not a rotation matrix"):
        replace(RobotArm.literal(), hand_rotation=2.0 * np.eye(3))
    mirrored = RobotArm.literal().joint_rotations.copy()
    mirrored[2] = -mirrored[2]
    with pytest.raises(ModelError, match=r"joint_rotations\[2\] is not a rotation matrix"):
        replace(RobotArm.literal(), joint_rotations=mirrored)


def test_own_files_are_read(tmp_path):
    """A file with another mass gives another arm; a file without one names what is missing."""
    text = shipped_file("robot_arm_literal.toml").read_text(encoding="utf-8")
    own = tmp_path / "own.toml"
    own.write_text(text.replace("value = 13.9,", "value = 15.0,"), encoding="utf-8")
    assert RobotArm.from_file(own).base_mass == 15.0
    own.write_text(text.replace("centroid =", "centre ="), encoding="utf-8")
    with pytest.raises(ModelError, match=r"own.toml, base: 'centroid' is missing"):
        RobotArm.from_file(own)


# Kinova j2s7s300 description: each joint's origin [m] and roll, pitch, yaw [rad] in its parent.
H = np.pi / 2
DESCRIPTION = [
    ([0.0, 0.0, 0.15675], [0.0, np.pi, 0.0]),
    ([0.0, 0.0016, -0.11875], [-H, 0.0, np.pi]),
    ([0.0, -0.205, 0.0], [-H, 0.0, 0.0]),
    ([0.0, 0.0, -0.205], [H, 0.0, np.pi]),
    ([0.0, 0.2073, -0.0114], [-H, 0.0, np.pi]),
    ([0.0, 0.0, -0.10375], [H, 0.0, np.pi]),
    ([0.0, 0.10375, 0.0], [-H, 0.0, np.pi]),
]
END_EFFECTOR = [0.0, 0.0, -0.16]


def test_jaco_arm_is_the_description_reversed(rng):
    """From base to hand by the description, at q_(8-j) = -theta_j: the same pose, inverted."""
    arm = RobotArm.jaco()
    angles = rng.uniform(-3.0, 3.0, 7)
    rotation, origin = np.eye(3), np.zeros(3)
    for (place, (roll, pitch, yaw)), angle in zip(DESCRIPTION, -angles[::-1], strict=True):
        origin = origin + rotation @ place
        turn = Rotation.from_euler("xyz", [roll, pitch, yaw]) * Rotation.from_euler("z", angle)
        rotation = rotation @ turn.as_matrix()
    hand = origin + rotation @ END_EFFECTOR
    # Base frame as the hand sees it, then in truss axes. The paper's base frame is turned by
    # half a turn about z against the description's, which its inertia does not see.
    to_truss = arm.hand_rotation @ rotation.T
    expected_origin = -to_truss @ hand
    expected_rotation = to_truss @ np.diag([-1.0, -1.0, 1.0])
    position, base_rotation = base_of(arm, angles)
    found_origin = position - base_rotation @ arm.base_centroid
    assert np.allclose(found_origin, expected_origin, rtol=0, atol=1e-12)
    assert np.allclose(base_rotation, expected_rotation, rtol=0, atol=1e-12)


def test_printed_inertias_are_those_of_the_description_s_cylinders():
    """About the joint, all 24 to the printed digit, with the tensors of links 2 to 6 not rotated.

    This is what shows that Table 2 is about the frame origins, and pins the centres of mass.
    """
    for j, (mass, printed) in enumerate(zip(MASSES, INERTIAS, strict=True)):
        centre = RobotArm.literal().static_moments[j] / mass
        central = RobotArm.jaco().inertias[j] - mass * (centre @ centre * np.eye(3))
        cylinder = np.diag(central) + mass * centre**2
        if 2 <= j <= 6:  # an error of the table: y and z of the link's tensor are not exchanged
            cylinder = cylinder[[0, 2, 1]]
        shift = mass * (centre @ centre - centre**2)
        assert np.max(np.abs(cylinder + shift - printed)) < PRINTED_DIGIT / 2, j

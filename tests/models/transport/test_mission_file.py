"""Missions as files: those of the source, one that a user begins with, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sources import MISSIONS
from systems import assert_near

from trussflow.models import ModelError, RobotArm, shipped_file
from trussflow.models.transport import Mission, MissionFile

TABLES = "structure", "robots", "path", "controller", "hardware", "simulation"
NEW = shipped_file("new_mission.toml").read_text(encoding="utf-8")


def written(tmp_path, *changes):
    """Return a file like a new one, with changes."""
    text = NEW
    for before, after in changes:
        assert before in text
        text = text.replace(before, after, 1)
    path = tmp_path / "mission.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("case", [1, 2])
def test_missions_of_the_source_are_files(case):
    flown, mission = MissionFile.of_case(case), Mission.of_case(case)
    assert repr(flown.mission) == repr(mission)
    assert (flown.law, flown.solver, flown.duration, flown.hardware) == (
        "ismc",
        "rk4",
        80.0,
        None,
    )
    assert not flown.truss.modal_actuation


def test_a_new_mission_is_read_and_wired(tmp_path):
    flown = MissionFile.read(
        written(tmp_path, ('"5 N"', '"4 N"'), ('"40 s"', '"0.6 min"'))
    )
    assert flown.mission.attitude[2] == pytest.approx(np.deg2rad(10.0), rel=1e-15)
    assert flown.mission.duration == pytest.approx(36.0, rel=1e-15)
    assert flown.hardware.limits(flown.truss)[:6] == pytest.approx(
        [4.0] * 3 + [0.3] * 3, rel=1e-12
    )
    assert {"actuators", "sensors", "controller"} <= set(flown.diagram().blocks)
    said = {told.key: (told.value, told.place) for told in flown.told}
    assert said["thrusters.maximum"] == ("4 N", "mission.toml")
    assert said["thrusters.period"] == ("0.02 s", "hardware.toml")


def test_a_quaternion_is_asked_for_in_the_file(tmp_path):
    """The attitude at the start stays in Euler angles; the path then is an axis times an angle."""
    start = ('# start_attitude = "[0, 0, 0] deg"', 'start_attitude = "[0, 0, 90] deg"')
    asked = ('# attitude = "quaternion"', 'attitude = "quaternion"')
    turn = ('"[0, 0, 10] deg"', '"[200, 0, 0] deg"'), ('"40 s"', '"90 s"')
    path = written(tmp_path, start, asked, *turn)
    flown = MissionFile.read(path)
    half = np.sqrt(0.5)
    q = flown.truss.parameters["initial_coordinates"]
    assert_near(q[3:7], [half, 0.0, 0.0, half], 1e-15)
    assert flown.diagram().blocks["trajectory"].port("position").whole_shape == (
        flown.truss.rigid_q,
    )
    assert flown.said("structure.attitude") == "quaternion"
    path.write_text(path.read_text().replace('"quaternion"', '"quaternions"'))
    with pytest.raises(
        ModelError, match="'attitude' is 'quaternions'; choose from: euler, quaternion"
    ):
        MissionFile.read(path)


def test_what_is_assumed_is_told(tmp_path):
    text = MissionFile.read(written(tmp_path)).explained()
    assert "assumed: cold nitrogen gas" in text
    assert "The actuators need at least 30." in text
    assert "for the path, which takes 40 s" in text
    assert "Only" not in text
    brief = MissionFile.read(
        written(tmp_path, ('duration = "60 s"', 'duration = "25 s"'))
    )
    assert (
        "which takes 40 s. Only 25 s are simulated, by simulation.duration."
        in brief.explained()
    )


def test_settings_count_more_than_the_file(tmp_path):
    flown = MissionFile.read(
        written(tmp_path), controller={"law": "pd"}, hardware={"kind": "none"}
    )
    assert (flown.law, flown.hardware) == ("pd", None)
    tables = {told.key.split(".")[0] for told in flown.told}
    assert tables == {*TABLES, "proportional_derivative", "allocation"}


@pytest.mark.parametrize(
    "settings, used",
    [
        ({"law": "mean axes"}, set()),
        (
            {"law": "ismc"},
            {"observer_bandwidth", "reaching_gain", "observer", "allocation"},
        ),
        (
            {"law": "ismc", "observer": "off"},
            {"reaching_gain", "observer", "allocation"},
        ),
        ({"law": "smc"}, {"observer", "allocation"}),
        (
            {"law": "smc", "observer": "on"},
            {"observer_bandwidth", "observer", "allocation"},
        ),
    ],
)
def test_gains_of_other_laws_are_not_told(tmp_path, settings, used):
    flown = MissionFile.read(written(tmp_path), controller=settings)
    assert {
        t.key.split(".")[1] for t in flown.told if t.key.startswith("controller.")
    } == {"law", *used}
    assert any(t.key.startswith("mean_axes.") for t in flown.told) == (
        settings["law"] == "mean axes"
    )


def test_files_extend_others(tmp_path):
    (tmp_path / "mine.toml").write_text(
        'extends = "case_2.toml"\n[path]\nduration = "90 s"\n', encoding="utf-8"
    )
    child = tmp_path / "child.toml"
    child.write_text('title = "slow"\nextends = "mine.toml"\n', encoding="utf-8")
    flown = MissionFile.read(child)
    assert (flown.title, flown.mission.duration) == ("slow", 90.0)
    assert_array_equal(flown.mission.position, [6.0, 6.0, 0.0])
    (tmp_path / "mine.toml").write_text('extends = "child.toml"\n', encoding="utf-8")
    with pytest.raises(
        ModelError, match=r"child.toml: 'extends' is a cycle back to child.toml"
    ):
        MissionFile.read(child)


def test_hardware_of_another_rate_than_the_law(tmp_path):
    more = '[computer]\nsample_time = "10 ms"\ndelay = "20 ms"\n\n[wheels]'
    flown = MissionFile.read(written(tmp_path, ("[wheels]", more)))
    with pytest.raises(ModelError, match=r"the hardware has a sample time of 0.01 s"):
        flown.diagram()


@pytest.fixture
def boom(tmp_path):
    """Return a mission of a boom with another robot at each grasp, beside its files."""
    for name in ("boom.toml", "walker.urdf"):
        (tmp_path / name).write_bytes((MISSIONS / name).read_bytes())
    path = tmp_path / "mission.toml"
    path.write_text(BOOM, encoding="utf-8")
    return path


BOOM = """
title = "boom"
[structure]
model = "frame"
file = "boom.toml"
grasps = [[1, 2, 3], 14]
damping = "0.5 %"
highest_frequency = "100 Hz"
[[robots]]
arm = "walker.urdf"
hand = "hand"
base = "base"
[[robots]]
arm = "literal"
[path]
position = "[0, 0, 1] m"
attitude = "[0, 0, 0] deg"
duration = "60 s"
[controller]
law = "mean axes"
"""


OWN = """arm = "walker.urdf"
hand = "hand"
base = "base"
locked = { lift = "30 deg" }
rotation = "[0, 0, 90] deg"
bus_mass = "50 kg"
[robots.thrusters]
maximum = "9 N"
[robots.drives]
torque = "2 N*m"
[[robots]]
"""


def test_each_robot_has_a_table_of_its_own(boom):
    """A value left out is as for all robots."""
    boom.write_text(
        BOOM.replace(
            'arm = "walker.urdf"\nhand = "hand"\nbase = "base"\n[[robots]]\n', OWN
        )
    )
    flown = MissionFile.read(boom, hardware={"kind": "flight"})
    walker, literal = flown.truss.dynamics.arms
    held = RobotArm.from_urdf(
        MISSIONS / "walker.urdf", hand="hand", base="base", locked={"lift": np.pi / 6.0}
    )
    turned = held.hand_rotation[:, [1, 0, 2]] * [1.0, -1.0, 1.0]
    inertia = held.base_inertia * (50.0 / held.base_mass)
    expected = replace(held, hand_rotation=turned, base_mass=50.0, base_inertia=inertia)
    for name in ("hand_rotation", "joint_origins", "base_inertia", "masses"):
        assert_near(getattr(walker, name), getattr(expected, name), 1e-12)
    assert literal.drive_inertias == pytest.approx([0.1] * 7, rel=1e-12)
    limits = flown.hardware.limits(flown.truss)
    bases, joints = limits[:12].reshape(2, 2, 3), limits[12:]
    assert bases == pytest.approx(
        np.repeat([[[9.0], [0.3]], [[5.0], [0.3]]], 3, axis=2), rel=1e-12
    )
    assert joints == pytest.approx(
        [2.0] * walker.joints + [3.0] * literal.joints, rel=1e-12
    )
    actuators = flown.diagram().blocks["actuators"].blocks
    assert [actuators[f"thrusters_{k}"].reach[0] for k in (1, 2)] == pytest.approx(
        [9.0, 5.0], rel=1e-12
    )
    assert flown.said("robots.arm") == "walker.urdf, literal"
    everywhere = MissionFile.read(boom, robots={"arm": "jaco"})
    assert everywhere.said("robots.arm") == "jaco, jaco"
    boom.write_text(
        boom.read_text().replace('arm = "literal"', 'arm = "literal"\nbase = "tug"')
    )
    message = r"robots\[1\]: 'base' applies to a URDF file only, and the arm is 'literal'; omit it"
    with pytest.raises(ModelError, match=message):
        MissionFile.read(boom)


def test_a_structure_and_robots_of_files(boom):
    flown = MissionFile.read(boom)
    arm, literal = flown.truss.dynamics.arms
    assert arm.mass == pytest.approx(15.5, rel=1e-12)
    assert literal.same_as(RobotArm.literal())
    modes = flown.truss.dynamics.modes
    assert (modes.damping_ratios == 0.005).all()
    lengths = np.linalg.norm(np.diff(modes.positions[flown.rods], axis=1), axis=2)
    assert lengths.min() > 0.1
    assert {"trajectory", "controller", "truss", "errors"} == set(
        flown.diagram().blocks
    )

"""The missions of the examples: structures and robots of one's own, flown for some seconds."""

import campaign
import numpy as np
import pytest
from sources import MISSIONS
from systems import actuator_limits, assert_near, by_default

from trussflow.blocks import ShapedTrajectory
from trussflow.blocks.errors import SimulationWarning
from trussflow.models import FreeModes
from trussflow.models.dynamics.task_space import to_body
from trussflow.models.feasibility import fastest
from trussflow.models.geometry.rotation import euler_rotation
from trussflow.models.transport import MissionFile, check_run, mean_axes_transport

# Noise of 1e-4 on everything measured, and thrust in steps of 0.1 N.
ROOT_TOLERANCE = 1.5e-4  # m, rad
# Of momentum and its integral, by trapezoids between samples: thrust is held, but the bases shake.
MOMENTUM_TOLERANCE = 1e-5


def read(name):
    if name == "antenna":
        pytest.importorskip("pyyeti", reason="pyyeti reads Nastran's files")
    return MissionFile.read(MISSIONS / f"{name}_mission.toml")


def flown(mission, duration):
    """Return a flight, interpreted: the compiler takes longer than some seconds of it."""
    with by_default("interpreted"):
        return mission.simulator(mission.diagram()).run(duration)


OTHERS = ("antenna", "ring")[: campaign.SIZE]


@pytest.fixture(scope="module", params=["boom", *map(campaign.only, OTHERS)])
def mission(request):
    return read(request.param)


@pytest.fixture(scope="module")
def run(mission):
    return flown(mission, 3.0)


def momentum_and_force(truss, run, now, held):
    """Return linear and angular momentum about the origin, and their rates under the thrust `held`."""
    at = {name: run[name].values[now] for name in run.data_vars}
    acting = {name: run[name].values[held] for name in run.data_vars}
    none = np.zeros(0)  # a truss without joints has no such signals
    angles, rates = (at.get(name, none) for name in ("joint_angle", "joint_rate"))
    q = np.concatenate([at["position"], at["attitude"], angles, at["modal_coordinate"]])
    speeds = np.concatenate([at["velocity"], at["attitude_rate"], rates])
    v = np.concatenate([to_body(truss.dynamics.attitude, q, speeds), at["modal_rate"]])
    wrenches = np.hstack([acting["base_force"], acting["base_torque"]]).ravel()
    actuation = np.concatenate([wrenches, acting.get("joint_torque", none)])
    terms = truss.dynamics.evaluate(q, v)
    turn = np.kron(np.eye(2), euler_rotation(q[3:6]))
    body = np.stack([terms.mass_matrix @ v, terms.actuation_matrix @ actuation], axis=1)
    along, about = np.split(turn @ body[:6], 2)
    return np.concatenate([along, about + np.cross(q[:3], along, axisb=0, axisc=0)]).T


def test_momentum_comes_from_thrusters_and_wheels_alone(mission, run):
    """Joints, elastic deformation and the robots' motion change nothing of it."""
    time, given, largest = run["time"].values, np.zeros(6), np.zeros(6)
    start = momentum = momentum_and_force(mission.truss, run, 0, 0)[0]
    for k in range(len(time) - 1):
        before = momentum_and_force(mission.truss, run, k, k)[1]
        momentum, after = momentum_and_force(mission.truss, run, k + 1, k)
        given += (time[k + 1] - time[k]) * (before + after) / 2.0
        largest = np.maximum(largest, np.abs(given))
    missing = np.abs(momentum - start - given).reshape(2, 3).max(axis=1)
    assert (missing < MOMENTUM_TOLERANCE * largest.reshape(2, 3).max(axis=1)).all()


def test_the_root_stays_on_its_path(mission, run):
    names = [
        "position_error",
        "attitude_error",
        *["joint_error"] * bool(mission.truss.joints),
    ]
    errors = [run[name].values for name in names]
    assert_near(np.hstack(errors), 0.0, ROOT_TOLERANCE)


def test_beyond_linear_elasticity_there_is_a_warning(mission, run):
    modes = mission.truss.dynamics.modes
    assert check_run(run, mission.truss).attrs["deflection"] < 1e-3
    first = np.eye(modes.modes)[:1]
    bent = run.assign(
        modal_coordinate=run["modal_coordinate"]
        + 0.15 * first[0] / modes.deflection(first)
    )
    with pytest.warns(
        SimulationWarning, match=r"bends by 0\.15 of its size or rad; above 0\.1"
    ) as warnings:
        found = check_run(bent, mission.truss)
    assert len(warnings) == 1
    assert found.attrs["deflection"] == pytest.approx(0.15, rel=0.01)


def test_joints_that_leave_their_way_are_named(mission, run):
    joints = mission.truss.dynamics.joint_data
    ends = [joint.upper for joint in joints]
    if not np.isfinite(ends).any():
        pytest.skip("joints without ends")
    k = int(np.argmin(ends))
    beyond = run["joint_angle"].copy()
    beyond[-1, k] = ends[k] + 0.25
    unit = mission.truss.task_units[6 + k]
    message = (
        rf"joint '{joints[k].name}' of robot \d moves 0\.25 {unit} beyond its limits"
    )
    with pytest.warns(SimulationWarning, match=message):
        check_run(run.assign(joint_angle=beyond), mission.truss)


def test_the_path_leaves_a_margin(mission):
    """Force is mass times acceleration: half the least duration would take four times as much."""
    assert 5.0 < mission.least_duration() < mission.mission.duration / 3.0


@pytest.mark.campaign
def test_the_boom_follows_the_fastest_path_of_half_its_strength():
    """Shaped for its first mode, of which less than half the vibration is left."""
    left = []
    for shaped in (False, True):
        boom = MissionFile.read(MISSIONS / "boom_mission.toml")
        truss = boom.truss
        half = actuator_limits(
            truss.dynamics, force=2.5, base_torque=0.15, joint_torque=0.15
        )
        way = [[0, 0, 0, 0, 0, 0], [0, 0, 0.5, 0, 0, 0], [0, 0.3, 1, 0, 0, 0]]
        path = fastest(truss, truss.dynamics.rest[:6] + np.array(way), half)
        assert path.duration < 12.0  # s, where the quintic takes 60
        if shaped:
            first = FreeModes.of(truss.dynamics, 1).frequencies[0] / (2.0 * np.pi)
            path = ShapedTrajectory(path, first, kind="ZV")
        diagram = mean_axes_transport(
            boom.mission, truss, design=boom.design, hardware=boom.hardware, path=path
        )
        result = boom.simulator(diagram).run(16.0)
        assert_near(result["position_error"], 0.0, 2.0 * ROOT_TOLERANCE)
        assert np.abs(result["base_force"]).max() < 2.5
        left.append(result["modal_coordinate"][-150:, 0].std())
    assert left[1] < left[0] / 2.0

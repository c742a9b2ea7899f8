"""The missions of the examples: structures and robots of one's own, flown for some seconds."""

from pathlib import Path

import numpy as np
import pytest

from trussflow.blocks import ShapedTrajectory, SimulationWarning
from trussflow.blocks.library.trajectory import Trajectory
from trussflow.models import FreeModes
from trussflow.models.dynamics.task_space import to_body
from trussflow.models.feasibility import ActuatorLimits, FastestPath, fastest
from trussflow.models.geometry.rotation import euler_rotation
from trussflow.models.transport import MissionFile, mean_axes_transport, tidy

EXAMPLES = Path(__file__).parents[3] / "examples"

FLOWN = 3.0  # s
# Noise of 1e-4 on everything measured, and thrust in steps of 0.1 N.
CLOSE = 1.5e-4  # m, rad
# Of momentum and its integral, by trapezoids between samples: thrust is held, but the bases shake.
BALANCED = 1e-5


@pytest.fixture(scope="module", params=["antenna", "boom", "ring"])
def file(request):
    if request.param == "antenna":
        pytest.importorskip("pyyeti", reason="pyyeti reads Nastran's files")
    return EXAMPLES / f"{request.param}_mission.toml"


@pytest.fixture(scope="module")
def mission(file):
    return MissionFile.read(file)


@pytest.fixture(scope="module")
def run(mission):
    return mission.simulator(mission.diagram()).run(FLOWN, progress=False)


def momentum_and_force(truss, run, now, held):
    """Return linear and angular momentum about the origin, and their rates under the thrust `held`."""
    at = {name: run[name].values[now] for name in run.data_vars}
    acting = {name: run[name].values[held] for name in ("base_force", "base_torque", "joint_torque")}
    q = np.concatenate([at["task_position"], at["modal_coordinate"]])
    v = np.concatenate([to_body(truss.dynamics.attitude, q, at["task_velocity"]), at["modal_rate"]])
    wrenches = np.hstack([acting["base_force"], acting["base_torque"]]).ravel()
    actuation = np.concatenate([wrenches, acting["joint_torque"]])
    terms = truss.dynamics.evaluate(q, v)
    turn = np.kron(np.eye(2), euler_rotation(q[3:6]))
    found = []
    for body in (terms.mass_matrix @ v, terms.actuation_matrix @ actuation):
        along, about = np.split(turn @ body[:6], 2)
        found.append(np.concatenate([along, about + np.cross(q[:3], along)]))
    return found[0], found[1]


def test_momentum_comes_from_thrusters_and_wheels_alone(mission, run):
    """Joints, elastic deformation and the robots' motion change nothing of it."""
    time, given, largest = run["time"].values, np.zeros(6), np.zeros(6)
    start = momentum = momentum_and_force(mission.truss, run, 0, 0)[0]
    for k in range(len(time) - 1):
        before = momentum_and_force(mission.truss, run, k, k)[1]
        momentum, after = momentum_and_force(mission.truss, run, k + 1, k)
        given += (time[k + 1] - time[k]) * (before + after) / 2.0
        largest = np.maximum(largest, np.abs(given))
    for part in (slice(3), slice(3, 6)):
        missing = np.abs(momentum - start - given)[part]
        assert np.max(missing) < BALANCED * np.max(largest[part])


def test_the_root_stays_on_its_path(run):
    assert np.abs(run["task_position"].values - run["reference"].values).max() < CLOSE


def test_a_flight_is_the_same_to_the_bit(file, run):
    mission = MissionFile.read(file)
    again = mission.simulator(mission.diagram()).run(FLOWN, progress=False)
    for name in run.data_vars:
        assert np.array_equal(again[name], run[name])


def test_beyond_linear_elasticity_there_is_a_warning(mission, run):
    modes = mission.truss.dynamics.modes
    assert tidy(run, mission.truss).attrs["deflection"] < 1e-3
    first = np.eye(modes.modes)[0]
    run = run.assign(modal_coordinate=run["modal_coordinate"] + 0.15 * first / modes.deflection(first[None]))
    with pytest.warns(
        SimulationWarning, match=r"the truss bends by 0\.15 of its size or rad; above 0\.1"
    ) as told:
        found = tidy(run, mission.truss)
    assert len(told) == 1
    assert found.attrs["deflection"] == pytest.approx(0.15, rel=0.01)


def test_joints_that_leave_their_way_are_named(mission, run):
    ends = [joint.upper for joint in mission.truss.dynamics.joint_data]
    if not np.any(np.isfinite(ends)):
        pytest.skip("joints without ends")
    k = int(np.argmin(ends))
    beyond = run["task_position"].values.copy()
    beyond[-1, 6 + k] = ends[k] + 0.25
    name, unit = mission.truss.dynamics.joint_data[k].name, mission.truss.task_units[6 + k]
    with pytest.warns(
        SimulationWarning, match=rf"joint '{name}' of robot \d goes 0\.25 {unit} beyond its way"
    ):
        tidy(run.assign(task_position=(run["task_position"].dims, beyond)), mission.truss)


def test_the_path_leaves_a_margin(mission):
    """Force is mass times acceleration: half the least duration would take four times as much."""
    assert 5.0 < mission.least_duration() < mission.mission.duration / 3.0


def test_the_boom_flies_the_fastest_path_of_half_its_strength():
    """Shaped for its first mode, of which less than half the vibration is left."""
    left = []
    for shaped in (False, True):
        flown = MissionFile.read(EXAMPLES / "boom_mission.toml")
        truss = flown.truss
        half = ActuatorLimits(force=2.5, base_torque=0.15, joint_torque=0.15)
        way = [[0, 0, 0, 0, 0, 0], [0, 0, 0.5, 0, 0, 0], [0, 0.3, 1, 0, 0, 0]]
        path: Trajectory = fastest(truss, truss.dynamics.rest[:6] + np.array(way), half)
        assert isinstance(path, FastestPath)
        assert path.duration < 12.0  # s, where the quintic takes 60
        if shaped:
            first = FreeModes.of(truss.dynamics, 1).frequencies[0] / (2.0 * np.pi)
            path = ShapedTrajectory(path, first, kind="ZV")
        diagram = mean_axes_transport(
            flown.mission, truss, design=flown.design, hardware=flown.hardware, path=path
        )
        result = tidy(flown.simulator(diagram).run(16.0, progress=False), truss)
        assert np.abs(result["position_error"]).max() < 2.0 * CLOSE
        assert np.abs(result["base_force"]).max() < 2.5
        left.append(float(result["modal_coordinate"][-150:, 0].std()))
    assert left[1] < left[0] / 2.0

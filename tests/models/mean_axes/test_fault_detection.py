"""The monitor of the actuators: whose loss it was, how soon, and no alarm from noise, bias or idleness.

The arms are those that it believes in, moved by the rigid equations at rest posture; what it sees is noisy.
"""

from dataclasses import replace

import campaign
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from trussflow.blocks import Diagram, Function, Input, Output, Session
from trussflow.blocks.framework.declarations import Signals
from trussflow.models import (
    ActuatorExcitation,
    FaultDetection,
    Hardware,
    MeanAxesDesign,
    RobotArm,
    SpaceTruss,
    TrussDynamics,
)
from trussflow.models.feasibility import shares_left
from trussflow.models.transport import Mission, mean_axes_transport, path_of

DYNAMICS = SpaceTruss.consistent().dynamics
RIGID = DYNAMICS.rigid_coordinates
DESIGN = MeanAxesDesign.shipped()
MONITOR = FaultDetection(DYNAMICS, DESIGN)
STEP = DESIGN.sample_time
TERMS = DYNAMICS.evaluate(DYNAMICS.rest, np.zeros(DYNAMICS.coordinates))
RESPONSE = np.linalg.solve(
    TERMS.mass_matrix[:RIGID, :RIGID], TERMS.actuation_matrix[:RIGID]
)
PARTS = MONITOR.members.T > 0.0
"""Actuators of each base, then of the drives of each arm."""
LOSSES = [*((part,) for part in range(8)), *((robot, robot + 4) for robot in range(4))]
"""Each base, each arm's drives, each whole robot."""
SIZES = np.concatenate([np.tile([2.0] * 3 + [0.02] * 3, 4), [5e-3] * 28])
"""Commands: forces of newtons, torques as they hold an arm [N, N·m]."""
IDLE = np.zeros((100, 52))
SEEDS = range(2, 2 + 2 * campaign.SIZE)


@pytest.fixture(scope="module")
def session():
    """Return monitor and probe, with inputs from the simulated arms."""
    diagram = Diagram("d")
    monitor = FaultDetection(DYNAMICS, DESIGN)
    probe = ActuatorExcitation(DYNAMICS, DESIGN, monitor)
    diagram.add(monitor=monitor, probe=probe)
    diagram.expose(
        position=monitor.position,
        velocity=monitor.velocity,
        actuation=monitor.actuation,
    )
    diagram.ground(monitor.disturbance)
    diagram.expose(effectiveness=monitor.effectiveness, torques=probe.probe)
    with Session(diagram, step=STEP) as found:
        yield found


def isolation_time(session, failed, commands, strength=0.0, seed=0):
    """Simulate rigid arms of which some parts fail at half the time.

    Return the time from the failure to the isolation of all of them [s]; no other part is isolated.
    """
    rng = np.random.default_rng(seed)
    lost = np.any(PARTS[list(failed)], axis=0)
    half = len(commands) // 2
    speeds = np.zeros(RIGID)
    shown = []
    inputs = {
        "position": DYNAMICS.rest[:RIGID],
        "velocity": speeds,
        "actuation": 0.0 * commands[0],
    }
    session.start(inputs=inputs, parameters={"probe.strength": strength})
    for k, command in enumerate(commands):
        acting = command + session.outputs["torques"]
        noise = DESIGN.rate_noise * rng.standard_normal(RIGID)
        session.set(velocity=speeds + noise, actuation=acting)
        shown.append(session.outputs["effectiveness"])
        session.advance((k + 1) * STEP)
        speeds = speeds + STEP * RESPONSE @ np.where(lost & (k >= half), 0.0, acting)
    left = np.array(shown)
    assert (left[:, ~lost] == 1.0).all()
    assert (left[: half + 1] == 1.0).all()
    isolated = (left[:, lost] == 0.0).all(axis=1)
    return STEP * (np.append(np.flatnonzero(isolated), np.inf)[0] - half)


def pushes(size, count):
    """Return random commands: each twice there and twice back, so that speeds stay small."""
    each = size * SIZES * np.random.default_rng(0).standard_normal((count, 52))
    return np.kron(each, [[1.0], [1.0], [-1.0], [-1.0]])


@pytest.mark.parametrize("failed", LOSSES)
def test_each_loss_is_isolated(session, failed):
    assert 0.0 < isolation_time(session, failed, pushes(1.0, 50)) < 0.5


@pytest.mark.parametrize("size", [1.0, 0.01])
def test_no_alarm_of_healthy_actuators(session, size):
    isolation_time(session, (), pushes(size, 100))


@pytest.mark.parametrize("failed", LOSSES)
@pytest.mark.parametrize("seed", [1, *map(campaign.only, SEEDS)])
def test_the_probe_shows_a_loss_of_idle_actuators(session, failed, seed):
    """Without the probe, no loss of a base, of the drives of an arm, or of a robot is isolated."""
    assert 0.0 < isolation_time(session, failed, IDLE, DESIGN.probe, seed) < 0.3
    assert isolation_time(session, failed, IDLE, 0.0, seed) == np.inf


@pytest.mark.parametrize(
    ("duration", "arrival"), [(6.0, 41.0), campaign.only(60.0, 240.0)]
)
def test_a_path_becomes_slower_after_a_loss(duration, arrival):
    """Base 4 fails at a sixth of the way, which then is beyond reach along body z in that time.

    Shorter missions have the same accelerations. Attitude and joints are held all the same.
    """
    scale = duration / 60.0
    mission = replace(
        Mission.of_case(1), position=6.0 * scale**2 * np.eye(3)[2], duration=duration
    )
    plant, hardware = SpaceTruss.consistent(), Hardware.flight(control="torque")
    shares = shares_left(DYNAMICS, path_of(mission, plant), hardware.limits(plant))
    assert_array_equal(shares[:3], 1.0)
    diagram = mean_axes_transport(mission, plant, hardware=hardware, seed=1)
    trajectory, controller = (diagram.blocks[k] for k in ("trajectory", "controller"))
    smallest = Function(
        lambda health: np.min(np.where(health[:24:6] < 1.0, shares, 1.0)),
        {"health": Input(plant.actuators)},
        {"share": Output()},
    )
    diagram.add(smallest=smallest)
    controller.port("effectiveness") >> smallest >> trajectory.port("share")
    diagram.expose(health=diagram.blocks["actuators"].port("base_effectiveness"))
    diagram.expose(position=plant.task_position, known=controller.port("effectiveness"))
    diagram.expose(
        wanted=trajectory.port("position"), arrival=trajectory.port("arrival")
    )
    worst = np.zeros(RIGID)
    with Session(diagram, step=2e-3) as session:
        session.start(inputs={"health": np.ones(4)})
        session.advance(10.0 * scale)
        assert session.outputs["arrival"] == duration
        session.set(health=np.array([1.0, 1.0, 1.0, 0.0]))
        for time in np.arange(10.5, 40.0, 0.5) * scale:
            session.advance(time)
            worst = np.maximum(
                worst, np.abs(session.outputs["position"] - session.outputs["wanted"])
            )
        assert_array_equal(session.outputs["known"], np.where(PARTS[3], 0.0, 1.0))
        assert session.outputs["arrival"] == pytest.approx(arrival, rel=0.16)
        assert worst[:6].max() < 0.02 * scale
        assert worst[6:].max() < 0.3 * scale


def without_joints():
    """Return a robot that is bolted on."""
    arm = RobotArm.jaco()
    return replace(
        arm,
        joint_origins=arm.joint_origins[:0],
        joint_rotations=arm.joint_rotations[:0],
        rest_angles=arm.rest_angles[:0],
        joint_data=(),
        **{n: getattr(arm, n)[:1] for n in ("masses", "static_moments", "inertias")},
    )


def test_a_robot_without_joints_is_never_suspected(modes, rng):
    """Joints tell of their own robot; of a module bolted on they tell what the truss's bending does, too."""
    arm, module = RobotArm.jaco(), without_joints()
    system = TrussDynamics(
        modes=modes, arms=(arm, module, arm, module), elastic_integrals=True
    )
    monitor = FaultDetection(system, MeanAxesDesign.shipped())
    x = Signals(
        "x", {n: rng.standard_normal(monitor.state_shape(n)) for n in monitor.states()}
    )
    for name in ("before", "sums", "suspected", "dead", "truce"):
        x[name] = 0.0 * x[name]
    u = Signals(
        "u",
        {n.name: rng.standard_normal(n.whole_shape or ()) for n in monitor.inputs()},
    )
    u["position"] = system.rest[: system.rigid_coordinates]
    for lost in (0, 1):  # an arm's base, a module
        x["rates"] = (
            u["velocity"][6:] - x["expected"].sum(axis=1) + x["expected"][:, lost]
        )
        sums = monitor.update(np.array(0.0), x, u, Signals("p", monitor.parameters))[
            "sums"
        ]
        assert not np.any(sums[1::2])
        assert (sums[0] > 0.0) == (lost == 0)


@pytest.mark.parametrize("scale", [1e-4, 1e-2])
@pytest.mark.parametrize("modules", [0, 3])
def test_the_evidence_is_that_of_its_formula(scale, modules, rng):
    """S grows by -(a' r + delta a' a) / s with the inverse of R as it stands in the docstring."""
    arms = (*DYNAMICS.arms[modules:], *[without_joints()] * modules)
    monitor = FaultDetection(replace(DYNAMICS, arms=arms), DESIGN)
    n = monitor.joints  # more than parts, and fewer
    effects, residue = (
        scale * rng.standard_normal((n, 8)),
        scale * rng.standard_normal(n),
    )
    each = np.hstack([effects, effects[:, :4] + effects[:, 4:]])
    p = Signals("p", monitor.parameters)
    p["unknown_share"] = 2.0 * DESIGN.unknown_share
    R = np.linalg.inv(monitor.precision) + p.unknown_share**2 * effects @ effects.T
    weighed = np.linalg.solve(R, np.column_stack([each, residue]))
    strength = np.sum(each * weighed[:, :12], axis=0)
    left = [r @ np.linalg.solve(R, r) for r in (residue, *(residue[:, None] + each).T)]
    scaled = max(DESIGN.calm, min(left) / n)
    expected = -(each.T @ weighed[:, 12] + DESIGN.drift * strength) / scaled
    found = monitor.evidence_of(effects, residue, p)
    assert_allclose(found, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())

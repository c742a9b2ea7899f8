"""The monitor of the actuators: whose loss it was, how soon, and no alarm from noise, bias or idleness.

The arms are those that it believes in, moved by the rigid equations at rest posture; what it sees is noisy.
"""

from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import Diagram, Session
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.types import Vector
from trussflow.models import ActuatorMonitor, Hardware, MeanAxesDesign, RobotArm, SpaceTruss, TrussDynamics
from trussflow.models.feasibility import ActuatorLimits, shares_left
from trussflow.models.transport import Mission, mean_axes_transport, path_of

TRUSS = SpaceTruss.consistent()
DYNAMICS = TRUSS.dynamics
RIGID = DYNAMICS.rigid_coordinates
REST = DYNAMICS.rest[:RIGID]
TERMS = DYNAMICS.evaluate(DYNAMICS.rest, np.zeros(DYNAMICS.coordinates))
RESPONSE = np.linalg.solve(TERMS.mass_matrix[:RIGID, :RIGID], TERMS.actuation_matrix[:RIGID])
GROUPS = [slice(6 * i, 6 * i + 6) for i in range(4)] + [slice(24 + 7 * i, 31 + 7 * i) for i in range(4)]
LOSSES = [(g,) for g in range(8)] + [(i, 4 + i) for i in range(4)]
"""Each base, each arm's drives, each whole robot."""
DESIGN = MeanAxesDesign.shipped()
SIZE = np.concatenate([np.tile([2.0] * 3 + [0.02] * 3, 4), [5e-3] * 28])
"""What is ordered: forces of newtons, torques as they hold an arm [N, N·m]."""


def watched(dead, *, orders=1.0, seed=0, samples=400):
    """Return the effectiveness that the monitor shows at each sample; the loss is at half of them."""
    rng = np.random.default_rng(seed)
    diagram = Diagram("d")
    monitor = diagram.add(monitor=ActuatorMonitor(DYNAMICS, DESIGN))
    diagram.expose(position=monitor.position, velocity=monitor.velocity, actuation=monitor.actuation)
    diagram.ground(monitor.disturbance)
    diagram.expose(effectiveness=monitor.effectiveness)
    step, speeds, told = DESIGN.sample_time, np.zeros(RIGID), np.zeros(52)
    shown: list[Vector] = []
    with Session(diagram, step=step, backend="interpreted") as session:
        session.start(inputs={"position": REST, "velocity": speeds, "actuation": np.zeros(52)})
        for k in range(samples):
            # Twice there and twice back, so that speeds stay small.
            if k % 4 == 0:
                told = orders * SIZE * rng.standard_normal(52)
            elif k % 4 == 2:
                told = -told
            noise = DESIGN.rate_noise * rng.standard_normal(RIGID)
            session.set(velocity=speeds + noise, actuation=told)
            shown.append(session.outputs["effectiveness"])
            session.advance((k + 1) * step)
            acting = told.copy()
            for group in dead if k >= samples // 2 else ():
                acting[GROUPS[group]] = 0.0
            speeds = speeds + step * RESPONSE @ acting
    return shown


@pytest.mark.parametrize("dead", LOSSES)
def test_each_loss_is_named(dead):
    shown = watched(dead)
    lost = [[k for k, each in enumerate(shown) if each[group].max() == 0.0] for group in GROUPS]
    assert [bool(when) for when in lost] == [g in dead for g in range(8)]
    for group in dead:
        assert 200 < lost[group][0] < 200 + 0.5 / DESIGN.sample_time


@pytest.mark.parametrize("orders", [1.0, 0.01])
def test_no_alarm_of_healthy_actuators(orders):
    assert all((each == 1.0).all() for each in watched((), orders=orders))


@pytest.mark.slow
@pytest.mark.parametrize("dead", [0, 1, 2])
def test_a_base_dies_in_flight(dead):
    """A base dies at 10 s, at three newtons (base 1) or less: it is named, and the flight goes on."""
    plant = SpaceTruss.consistent()
    diagram = mean_axes_transport(Mission.of_case(1), plant, hardware=Hardware.flight(), seed=1)
    truss, actuators, controller = (diagram.blocks[n] for n in ("truss", "actuators", "controller"))
    diagram.expose(health=actuators.port("base_effectiveness"))
    wanted = diagram.blocks["trajectory"].port("position")
    diagram.expose(
        position=truss.port("task_position"), wanted=wanted, known=controller.port("effectiveness")
    )
    with Session(diagram, step=2e-3) as session:
        session.start(inputs={"health": np.ones(4)})
        session.advance(10.0)
        session.set(health=1.0 - np.eye(4)[dead])
        session.advance(10.3)
        known = session.outputs["known"]
        assert (known[GROUPS[dead]] == 0.0).all()
        assert known.sum() == 46.0
        session.advance(20.0)
        found = session.outputs
        assert (found["known"] == known).all()
        assert np.abs(found["position"] - found["wanted"])[:6].max() < 0.01
        assert np.abs(found["position"] - found["wanted"])[6:].max() < 0.2


@pytest.mark.slow
def test_a_path_becomes_slower_where_a_loss_asks_for_it():
    """Base 4 dies at 10 s: 60 s are beyond reach along body z; attitude and joints are held all the same."""
    mission = Mission.of_case(1)
    plant, limits = SpaceTruss.consistent(), ActuatorLimits.flight()
    path = path_of(mission, plant)
    shares = shares_left(DYNAMICS, path, limits)
    np.testing.assert_array_equal(shares[:3], 1.0)
    diagram = mean_axes_transport(mission, plant, hardware=Hardware.flight(), shares=shares, seed=1)
    truss, trajectory, controller = (diagram.blocks[n] for n in ("truss", "trajectory", "controller"))
    diagram.expose(health=diagram.blocks["actuators"].port("base_effectiveness"))
    diagram.expose(position=truss.port("task_position"), known=controller.port("effectiveness"))
    diagram.expose(wanted=trajectory.port("position"), arrival=trajectory.port("arrival"))
    with Session(diagram, step=2e-3) as session:
        session.start(inputs={"health": np.ones(4)})
        session.advance(10.0)
        assert session.outputs["arrival"] == 60.0
        session.set(health=np.array([1.0, 1.0, 1.0, 0.0]))
        worst = np.zeros(RIGID)
        for time in np.arange(10.5, 40.0, 0.5):
            session.advance(float(time))
            worst = np.maximum(worst, np.abs(session.outputs["position"] - session.outputs["wanted"]))
        assert session.outputs["known"][18:24].max() == 0.0
        assert session.outputs["known"].sum() == 46.0
        assert 200.0 < session.outputs["arrival"] < 280.0
        assert worst[:3].max() < 0.02
        assert worst[3:6].max() < 0.02
        assert worst[6:].max() < 0.3


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
    system = TrussDynamics(modes=modes, arms=(arm, module, arm, module), elastic_integrals=True)
    monitor = ActuatorMonitor(system, MeanAxesDesign.shipped())
    x = Signals("x", {n: rng.standard_normal(monitor.state_shape(n)) for n in monitor.states()})
    for name in ("before", "sums", "suspected", "dead", "truce"):
        x[name] = 0.0 * x[name]
    u = Signals("u", {n.name: rng.standard_normal(n.whole_shape or ()) for n in monitor.inputs()})
    u["position"] = system.rest[: system.rigid_coordinates]
    for lost in (0, 1):  # an arm's base, a module
        x["rates"] = u["velocity"][6:] - x["expected"].sum(axis=1) + x["expected"][:, lost]
        sums = monitor.update(np.array(0.0), x, u, Signals("p", monitor.parameters))["sums"]
        assert not np.any(sums[1::2])
        assert (sums[0] > 0.0) == (lost == 0)


def test_what_no_loss_explains_speaks_for_none(rng):
    """A loss stands out at any scale; a residue of another kind, however large, does not."""
    monitor = ActuatorMonitor(DYNAMICS, DESIGN)
    p = Signals("p", monitor.parameters)
    effects = 1e-3 * rng.standard_normal((28, 8))
    for scale in (0.1, 1.0, 10.0):
        found = monitor.evidence_of(scale * effects, -scale * effects[:, 3], p)
        assert np.argmax(found) == 3
        assert found[3] > 1.0
    other = rng.standard_normal(28)
    for scale in (1e-1, 1.0, 10.0):
        assert np.max(monitor.evidence_of(effects, scale * other, p)) < 1.0


@pytest.mark.parametrize("scale", [1e-4, 1e-2])
@pytest.mark.parametrize("modules", [0, 3])
def test_the_evidence_is_that_of_its_formula(scale, modules, rng):
    """S grows by -(a' r + delta a' a) / s with the inverse of R as it stands in the docstring."""
    arms = (*DYNAMICS.arms[modules:], *[without_joints()] * modules)
    monitor = ActuatorMonitor(replace(DYNAMICS, arms=arms), DESIGN)
    n = monitor.joints  # more than parts, and fewer
    effects, residue = scale * rng.standard_normal((n, 8)), scale * rng.standard_normal(n)
    each = np.hstack([effects, effects[:, :4] + effects[:, 4:]])
    R = np.linalg.inv(monitor.precision) + DESIGN.unknown_share**2 * effects @ effects.T
    weighed = np.linalg.solve(R, np.column_stack([each, residue]))
    strength = np.sum(each * weighed[:, :12], axis=0)
    left = [r @ np.linalg.solve(R, r) for r in (residue, *(residue[:, None] + each).T)]
    scaled = max(DESIGN.calm, min(left) / n)
    expected = -(each.T @ weighed[:, 12] + DESIGN.drift * strength) / scaled
    found = monitor.evidence_of(effects, residue, Signals("p", monitor.parameters))
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())


def test_arms_that_are_longer_than_believed_are_no_loss():
    """A tenth of what base 4 does could be all of base 1, which does as much as that, much alike."""
    monitor = ActuatorMonitor(DYNAMICS, DESIGN)
    p = Signals("p", monitor.parameters)
    effects = 1e-2 * np.random.default_rng(3).standard_normal((28, 8))
    effects[:, 0] = 0.1 * (effects[:, 3] + 0.2 * effects[:, 0])
    assert np.max(monitor.evidence_of(effects, -0.1 * effects[:, 3], p)) < 1.0
    assert monitor.evidence_of(effects, -effects[:, 3], p)[3] > 10.0
    p["unknown_share"] = np.array(0.0)
    assert np.argmax(monitor.evidence_of(effects, -0.1 * effects[:, 3], p)) == 0
    assert np.max(monitor.evidence_of(effects, -0.1 * effects[:, 3], p)) > 10.0

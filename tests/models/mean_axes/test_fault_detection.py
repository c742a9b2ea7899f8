"""Fault detection: whose loss it was, how soon, and no verdict without a loss.

The arms are those of the model, moved by the rigid equations at rest posture; the measured rates are noisy.
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
SIZES = np.concatenate([np.tile([2.0] * 3 + [0.02] * 3, 4), [5e-3] * 28])
"""Commands: forces of newtons, torques as they hold an arm [N, N·m]."""
IDLE = np.zeros((200, 52))


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
    diagram.expose(
        effectiveness=monitor.effectiveness,
        held=monitor.held,
        lost=monitor.lost_shares,
        unexplained=monitor.unexplained,
        torques=probe.probe,
    )
    with Session(diagram, step=STEP) as found:
        yield found


def watched(
    session,
    commands,
    share=None,
    push=0.0,
    strength=0.0,
    seed=0,
    locked=False,
    lasting=np.inf,
):
    """Simulate rigid arms with a fault in the second half of the samples.

    Parameters
    ----------
    share : array, shape (8,)
        Lost shares of bases, then of drives of the arms.
    push : array, shape (52,)
        Further actuation that nobody has commanded.
    lasting : float
        Number of samples with the fault.
    locked : bool
        Whether joints with lost drives are locked.

    Returns
    -------
    failed, held : array, shape (samples, 4)
        Failed bases and held arms.
    lost : array, shape (samples, 8)
        Estimated shares.
    """
    rng = np.random.default_rng(seed)
    share = np.zeros(8) if share is None else share
    half, speeds, shown = len(commands) // 2, np.zeros(RIGID), []
    stays = np.append(np.zeros(6, bool), share[4:].repeat(7) > 0.0) & locked
    moving = np.flatnonzero(~stays)
    loose = np.zeros((RIGID, 52))
    loose[moving] = np.linalg.solve(
        TERMS.mass_matrix[np.ix_(moving, moving)], TERMS.actuation_matrix[moving]
    )
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
        session.advance((k + 1) * STEP)
        out = session.outputs
        shown.append(
            np.concatenate(
                [1.0 - out["effectiveness"][:24:6], out["held"][::7], out["lost"]]
            )
        )
        if k < half or k >= half + lasting:
            speeds = speeds + STEP * RESPONSE @ acting
        else:
            acting = (1.0 - share @ PARTS) * acting + push
            speeds = np.where(stays, 0.0, speeds + STEP * loose @ acting)
    failed, held, lost = np.split(np.array(shown), [4, 8], axis=1)
    assert not failed[: half + 1].any()
    assert not held[: half + 1].any()
    return failed[half:], held[half:], lost[half:]


def first(flags):
    """Return the time of the first raised flag [s]."""
    return STEP * np.append(np.flatnonzero(flags), np.inf)[0]


def pushes(size, count):
    """Return random commands: each twice there and twice back, so that speeds stay small."""
    each = size * SIZES * np.random.default_rng(0).standard_normal((count, 52))
    return np.kron(each, [[1.0], [1.0], [-1.0], [-1.0]])


@pytest.mark.parametrize("robot", range(4))
@pytest.mark.parametrize("part", [0, 4])
def test_each_loss_is_isolated(session, part, robot):
    """A base has failed, or the drives of an arm have; the other parts have not."""
    flags = watched(session, pushes(1.0, 50), share=np.eye(8)[part + robot])
    found = flags[part // 4]
    assert first(found[:, robot]) < 0.3
    assert not np.delete(found, robot, axis=1).any()
    assert not flags[1 - part // 4].any()


@pytest.mark.parametrize("bases, isolated", [(2, True), (3, False), (4, False)])
def test_a_loss_of_most_bases_has_a_common_cause(session, bases, isolated):
    share = np.append(np.where(np.arange(4) < bases, 0.7, 0.0), np.zeros(4))
    failed, _, lost = watched(session, pushes(1.0, 50), share)
    assert_allclose(lost[-1], share, rtol=0.0, atol=0.2)
    assert failed.any() == isolated


@pytest.mark.parametrize("size", [1.0, 0.01])
def test_no_alarm_of_healthy_actuators(session, size):
    failed, held, _ = watched(session, pushes(size, 100))
    assert not failed.any()
    assert not held.any()


@pytest.mark.parametrize("part", range(8))
def test_the_probe_shows_a_loss_of_idle_actuators(session, part):
    """Without the probe, no loss of a base or of the drives of an arm is found."""
    share, kind = np.eye(8)[part], part // 4
    times = []
    for seed in range(1 + 2 * campaign.SIZE):
        flags = watched(session, IDLE, share, strength=DESIGN.probe, seed=seed)
        times.append(first(flags[kind][:, part % 4]))
        assert not flags[1 - kind].any()
    assert np.median(times) < 0.5
    assert np.isfinite(times).all()
    failed, held, _ = watched(session, IDLE, share)
    assert not failed.any()
    assert not held.any()


@pytest.mark.parametrize("left", [0.3, 0.5, 0.9])
def test_the_lost_share_is_estimated(session, left):
    share = (1.0 - left) * np.eye(8)[1]
    failed, held, lost = watched(session, pushes(1.0, 50), share)
    assert_allclose(lost[-1], share, rtol=0.0, atol=0.1)
    assert not held.any()
    assert failed[:, 1].any() == (left < 0.35)


@pytest.mark.parametrize("left", [0.0, 0.5])
def test_a_sudden_loss_of_constant_thrust_is_seen_at_once(session, left):
    """Only changes count, and the loss is one: the evidence starts anew at its sample."""
    commands = np.tile(np.eye(52)[0], (100, 1))
    failed, _, lost = watched(session, commands, (1.0 - left) * np.eye(8)[0])
    assert_allclose(lost[5, :4], (1.0 - left) * np.eye(4)[0], rtol=0.0, atol=0.1)
    assert first(failed[:, 0]) < 0.1 if left == 0.0 else not failed.any()


@pytest.mark.parametrize("bases_too", [False, True])
def test_the_truss_tells_whether_the_base_of_a_held_arm_works(session, bases_too):
    """The joints of a braked arm show neither base nor drives."""
    commands = np.tile(8.0 * np.eye(52)[2], (200, 1))
    share = np.eye(8)[4] + bases_too * np.eye(8)[0]
    failed, held, _ = watched(
        session, commands, share, strength=DESIGN.probe, locked=True
    )
    assert first(held[:, 0]) < 0.5
    assert failed[:, 0].any() == bases_too
    assert not failed[:, 1:].any()


def test_a_base_that_works_again_is_used_again(session):
    """It fails for 2 s, and its excitation goes on."""
    share = np.eye(8)[0]
    idle = np.zeros((400, 52))
    failed, _, _ = watched(session, idle, share, strength=DESIGN.probe, lasting=100)
    assert failed[50:100, 0].all()
    assert not failed[-1].any()


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("size", [0.3, 2.0])
def test_an_open_valve_is_none_of_the_hypotheses(session, axis, size):
    """No base is lost for long: a base that responds to its excitation is used again."""
    push = size * np.eye(52)[6 + axis]
    failed, _, _ = watched(session, IDLE, push=push, strength=DESIGN.probe)
    assert not failed[-1].any()


@pytest.mark.parametrize("duration, arrival", [(6.0, 41.0), campaign.only(60.0, 240.0)])
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
        assert session.outputs["arrival"] == pytest.approx(arrival, rel=0.2)
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


def quiet(monitor):
    """Return states, inputs and parameters at rest without evidence."""
    x = Signals("x", {n: np.zeros(monitor.state_shape(n)) for n in monitor.states()})
    u = Signals("u", {n.name: np.zeros(n.whole_shape or ()) for n in monitor.inputs()})
    x["residual"] = np.array(1.0)
    u["position"] = monitor.dynamics.rest[: monitor.rigid]
    return x, u, Signals("p", monitor.parameters)


def test_the_most_significant_loss_comes_first():
    """Correlated commands make two bases seem lost; the second one is used until the first is isolated."""
    x, u, p = quiet(MONITOR)
    evidence = np.array([1e4, 2e4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    x["match"], x["information"] = evidence, np.diag(evidence)
    after = MONITOR.update(np.array(0.0), x, u, p)
    assert_array_equal(after["suspected"], np.eye(4)[1])
    x["failed"] = np.eye(4)[1]
    after = MONITOR.update(np.array(0.0), x, u, p)
    assert_array_equal(after["suspected"], np.eye(4)[0])


@pytest.mark.parametrize("dispensable", [1.0, 0.0])
@pytest.mark.parametrize("before", [0.0, 1.0])
@pytest.mark.parametrize("settled", [1.0, 0.0])
def test_a_dispensable_base_is_isolated_after_two_samples(before, dispensable, settled):
    """It is not while the vibration after another isolation decays."""
    x, u, p = quiet(MONITOR)
    p["dispensable"] = np.array([dispensable, 1.0, 1.0, 1.0])
    x["match"], x["information"] = 1e4 * np.eye(8)[0], 1e4 * np.eye(8)
    x["suspected"] = before * np.eye(4)[0]
    x["settling"] = np.array(1.0 - settled)
    after = MONITOR.update(np.array(0.0), x, u, p)
    isolated = before * dispensable * settled
    assert_array_equal(after["failed"], isolated * np.eye(4)[0])
    assert after["settling"] == (3.0 if isolated else 1.0 - settled - STEP)


@pytest.mark.parametrize(
    "lost, recent, braked, settling, residual, used",
    [
        (0.0, 0.0, 0.0, 0.0, 1.0, True),
        (1.0, 0.0, 0.0, 0.0, 1.0, False),
        (0.0, 1.0, 0.0, 0.0, 1.0, False),
        (0.0, 0.0, 1.0, 0.0, 1.0, False),
        (0.0, 0.0, 0.0, 1.0, 1.0, True),
        (0.0, 0.0, 0.0, 0.0, 9.0, True),
    ],
)
def test_a_failed_base_is_used_again_if_both_estimates_agree(
    lost, recent, braked, settling, residual, used
):
    """It stays isolated with a braked arm. A wrong verdict is taken back at once."""
    x, u, p = quiet(MONITOR)
    x["failed"] = np.eye(4)[0]
    x["settling"], x["residual"] = np.array(settling), np.array(residual)
    x["frame_information"] = 1e4 * np.ones(4)
    for prefix, share in (("", lost), ("recent_", recent)):
        x[prefix + "information"] = 1e4 * np.eye(8)
        x[prefix + "match"] = 1e4 * (share * np.eye(8)[0] + braked * np.eye(8)[4])
    after = MONITOR.update(np.array(0.0), x, u, p)
    assert_array_equal(after["failed"], np.eye(4)[0] * (not used))


@pytest.mark.parametrize(
    "rival, held, suspected",
    [(0.88, 1.0, 0.0), (0.88, 0.12, 0.0), (0.88, 0.08, 1.0), (0.8, 1.0, 1.0)],
)
def test_the_base_of_a_held_arm_leads_over_those_of_others(rival, held, suspected):
    """By 2.5 standard deviations of 0.01, if the arm of the other base was held a short time ago."""
    x, u, p = quiet(MONITOR)
    x["information"], x["match"] = 1e4 * np.eye(8), 1e4 * np.eye(8)[4]
    x["frame_information"] = 1e4 * np.ones(4)
    x["frame_match"] = 1e4 * np.array([0.9, rival, 0.0, 0.0])
    x["held_arms"] = held * np.eye(4)[1]
    shown = MONITOR.output(np.array(0.0), x, u, p)["held"]
    assert_array_equal(shown, np.repeat((x["held_arms"] == 1.0) * 1.0, 7))
    after = MONITOR.update(np.array(0.0), x, u, p)
    assert_array_equal(after["suspected"], suspected * np.eye(4)[0])
    assert_array_equal(after["held_arms"], [1.0, 0.98 * held, 0.0, 0.0])


@pytest.mark.parametrize("prefix", ["", "recent_"])
@pytest.mark.parametrize(
    "share, information, held", [(0.45, 1e4, 0.0), (0.55, 1e4, 1.0), (0.9, 1.0, 0.0)]
)
def test_a_large_significant_loss_of_its_drives_shows_a_held_arm(
    prefix, share, information, held
):
    """By one of the two estimates, so that a valve that moves its own arm is not taken for a failed base."""
    x, u, p = quiet(MONITOR)
    x[prefix + "information"] = information * np.eye(8)
    x[prefix + "match"] = share * (information + 1.0) * np.eye(8)[4]
    after = MONITOR.update(np.array(0.0), x, u, p)
    assert_array_equal(after["held_arms"], held * np.eye(4)[0])


@pytest.mark.parametrize("prefix", ["", "recent_"])
def test_one_significant_estimate_is_enough(prefix):
    x, u, p = quiet(MONITOR)
    x["information"] = x["recent_information"] = 1e4 * np.eye(8)
    x[prefix + "match"] = 1e4 * np.eye(8)[0]
    after = MONITOR.update(np.array(0.0), x, u, p)
    assert_array_equal(after["suspected"], np.eye(4)[0])


def test_a_robot_without_joints_is_never_suspected(modes):
    """Joints tell of their own robot; of a module bolted on they tell what the truss's bending does, too."""
    arm, module = RobotArm.jaco(), without_joints()
    system = TrussDynamics(
        modes=modes, arms=(arm, module, arm, module), elastic_integrals=True
    )
    monitor = FaultDetection(system, MeanAxesDesign.shipped())
    x, u, p = quiet(monitor)
    for lost in (0, 1):  # an arm's base, a module
        x["match"] = 1e4 * np.eye(8)[lost]
        x["information"] = 1e4 * np.eye(8)
        after = monitor.update(np.array(0.0), x, u, p)
        assert_array_equal(after["suspected"], np.eye(4)[lost] * (lost == 0))

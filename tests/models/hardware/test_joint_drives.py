"""Drives of joints: friction, servo, brakes, reflected inertia."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm
from systems import assert_near, simulate_block

from trussflow.blocks import Constant, Diagram, Gain, Integrator, Step, simulate
from trussflow.models import (
    BrakeLatch,
    Hardware,
    Joint,
    JointDrives,
    JointServo,
    Measurement,
    ModelError,
    ServoDesign,
    SpaceTruss,
)

LINK_INERTIA = 0.5  # kg·m²
SERVO_STEP = 1e-3
ONE_JOINT = (Joint("a"),)


def driven(drives, rate=0.0, load=0.0):
    """Return a diagram of one inertia with drives, moving at the start."""
    diagram = Diagram("a driven inertia")
    drives, speed, angle, push, inverse = diagram.add(
        drives=drives,
        speed=Integrator([rate], unit="rad/s"),
        angle=Integrator([0.0], unit="rad"),
        push=Constant([load], unit="N*m"),
        inverse=Gain([1.0 / LINK_INERTIA], input_unit="N*m", output_unit="rad/s**2"),
    )
    drives.torque + push.y >> inverse >> speed >> angle
    speed >> drives.rate
    angle >> drives.angle
    return diagram


def test_a_servo_on_one_inertia_responds_exactly():
    """Position and rate sampled at 1 kHz, the torque one sample late, against the exact recurrence."""
    stiffness, damping, aim = 30.0, 6.0, 0.1
    diagram = driven(JointDrives(ONE_JOINT, torque=100.0))
    servo, aims, *gains = diagram.add(
        servo=JointServo(ONE_JOINT, SERVO_STEP, torque=100.0),
        aims=Constant([aim], unit="rad"),
        stiffness=Constant([stiffness]),
        damping=Constant([damping]),
    )
    aims >> servo.reference
    gains[0] >> servo.proportional_gain
    gains[1] >> servo.derivative_gain
    diagram.angle.y >> servo.angle
    diagram.speed.y >> servo.rate
    servo.torque >> diagram.drives.command
    run = simulate(
        diagram, 0.3, step=SERVO_STEP, log=["angle.y", "speed.y", "servo.impulse"]
    )
    flow = expm(
        np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0 / LINK_INERTIA], [0.0, 0.0, 0.0]])
        * SERVO_STEP
    )
    z, expected, impulse = np.zeros(3), [], 0.0
    for _ in range(301):
        expected.append([z[0], z[1], impulse])
        late = stiffness * (aim - z[0]) - damping * z[1]
        impulse += SERVO_STEP * z[2]
        z = flow @ z
        z[2] = late
    found = np.concatenate([run[name].values for name in run.data_vars], axis=1)
    assert_near(found, expected, 1e-12)
    # The integral of the torque is the momentum of the inertia.
    assert_near(found[:, 2], LINK_INERTIA * found[:, 1], 1e-12)


def test_a_servo_adds_the_feedforward_and_keeps_its_limit():
    ports = {
        "reference": Constant([0.0, 0.0, 1.0]),
        "angle": Constant([0.0, 0.0, 0.0]),
        "rate": Constant([0.0, -0.1, 0.0]),
        "feedforward": Constant([0.2, 0.0, 0.0]),
        "proportional_gain": Constant([5.0, 5.0, 5.0]),
        "derivative_gain": Constant([2.0, 2.0, 2.0]),
    }
    joints = [Joint(name) for name in "abc"]
    servo = JointServo(joints, SERVO_STEP, torque=0.3)
    run = simulate_block(servo, 2 * SERVO_STEP, ports, step=SERVO_STEP)
    assert_array_equal(run["block.torque"][0], 0.0)
    assert_allclose(run["block.torque"][1], [0.2, 0.2, 0.3], rtol=1e-12)


def braked(load, command=0.0, failure=0.5):
    """Return the run of an inertia whose drive fails under a load while it moves."""
    drives = JointDrives(
        ONE_JOINT, torque=1.0, brake_stiffness=1e4, brake_damping=200.0
    )
    diagram = driven(drives, 0.05, load)
    latch, health, release = diagram.add(
        latch=BrakeLatch(ONE_JOINT, SERVO_STEP),
        health=Step(failure, initial_value=[1.0], final_value=[0.0]),
        release=Constant([command]),
    )
    diagram.angle.y >> latch.angle
    health >> latch.effectiveness
    health >> diagram.drives.effectiveness
    release >> latch.command
    latch.engaged >> diagram.drives.engaged
    latch.held >> diagram.drives.held
    diagram.ground(diagram.drives.command)
    return simulate(diagram, 1.5, step=SERVO_STEP, log=["angle.y", "latch.engaged"])


def test_a_brake_holds_the_joint_where_it_is():
    """The load of 0.1 N·m bends the brake by load over stiffness, wherever the joint is."""
    run = braked(0.1)
    angle = run["angle.y"].values[:, 0]
    engaged = run["latch.engaged"].values[:, 0]
    assert_array_equal(engaged, run["time"].values >= 0.5 - 1e-9)
    assert angle[500] == pytest.approx(
        0.05 * 0.5 + 0.1 / LINK_INERTIA * 0.125, rel=1e-9
    )
    assert angle[-1] == pytest.approx(angle[500] + 0.1 / 1e4, rel=1e-9)
    assert_near(angle[520:], angle[500], 2e-3)


def test_a_brake_engages_on_command():
    run = braked(0.0, command=1.0, failure=10.0)
    assert run["latch.engaged"].values.all()
    assert abs(run["angle.y"].values[-1, 0]) < 1e-9


def test_a_rotor_behind_a_gear_is_its_reflected_inertia(random_system, rng):
    """Rotors as separate bodies, each with the constraint φ = n θ, have the same accelerations."""
    dynamics = random_system((2, 3), 4, elastic_integrals=True)
    joints, n = dynamics.joints, dynamics.freedoms
    ratio, rotors = rng.uniform(20.0, 150.0, joints), rng.uniform(1e-6, 1e-5, joints)
    q = dynamics.rest + 0.1 * rng.standard_normal(dynamics.coordinates)
    v = 0.1 * rng.standard_normal(n)
    terms = dynamics.evaluate(q, v)
    motors = 1e-3 * rng.standard_normal(joints)
    constraint = np.zeros((joints, n + joints))
    constraint[:, 6 : 6 + joints] = np.diag(ratio)
    constraint[:, n:] = -np.eye(joints)
    size = n + 2 * joints
    matrix, forces = np.zeros((size, size)), np.zeros(size)
    matrix[:n, :n] = terms.mass_matrix
    matrix[n : n + joints, n : n + joints] = np.diag(rotors)
    matrix[n + joints :, : n + joints] = constraint
    matrix[: n + joints, n + joints :] = constraint.T
    forces[:n], forces[n : n + joints] = -terms.bias, motors
    expected = np.linalg.solve(matrix, forces)[:n]
    geared = dynamics.with_drives(ratio**2 * rotors).evaluate(q, v)
    pushed = -geared.bias
    pushed[6 : 6 + joints] += ratio * motors
    found = np.linalg.solve(geared.mass_matrix, pushed)
    assert_near(found, expected, 1e-9 * np.abs(expected).max())


def test_hardware_mounts_the_inertia_of_its_drives():
    truss = SpaceTruss.consistent()
    geared = Hardware.flight().mounted(truss)
    assert_allclose([j.inertia for j in geared.dynamics.joint_data], 0.1, rtol=1e-12)
    assert len(geared.dynamics.groups) == 1
    gearless = Hardware.flight(control="torque").mounted(geared)
    assert_array_equal([j.inertia for j in gearless.dynamics.joint_data], 0.0)
    with pytest.raises(ModelError, match="has the inertia -1"):
        truss.dynamics.with_drives(-np.ones(28))


def test_the_expected_torque_includes_the_servo():
    """A joint off its reference: after one sample the expected torque is that of the servo."""
    exact = Measurement(sample_time=SERVO_STEP)
    hardware = Hardware.flight()
    servo = ServoDesign(
        sample_time=SERVO_STEP,
        proportional_gain=5.0,
        derivative_gain=0.0,
        encoder=exact,
        tachometer=exact,
    )
    hardware = Hardware(
        **{name: getattr(hardware, name) for name in hardware.__slots__}
        | {"servo": servo, "delay": 0.0}
    )
    truss = hardware.mounted(SpaceTruss.consistent())
    actuators = hardware.actuators(truss)
    command = np.zeros(truss.actuators)
    command[24:] = 0.05
    sources = {
        "command": Constant(command),
        "joint_reference": Constant(np.full(28, 0.02)),
        "joint_reference_rate": Constant(np.zeros(28)),
        "joint_angles": Constant(np.zeros(28)),
        "joint_rates": Constant(np.zeros(28)),
    }
    log = ("actuation", "ordered", "servo_torque")
    log = {name: actuators.port(name) for name in log}
    run = simulate_block(actuators, 0.1, sources, step=SERVO_STEP, log=log)
    assert_allclose(run["actuation"][2:, 24:], 0.05 + 5.0 * 0.02, rtol=1e-12)
    # The first torque is one sample late, so that the first mean is smaller by a twentieth.
    assert_allclose(run["ordered"][0, 24:], 0.05, rtol=1e-12)
    assert_allclose(run["ordered"][20, 24:], 0.95 * 0.15, rtol=1e-9)
    assert_allclose(run["ordered"][40:, 24:], 0.15, rtol=1e-9)
    assert_allclose(
        run["ordered"][20:, 24:] - run["servo_torque"][20:], 0.05, rtol=1e-9
    )

"""All hardware of a truss: commands, limits, delays, failures, and measurements."""

from dataclasses import replace
from functools import partial

import campaign
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import assert_near, simulate_block

from trussflow.blocks import Constant, Noise, Ramp, Step, simulate
from trussflow.models import Hardware, Measurement, SpaceTruss, ThrusterSet
from trussflow.models.transport import Mission, transport_diagram

STEP = 0.02
PAIRS = partial(
    ThrusterSet.pairs,
    0.2,
    maximum=5.0,
    period=STEP,
    quantum=1e-6,
    specific_impulse=70.0,
)


@pytest.fixture(scope="module")
def truss():
    return SpaceTruss.consistent()


def act(truss, hardware, duration, command, **inputs):
    """Return the outputs of the actuators of a truss."""
    actuators = hardware.actuators(truss)
    log = {name: actuators.port(name) for name in ("actuation", "propellant")} | {
        "command": command.y
    }
    if hardware.wheels:
        log["momentum"] = actuators.wheels_1.momentum
    return simulate_block(
        actuators, duration, {"command": command, **inputs}, step=STEP, log=log
    )


def test_commands_come_late_in_steps_and_within_limits(truss):
    """Flight hardware: held for 20 ms, 20 ms late, 5 N in steps of 0.1 N, 0.3 N·m."""
    noise = Noise(np.full(truss.actuators, 3.0), 0.02, seed=1)
    result = act(truss, Hardware.flight(control="torque"), 4.0, noise)
    command, actuation = result["command"].values, result["actuation"].values
    bases = actuation[:, :24].reshape(-1, 4, 6)
    force, torque = bases[..., :3], bases[..., 3:]
    assert np.abs(actuation[0]).max() == 0.0
    assert np.abs(force).max() == pytest.approx(5.0, abs=1e-12)
    assert_near(force / 0.1, np.rint(force / 0.1), 1e-9)
    wanted = command[:-1, :24].reshape(-1, 4, 6)
    assert_near(torque[1:], np.clip(wanted[..., 3:], -0.3, 0.3), 1e-12)
    assert_near(actuation[1:, 24:], np.clip(command[:-1, 24:], -0.3, 0.3), 1e-12)


def test_impulse_follows_the_command(truss):
    noise = Noise(np.full(truss.actuators, 0.08), 0.02, seed=1, mean=0.01)
    result = act(truss, Hardware.flight(control="torque"), 10.0, noise)
    missing = np.cumsum(
        result["command"].values[:-1] - result["actuation"].values[1:], axis=0
    )
    forces = missing[:, :24].reshape(-1, 4, 6)[..., :3]
    # half a quantum; a plain quantizer would lose 5
    assert np.abs(forces).max() <= 0.05 + 1e-9
    assert (result["propellant"].values[-1] > 0).all()


def test_a_base_and_joints_fail_at_the_time_set(truss):
    joints = np.ones(28)
    joints[7:14] = 0.0
    result = act(
        truss,
        Hardware.flight(control="torque"),
        2.0,
        Constant(np.full(truss.actuators, 0.2)),
        base_effectiveness=Step(
            1.0, initial_value=np.ones(4), final_value=[1.0, 0.0, 1.0, 0.5]
        ),
        joint_effectiveness=Step(1.0, initial_value=np.ones(28), final_value=joints),
    )
    before, after = result["actuation"].values[[49, 60]]
    assert_near(before, 0.2, 1e-12)
    bases = after[:24].reshape(4, 6)
    assert_near(bases, np.outer([0.2, 0, 0.2, 0.1], np.ones(6)), 1e-12)
    assert_near(after[24:], 0.2 * joints, 1e-12)
    used = result["propellant"].values[-1]  # as ordered, since nothing measures it
    assert used == pytest.approx(used[0], rel=1e-12)


def test_thrusters_make_up_for_unloading(truss):
    """Twelve thrusters on each base: the wheels give momentum away, and the base feels nothing of it."""
    hardware = replace(Hardware.flight(control="torque"), thrusters=PAIRS)
    torque = np.zeros(truss.actuators)
    torque[3:6] = 0.1, -0.05, 0.02
    unload = Step(1.0, initial_value=0.0, final_value=0.5)
    result = act(truss, hardware, 6.0, Constant(torque), unloading=unload)
    assert_near(result["actuation"][1:, 3:6], np.tile(torque[3:6], (300, 1)), 1e-5)
    momentum = result["momentum"].values
    assert np.abs(momentum[50]).max() == pytest.approx(0.098, abs=1e-9)
    assert result["propellant"][-1, 0] > 0


def test_without_wheels_thrusters_make_the_torques(truss):
    command = np.linspace(-0.3, 0.3, truss.actuators)
    result = act(
        truss,
        replace(Hardware.flight(control="torque"), wheels=None, thrusters=PAIRS),
        0.1,
        Constant(command),
    )
    assert_near(result["actuation"][-1], command, 1e-5)


def measured(truss, hardware, seed, duration):
    """Return the outputs of the sensors of a truss that moves evenly."""
    sensors = hardware.sensors(truss, seed=seed)
    coordinates = Ramp(
        np.linspace(0.01, 0.02, truss.n), initial_value=truss.dynamics.rest
    )
    speeds = Constant(np.linspace(-0.1, 0.1, truss.n))
    names = ("task_position", "task_velocity", "rigid_speeds")
    log = {name: sensors.port(name) for name in names} | {
        "coordinates": coordinates.y,
        "speeds": speeds.y,
    }
    sources = {"coordinates": coordinates, "speeds": speeds}
    return simulate_block(sensors, duration, sources, step=STEP, log=log)


def test_sensors_show_the_truth_with_their_noise(truss):
    result = measured(truss, Hardware.flight(control="torque"), 1, 60.0)
    for shown, true in (("task_position", "coordinates"), ("rigid_speeds", "speeds")):
        error = (result[shown].values - result[true].values[:, : truss.rigid])[
            :-1
        ] / 1e-4
        count = len(error)
        assert_allclose(error.std(axis=0), 1.0, rtol=4.5 / np.sqrt(2 * count))
        assert_near(np.corrcoef(error.T), np.eye(truss.rigid), 5 / np.sqrt(count))
    # The task velocity follows from the measured signals.
    q, v = (
        np.pad(result[name], ((0, 0), (0, truss.n - truss.rigid)))
        for name in ("task_position", "rigid_speeds")
    )
    velocity = np.array(list(map(truss.dynamics.kinematics, q, v)))[:, : truss.rigid]
    assert_near(result["task_velocity"], velocity, 1e-12)


def test_noise_is_that_of_the_seed(truss):
    first, again, other = (
        measured(truss, Hardware.flight(control="torque"), s, 0.2)[
            "task_position"
        ].values
        for s in (1, 1, 2)
    )
    assert_array_equal(first, again)
    assert np.abs(first - other).min() > 1e-9


def test_sensors_start_at_rest(truss):
    """Before its first late sample the output of a sensor is the posture at rest, not zero."""
    late = Measurement(sample_time=STEP, delay=0.04)
    hardware = replace(Hardware.flight(control="torque"), encoder=late, metrology=late)
    result = measured(truss, hardware, 1, 0.2)
    assert_array_equal(
        result["task_position"][1, 6:], truss.dynamics.rest[6 : truss.rigid]
    )


@pytest.mark.parametrize(
    "duration, least_speed", [(0.1, 8e-6), campaign.only(3.0, 2e-3)]
)
def test_ideal_hardware_does_not_change_the_transport_loop(duration, least_speed):
    """Ports, units, signs and order: the difference is the motion of about a millisecond."""
    paths = []
    for hardware in (None, Hardware.exact(1e-3)):
        truss = SpaceTruss.published(modes=0)
        diagram = transport_diagram(Mission.of_case(1), truss, hardware=hardware)
        log = {"position": truss.task_position, "velocity": truss.task_velocity}
        paths.append(simulate(diagram, duration, log=log, step=1e-3, log_step=0.1))
    speed = np.abs(paths[0]["velocity"]).max()
    assert speed > least_speed
    difference = np.abs(paths[1]["position"] - paths[0]["position"]).max()
    assert difference < 2e-3 * speed

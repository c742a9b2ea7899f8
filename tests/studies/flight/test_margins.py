"""Margins of the flown loop: the linear map is the derivative of the flight, with the thrust on."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from flight.loops import with_arms
from flight.margins import (
    VARIATIONS,
    first_unstable,
    loop_diagram,
    loops_along,
    margins_of,
    min_disk,
)
from flight.sampled_loop import spectral_radius

from trussflow.blocks import Session
from trussflow.models import Hardware, SpaceTruss
from trussflow.models.transport import Mission, mean_axes_transport

# The paper's path of 60 s, scaled down in time and, with the same accelerations, in displacement.
DURATION = 6.0  # s
MISSION = replace(
    Mission.of_case(1), position=np.array([0.0, 0.0, 0.06]), duration=DURATION
)


@pytest.fixture(scope="module")
def session():
    return Session(
        mean_axes_transport(MISSION, SpaceTruss.consistent()), outputs=[], step=2e-3
    )


@pytest.fixture(scope="module")
def loops(session):
    """Return the loop at two instants, and what the flight was there."""
    instants = {"at rest": 0.0, "peak acceleration": 0.2113}
    # of no account
    along = loops_along(session, DURATION, {"controller.probe.strength": 1.0}, instants)
    return {name: (loop, session.save()) for name, loop in along}


def test_arms_buckle_under_thrust_and_are_held(loops):
    """Without thrust nothing leaves rest by itself; at 3.4 N joints leave at 21 1/s, and the loop holds."""
    fastest = [np.linalg.eigvals(loop.plant.A).real.max() for loop, _ in loops.values()]
    assert fastest == pytest.approx([0.0, 21.2], rel=0.02, abs=0.01)
    assert all(spectral_radius(loop.closed()) < 1.0 for loop, _ in loops.values())


@pytest.mark.parametrize("instant", ["at rest", "peak acceleration"])
def test_the_map_predicts_the_flight(session, loops, instant, rng):
    """A pushed flight leaves the other as the map says: the error falls with the square of the push."""
    loop, start = loops[instant]
    plan = session.prepared.plan
    states = ("y", "nu", "eta", "eta_rate", "w", "posture")
    own = np.r_[
        : start.x.size, *(plan.place("controller.estimator", name) for name in states)
    ]
    pushed = rng.standard_normal(own.size)

    def flown(size):
        z = np.concatenate([start.x, start.d])
        z[own] += size * pushed
        session.restore(replace(start, x=z[: start.x.size], d=z[start.x.size :]))
        session.advance(float(start.now) + 0.02)
        now = session.save()
        return np.concatenate([now.x, now.d])[own]

    errors = []
    for size in 1e-5 * 0.5 ** np.arange(4):
        # at rest the feedback may not ask for much thrust
        found = (flown(size) - flown(0.0)) / size
        errors.append(np.abs(found - loop.closed() @ pushed).max())
    slopes = np.diff(np.log2(errors))
    assert np.abs(slopes + 1.0).max() < 0.1


def test_margins_of_one_loop(loops):
    """The loop is stable up to the delay, and not beyond; growth is the logarithm of the spectral radius."""
    loop = loops["peak acceleration"][0]
    found = margins_of(loop)
    growth = dict(zip(VARIATIONS, found["growth"], strict=True))
    assert growth["nominal"] == np.log(spectral_radius(loop.closed())) / 0.02 < 0.0
    assert 0.0 < found["delay"] < 0.05
    for delay, stable in (
        (0.98 * found["delay"], True),
        (1.02 * found["delay"], False),
    ):
        assert (spectral_radius(loop.closed(delay=delay)) < 1.0) == stable
    assert found["disk"] == min_disk(loop) < min_disk(loops["at rest"][0])


def test_arms_of_other_mass_and_length():
    """Masses scale together; an arm of another length reaches as far as it is long."""
    dynamics = SpaceTruss.consistent().dynamics
    for before, after in zip(
        dynamics.arms, with_arms(dynamics, mass=1.05, length=0.95).arms, strict=True
    ):
        assert after.masses == pytest.approx(1.05 * before.masses, rel=1e-12)
        assert after.joint_origins == pytest.approx(
            0.95 * before.joint_origins, rel=1e-12
        )
        assert after.base_mass == before.base_mass


def test_the_first_unstable_value_is_found_up_and_down():
    values = np.arange(0.0, 5.0)
    assert first_unstable(lambda v: v / 2.5, values) == pytest.approx(2.5, abs=0.01)
    assert first_unstable(lambda v: 2.5 / (5.0 - v), values) == pytest.approx(
        2.5, abs=0.01
    )
    assert first_unstable(lambda v: 1.5 - v, values[::-1]) == pytest.approx(
        0.5, abs=0.01
    )
    assert first_unstable(lambda _: 0.5, values) == np.inf
    assert first_unstable(lambda _: 1.5, values) == 0.0


@pytest.fixture(scope="module")
def servo_loop():
    """Return the linear loop with the servo under peak thrust, its session, and the state there."""
    servo = Hardware.flight().servo
    truss = Hardware.flight().mounted(SpaceTruss.consistent())
    session = Session(loop_diagram(MISSION, truss), outputs=[], step=2e-3)
    instants = {"peak acceleration": 0.2113}
    ((_, loop),) = loops_along(session, DURATION, None, instants, servo)
    return loop


def test_a_servo_removes_the_limits_of_gain_and_delay(servo_loop):
    """Rotors slow the buckling to 2 1/s; the loop then bears gains of 0.5 to 2 and 40 ms, all in the table."""
    assert np.linalg.eigvals(servo_loop.plant.A).real.max() < 2.1
    found = margins_of(servo_loop)
    assert max(found["growth"]) < 0.0
    assert found["disk"] > 0.3
    assert found["delay"] > 0.04


def test_the_servo_of_the_map_is_that_of_the_hardware(servo_loop):
    """One sample time of plant and servo, simulated step by step with held commands."""
    plant, servo = servo_loop.plant, servo_loop.servo
    flow, driven = servo_loop.flow(0.02, np.ones(plant.ninputs))
    rng = np.random.default_rng(1)
    state, command = rng.standard_normal(len(flow)), rng.standard_normal(plant.ninputs)
    state = servo_loop.restart @ state
    expected = flow @ state + driven @ command
    joints = servo_loop.joints
    x, torque, mean = state[:-joints], state[-joints:], 0.0
    step = scipy.linalg.expm(
        1e-3
        * np.block(
            [[plant.A, plant.B], [np.zeros((plant.ninputs, sum(plant.B.shape)))]]
        )
    )
    for _ in range(20):
        mean = mean + (torque - command[-joints:]) / 20.0
        acting = np.concatenate([command[:-joints], torque])
        angles, rates = (
            (plant.C @ x)[6 : 6 + joints],
            (plant.C @ x)[12 + joints :][:joints],
        )
        torque = (
            command[-joints:]
            - servo.proportional_gain * angles
            - servo.derivative_gain * rates
        )
        x = (step @ np.concatenate([x, acting]))[: len(x)]
    measured = servo_loop.measurement @ expected
    np.testing.assert_allclose(measured[-joints:], mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(expected[-joints:], torque, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        measured[:-joints], (plant.C @ x)[:-joints], rtol=0, atol=1e-9
    )

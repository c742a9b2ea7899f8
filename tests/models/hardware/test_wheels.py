"""Reaction wheels keep momentum, and their limits."""

from typing import Any

import numpy as np
import pytest

from trussflow.blocks import BlockError, Constant, Diagram, Noise, ParameterError, Ramp, Sine, simulate
from trussflow.models import ModelError, ReactionWheels
from trussflow.models.geometry.rotation import fixed_rotation

STEP = 0.1
TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3)
ROUND_OFF = 1e-12


def spin(wheels, duration, initial=None, **inputs):
    """Return what wheels do, sample by sample."""
    diagram = Diagram("test")
    diagram.add(wheels=wheels)
    for name, source in inputs.items():
        diagram.add(**{f"{name}_source": source}).y >> wheels.port(name)
    settings: dict[str, Any] = {"step": STEP, "log_step": STEP, "backend": "interpreted", "progress": False}
    return simulate(
        diagram, duration, initial={"wheels.h": initial} if initial is not None else {}, **settings
    )


def given_away(result):
    """Return the angular impulse on the base until each sample."""
    return np.cumsum(result["wheels.torque"].values[:-1], axis=0) * STEP


@pytest.mark.parametrize("axes", [np.eye(3), TETRAHEDRON])
@pytest.mark.parametrize("friction", [{}, {"viscous": 0.02, "coulomb": 0.05}])
def test_momentum_is_conserved(axes, friction):
    """What the base gets the wheels lose: with limits, friction, saturation, all the same."""
    wheels = ReactionWheels(axes, STEP, torque=0.5, momentum=0.8, **friction)
    result = spin(wheels, 50.0, demand=Noise([0.5, 0.3, 0.4], STEP, seed=1, mean=[0.1, 0.0, -0.1]))
    momentum = result["wheels.momentum"].values
    np.testing.assert_allclose(given_away(result) + momentum[1:] @ axes, 0.0, rtol=0, atol=ROUND_OFF)
    assert np.abs(np.diff(momentum, axis=0)).max() <= (0.5 + 0.02 * 0.8 + 0.05) * STEP + ROUND_OFF
    assert np.abs(momentum).max() == pytest.approx(0.8, abs=ROUND_OFF)  # the limit is reached, not passed


def test_torque_is_the_one_wanted_within_limits():
    wanted = [0.2, -0.1, 0.3]
    for axes in (np.eye(3), TETRAHEDRON):
        result = spin(ReactionWheels(axes, STEP, torque=0.5, momentum=50.0), 5.0, demand=Constant(wanted))
        np.testing.assert_allclose(result["wheels.torque"], np.tile(wanted, (51, 1)), rtol=0, atol=ROUND_OFF)
    result = spin(ReactionWheels(np.eye(3), STEP, torque=0.15, momentum=50.0), 5.0, demand=Constant(wanted))
    np.testing.assert_allclose(result["wheels.torque"][-1], [0.15, -0.1, 0.15], rtol=0, atol=ROUND_OFF)


def test_friction_slows_down_and_stops():
    """Viscous: by a constant factor a sample. Coulomb: by a constant amount, to rest, and stays there."""
    start = [1.0, -1.0, 0.5]
    still = Constant(np.zeros(3))
    result = spin(
        ReactionWheels(np.eye(3), STEP, torque=1, momentum=2, viscous=0.3), 5.0, start, demand=still
    )
    expected = np.outer(1.03 ** -np.arange(51.0), start)
    np.testing.assert_allclose(result["wheels.momentum"], expected, rtol=0, atol=ROUND_OFF)
    still = Constant(np.zeros(3))
    result = spin(
        ReactionWheels(np.eye(3), STEP, torque=1, momentum=2, coulomb=0.35), 5.0, start, demand=still
    )
    expected = np.sign(start) * np.maximum(np.abs(start) - 0.035 * np.arange(51)[:, None], 0.0)
    np.testing.assert_allclose(result["wheels.momentum"], expected, rtol=0, atol=ROUND_OFF)


def test_motors_below_friction_do_not_turn_a_wheel():
    wheels = ReactionWheels(np.eye(3), STEP, torque=1.0, momentum=2.0, coulomb=0.05)
    result = spin(wheels, 5.0, demand=Sine([0.049, 0.0, 0.06], 0.2))
    assert abs(result["wheels.momentum"][:, 0]).max() == 0.0
    assert abs(result["wheels.momentum"][:, 2]).max() > 0.001


def test_unloading_gives_momentum_away_and_says_how_much():
    start, rate = [1.0, -0.5, 0.2], 0.2
    wheels = ReactionWheels(np.eye(3), STEP, torque=1.0, momentum=2.0)
    result = spin(wheels, 20.0, start, demand=Constant([0.1, 0.0, 0.0]), unloading=Constant(rate))
    h = result["wheels.momentum"].values
    np.testing.assert_allclose(result["wheels.unloading_torque"], rate * h, rtol=0, atol=ROUND_OFF)
    extra = result["wheels.torque"] - result["wheels.unloading_torque"]
    np.testing.assert_allclose(extra, np.tile([0.1, 0, 0], (201, 1)), rtol=0, atol=ROUND_OFF)
    np.testing.assert_allclose(h[:, 1], -0.5 * 0.98 ** np.arange(201), rtol=0, atol=ROUND_OFF)


def test_a_turning_base_feels_the_momentum_that_it_turns():
    """In inertial axes, R A h and the integral of R times the torque cancel, to first order in the step."""
    omega, drifts = 0.4, []
    for step in (0.02, 0.01):
        diagram = Diagram("test")
        wheels, demand, turn, _ = diagram.add(
            wheels=ReactionWheels(np.eye(3), step, torque=1.0, momentum=9.0),
            demand=Sine([0.3, 0.2, 0.1], 0.3),
            turn=Constant([0.0, 0.0, omega]),
            angle=Ramp(omega),
        )
        demand.y >> wheels.demand
        turn.y >> wheels.angular_velocity
        settings: dict[str, Any] = {
            "step": step,
            "log_step": step,
            "backend": "interpreted",
            "progress": False,
        }
        result = simulate(diagram, 5.0, **settings)
        rotations = np.array([fixed_rotation(np.array([0.0, 0.0, a])) for a in result["angle.y"].values])
        given = (
            np.cumsum(np.einsum("tij,tj->ti", rotations, result["wheels.torque"].values)[:-1], axis=0) * step
        )
        stored = np.einsum("tij,tj->ti", rotations, result["wheels.momentum"].values)[1:]
        drifts.append(np.abs(given + stored).max())
    assert drifts[1] < 0.01
    assert drifts[0] / drifts[1] == pytest.approx(2.0, abs=0.2)


def test_dead_motors_give_no_torque():
    wheels = ReactionWheels(np.eye(3), STEP, torque=1.0, momentum=2.0)
    result = spin(wheels, 1.0, demand=Constant([0.1, 0.2, 0.3]), effectiveness=Constant(0.0))
    assert abs(result["wheels.torque"]).max() == 0.0


def test_nonsense_is_refused():
    with pytest.raises(
        ModelError, match=r"none turns about the direction \[.*0.0, .*0.0, .*1.0\]; add a wheel"
    ):
        ReactionWheels([[1, 0, 0], [0, 1, 0]], STEP, torque=1.0, momentum=1.0)
    with pytest.raises(ModelError, match=r"reaction wheels: axis 2 has length 2; it must be"):
        ReactionWheels(np.diag([1.0, 1.0, 2.0]), STEP, torque=1.0, momentum=1.0)
    with pytest.raises(ParameterError, match=r"'maximum_torque' of ReactionWheels is -1.0 .element 1."):
        ReactionWheels(np.eye(3), STEP, torque=[1, -1, 1], momentum=1.0)
    with pytest.raises(BlockError, match=r"cannot sample 'ReactionWheels' every 0.0 s"):
        ReactionWheels(np.eye(3), 0.0, torque=1.0, momentum=1.0)

"""Reaction wheels keep momentum, and their limits."""

import numpy as np
import pytest
from systems import assert_near, simulate_block

from trussflow.blocks import Constant, Noise, Sine
from trussflow.blocks.errors import TrussflowError
from trussflow.models import ReactionWheels

STEP = 0.1
TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3)
ROUND_OFF = 1e-12


def spin(wheels, duration, initial=None, **sources):
    """Simulate wheels, logged at each sample."""
    start = {} if initial is None else {"block.h": initial}
    return simulate_block(wheels, duration, sources, step=STEP, initial=start)


def given_away(result):
    """Return the angular impulse on the base until each sample."""
    return np.cumsum(result["block.torque"].values[:-1], axis=0) * STEP


@pytest.mark.parametrize("axes", [np.eye(3), TETRAHEDRON])
@pytest.mark.parametrize("friction", [{}, {"viscous": 0.02, "coulomb": 0.05}])
def test_momentum_is_conserved(axes, friction):
    """The base gains what the wheels lose, with limits, friction and saturation as without."""
    wheels = ReactionWheels(axes, STEP, torque=0.5, momentum=0.8, **friction)
    result = spin(
        wheels, 50.0, demand=Noise([0.5, 0.3, 0.4], STEP, seed=1, mean=[0.1, 0.0, -0.1])
    )
    momentum = result["block.momentum"].values
    assert_near(given_away(result) + momentum[1:] @ axes, 0.0, ROUND_OFF)
    assert (
        np.abs(np.diff(momentum, axis=0)).max()
        <= (0.5 + 0.02 * 0.8 + 0.05) * STEP + ROUND_OFF
    )
    # the limit is reached, not passed
    assert np.abs(momentum).max() == pytest.approx(0.8, abs=ROUND_OFF)


def test_torque_is_the_one_wanted_within_limits():
    wanted = [0.2, -0.1, 0.3]
    for axes in (np.eye(3), TETRAHEDRON):
        result = spin(
            ReactionWheels(axes, STEP, torque=0.5, momentum=50.0),
            5.0,
            demand=Constant(wanted),
        )
        assert_near(result["block.torque"], np.tile(wanted, (51, 1)), ROUND_OFF)
    result = spin(
        ReactionWheels(np.eye(3), STEP, torque=0.15, momentum=50.0),
        5.0,
        demand=Constant(wanted),
    )
    assert_near(result["block.torque"][-1], [0.15, -0.1, 0.15], ROUND_OFF)


def test_friction_slows_down_and_stops():
    """Viscous: by a constant factor a sample. Coulomb: by a constant amount, to rest, and stays there."""
    start, samples = [1.0, -1.0, 0.5], np.arange(51.0)[:, None]
    for friction, expected in (
        ({"viscous": 0.3}, 1.03**-samples * start),
        (
            {"coulomb": 0.35},
            np.sign(start) * np.maximum(np.abs(start) - 0.035 * samples, 0.0),
        ),
    ):
        wheels = ReactionWheels(np.eye(3), STEP, torque=1, momentum=2, **friction)
        result = spin(wheels, 5.0, start, demand=Constant(np.zeros(3)))
        assert_near(result["block.momentum"], expected, ROUND_OFF)


def test_motors_below_friction_do_not_turn_a_wheel():
    wheels = ReactionWheels(np.eye(3), STEP, torque=1.0, momentum=2.0, coulomb=0.05)
    result = spin(wheels, 5.0, demand=Sine([0.049, 0.0, 0.06], 0.2))
    assert abs(result["block.momentum"][:, 0]).max() == 0.0
    assert abs(result["block.momentum"][:, 2]).max() > 0.001


def test_unloading_gives_momentum_away_and_says_how_much():
    start, rate = [1.0, -0.5, 0.2], 0.2
    wheels = ReactionWheels(np.eye(3), STEP, torque=1.0, momentum=2.0)
    result = spin(
        wheels, 20.0, start, demand=Constant([0.1, 0.0, 0.0]), unloading=Constant(rate)
    )
    h = result["block.momentum"].values
    assert_near(result["block.unloading_torque"], rate * h, ROUND_OFF)
    extra = result["block.torque"] - result["block.unloading_torque"]
    assert_near(extra, np.tile([0.1, 0, 0], (201, 1)), ROUND_OFF)
    assert_near(h[:, 1], -0.5 * 0.98 ** np.arange(201), ROUND_OFF)


def test_dead_motors_give_no_torque():
    wheels = ReactionWheels(np.eye(3), STEP, torque=1.0, momentum=2.0)
    result = spin(
        wheels, 1.0, demand=Constant([0.1, 0.2, 0.3]), effectiveness=Constant(0.0)
    )
    assert abs(result["block.torque"]).max() == 0.0


@pytest.mark.parametrize(
    "axes, settings, message",
    [
        (
            np.eye(3)[:2],
            {},
            r"none has a torque along \[.*0.0, .*0.0, .*1.0\]; add a wheel",
        ),
        (
            np.diag([1.0, 1.0, 2.0]),
            {},
            r"reaction wheels: axis 2 has length 2; it must be",
        ),
        (
            np.eye(3),
            {"torque": [1, -1, 1]},
            r"'maximum_torque' of ReactionWheels is -1.0 .element 1.",
        ),
        (
            np.eye(3),
            {"sample_time": 0.0},
            r"cannot sample 'ReactionWheels' every 0.0 s",
        ),
    ],
)
def test_errors(axes, settings, message):
    with pytest.raises(TrussflowError, match=message):
        ReactionWheels(
            axes, **{"sample_time": STEP, "torque": 1.0, "momentum": 1.0} | settings
        )

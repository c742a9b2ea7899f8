"""Input shaping: a shaped motion leaves the mode at rest, and says so of itself."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import assert_near

from trussflow.blocks import (
    Diagram,
    Quintic,
    ShapedTrajectory,
    StateSpace,
    Trapezoid,
    Waypoints,
    simulate,
)

FREQUENCY = 0.4  # Hz
SOLVED = 1e-9  # of the deflection on the way, at tolerances of 1e-11


def left_over(trajectory, end, frequency, damping):
    """Return the energy of an oscillator on a base that moves so, at the end, over the greatest before."""
    omega = 2.0 * np.pi * frequency
    base = StateSpace(
        [[0.0, 1.0], [-(omega**2), -2.0 * damping * omega]],
        [[0.0], [-1.0]],
        [[omega, 0.0], [0.0, 1.0]],
    )
    diagram = Diagram("oscillator")
    moves, hangs = diagram.add(moves=trajectory, hangs=base)
    moves.acceleration >> hangs.u[0]
    result = simulate(
        diagram,
        end,
        solver="DOP853",
        rtol=1e-11,
        atol=1e-13,
        log=[hangs.y],
        log_step=end / 200.0,
    )
    size = np.linalg.norm(result["hangs.y"], axis=1)
    return size[-1] / size.max()


def motions():
    return [
        Quintic(2.0, duration=2.0),
        Trapezoid(2.0, max_velocity=0.9, max_acceleration=0.8),
        Waypoints([0.0, 1.0, 2.5, 3.0], [0.0, 1.5, 1.0, 2.0], stop=False),
    ]


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize(
    "kind, damping", [("ZV", 0.0), ("ZVD", 0.0), ("ZV", 0.05), ("ZVD", 0.05)]
)
def test_no_vibration_is_left(number, kind, damping):
    plain = motions()[number]
    shaped = ShapedTrajectory(motions()[number], FREQUENCY, damping=damping, kind=kind)
    end = shaped.breakpoints()[-1]
    assert left_over(shaped, end, FREQUENCY, damping) < SOLVED
    assert left_over(plain, end, FREQUENCY, damping) > 1e-3


@pytest.mark.parametrize("kind, order", [("ZV", 1), ("ZVD", 2)])
def test_residual_vibration_by_a_wrong_frequency(kind, order):
    """The residual is the fraction |cos(pi/2 f/F)|^n, of first order with ZV and of second with ZVD."""

    def residual(error):
        shaped = ShapedTrajectory(Quintic(2.0, duration=2.0), FREQUENCY, kind=kind)
        return left_over(shaped, 6.0, FREQUENCY * (1.0 + error), 0.0)

    assert np.log2(residual(0.02) / residual(0.01)) == pytest.approx(order, abs=0.1)


def test_it_ends_where_the_trajectory_ends_half_periods_later(respond):
    shaped = ShapedTrajectory(
        Quintic([1.0, -2.0], duration=2.0, start=[0.5, 0.0]), FREQUENCY
    )
    assert shaped.breakpoints() == pytest.approx(
        (0.0, 1.25, 2.0, 2.5, 3.25, 4.5), rel=1e-12
    )
    result = respond(shaped, 5.0)
    assert_allclose(result["block.position"][-1], [1.5, -2.0], rtol=1e-12)
    rate = np.gradient(result["block.position"], 0.01, axis=0)
    assert_near(result["block.velocity"], rate, 2e-3)

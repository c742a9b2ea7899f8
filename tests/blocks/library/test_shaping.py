"""Input shaping: a shaped motion leaves the mode at rest, and says so of itself."""

import numpy as np
import pytest

from trussflow.blocks import Diagram, Quintic, ShapedTrajectory, StateSpace, Trapezoid, Waypoints, simulate

FREQUENCY = 0.4  # Hz
SOLVED = 1e-9  # of the deflection on the way, at tolerances of 1e-11


def left_over(trajectory, end, frequency, damping):
    """Return the energy of an oscillator on a base that moves so, at the end, over the greatest before."""
    omega = 2.0 * np.pi * frequency
    base = StateSpace(
        [[0.0, 1.0], [-(omega**2), -2.0 * damping * omega]], [[0.0], [-1.0]], [[omega, 0.0], [0.0, 1.0]]
    )
    diagram = Diagram("oscillator")
    moves, hangs = diagram.add(moves=trajectory, hangs=base)
    moves.acceleration >> hangs.u[0]
    result = simulate(
        diagram, end, solver="DOP853", rtol=1e-11, atol=1e-13, log=[hangs.y], log_step=end / 200.0
    )
    size = np.linalg.norm(result["hangs.y"], axis=1)
    return float(size[-1] / size.max())


def motions():
    return [
        Quintic(2.0, duration=2.0),
        Trapezoid(2.0, max_velocity=0.9, max_acceleration=0.8),
        Waypoints([0.0, 1.0, 2.5, 3.0], [0.0, 1.5, 1.0, 2.0], stop=False),
    ]


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize(("kind", "damping"), [("ZV", 0.0), ("ZVD", 0.0), ("ZV", 0.05), ("ZVD", 0.05)])
def test_no_vibration_is_left(number, kind, damping):
    plain, shaped = (
        motions()[number],
        ShapedTrajectory(motions()[number], FREQUENCY, damping=damping, kind=kind),
    )
    end = shaped.breakpoints()[-1]
    assert left_over(shaped, end, FREQUENCY, damping) < SOLVED
    assert left_over(plain, end, FREQUENCY, damping) > 1e-3


def test_zvd_forgives_a_wrong_frequency():
    """What is left is |cos(pi/2 f/F)|^n of it: of the first order with ZV, of the second with ZVD."""
    for kind, order in (("ZV", 1), ("ZVD", 2)):
        left = [
            left_over(
                ShapedTrajectory(Quintic(2.0, duration=2.0), FREQUENCY, kind=kind),
                6.0,
                FREQUENCY * (1.0 + wrong),
                0.0,
            )
            for wrong in (0.01, 0.02)
        ]
        assert np.log2(left[1] / left[0]) == pytest.approx(order, abs=0.1)


def test_it_ends_where_the_trajectory_ends_half_periods_later():
    shaped = ShapedTrajectory(Quintic([1.0, -2.0], duration=2.0, start=[0.5, 0.0]), FREQUENCY)
    assert shaped.breakpoints() == pytest.approx((0.0, 1.25, 2.0, 2.5, 3.25, 4.5), rel=1e-12)
    diagram = Diagram("alone")
    (moves,) = [diagram.add(moves=shaped)]
    result = simulate(diagram, 5.0, step=0.01)
    assert result["moves.position"][-1].values == pytest.approx([1.5, -2.0], rel=1e-12)
    rate = np.gradient(result["moves.position"].values[:, 0], 0.01)
    assert result["moves.velocity"].values[:, 0] == pytest.approx(rate, abs=1e-3)
    assert moves.position.shape == (2,)

"""Delay margins and longest control periods, against exact stability limits."""

import control
import numpy as np
import pytest

from trussflow.blocks import (
    Diagram,
    DiscreteStateSpace,
    Gain,
    StateSpace,
    TransportDelay,
    UnitDelay,
    delay_margin,
    frequency_response,
    largest_sample_time,
    linearize,
)
from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.linear_analysis.frequency.delays import sampled_loop_radius

INTEGRATOR = control.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]])
SAMPLED = control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1)
LAG = control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]])


def static(gain):
    return control.ss([], [], [], np.atleast_2d(gain))


@pytest.mark.parametrize("gain", [1e-3, 1.0, 250.0])
def test_an_integrator_stands_a_quarter_of_a_turn(gain):
    delay, omega = delay_margin(gain * INTEGRATOR)
    assert delay == pytest.approx(np.pi / 2 / gain, rel=1e-9)
    assert omega == pytest.approx(gain, rel=1e-9)


def test_the_smallest_delay_of_several_crossings_counts():
    """A light mode crosses twice, far above the crossover of the rigid body."""
    mode = control.tf2ss([0.02, 0.0], [1.0, 2e-5 * 30, 900.0])
    loop = 1.0 * INTEGRATOR + mode
    delay, omega = delay_margin(loop)
    gain = loop(1j * omega)
    assert abs(gain) == pytest.approx(1.0, abs=1e-6)
    assert abs(omega - 30.0) < 0.1
    assert gain * np.exp(-1j * omega * delay) == pytest.approx(-1.0, abs=1e-6)
    assert delay < np.pi / 2 / 25
    narrow = delay_margin(
        1.0 * INTEGRATOR + control.tf2ss([1e-4, 0.0], [1.0, 6e-5, 37.3**2])
    )
    assert abs(narrow[1] - 37.3) < 0.1  # a peak a millionth wide
    coarse = delay_margin(loop, omega=np.geomspace(0.1, 10, 50))
    # where one does not look, nothing is seen
    assert coarse[1] == pytest.approx(1.0, rel=1e-3)


def test_gains_of_a_matrix_are_its_eigenvalues():
    """Two loops, coupled by a rotation: eigenvalues k e^(+-ja) / s; the worse turn counts."""
    for angle in (0.0, 0.4, 1.2):
        rotation = 2 * np.array(
            [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        )
        loop = control.ss(np.zeros((2, 2)), np.eye(2), rotation, np.zeros((2, 2)))
        delay, omega = delay_margin(loop)
        assert omega == pytest.approx(2.0, rel=1e-9)
        assert delay == pytest.approx((np.pi / 2 - angle) / 2, rel=1e-8)


def test_loops_that_no_delay_harms_and_loops_that_any_does():
    delay, omega = delay_margin(control.tf2ss([0.5], [1.0, 1.0]))
    assert np.isinf(delay)
    assert np.isnan(omega)
    assert delay_margin(static(0.9))[0] == np.inf
    assert delay_margin(static(2.0)) == (0.0, np.inf)
    assert delay_margin(control.tf2ss([1.5, 1.0], [1.0, 1.0])) == (0.0, np.inf)
    marginal = control.ss(
        [[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]
    )
    assert delay_margin(marginal)[0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("D", [[[0.5]], [[-0.5]], [[0.3, 0.2], [-0.4, 0.1]]])
def test_delay_margin_with_direct_feedthrough(D):
    """With that delay, exact, a closed pole is on the imaginary axis; with 2 % less or more, beside it."""
    m = len(D)
    A, B, C = -np.eye(m) - np.eye(m, k=1), np.eye(m), 3.0 * np.eye(m)
    margin, omega = delay_margin(control.ss(A, B, C, D))
    for part in (0.98, 1.0, 1.02):
        diagram = Diagram("late")
        plant, late, back = diagram.add(
            plant=StateSpace(A, B, C, D),
            late=TransportDelay(part * margin, np.zeros(m), pade=10),
            back=Gain(-np.ones(m)),
        )
        plant >> late >> back >> plant
        wire = {"inputs": back.y, "outputs": back.y}
        if part == 1.0:
            L = -frequency_response(diagram, **wire, cut=back.y, omega=[omega]).frdata[
                :, :, 0
            ]
            assert np.abs(np.linalg.eigvals(L) + 1.0).min() < 1e-8
        else:
            assert (linearize(diagram, **wire).poles().real.max() < 0.0) == (part < 1.0)


# -- longest periods -------------------------------------------------------------------------------


@pytest.mark.parametrize("gain", [0.5, 20.0])
@pytest.mark.parametrize("delay", [0.0, 0.25, 0.4, 0.6, 0.9, 1.0])
def test_an_integrator_with_a_held_gain(gain, delay):
    """With k = gain T, z^2 - (1 - k (1 - d)) z + k d is stable while k d < 1 and k (1 - 2 d) < 2."""
    limit = 1 / (gain * max(delay, 0.5 - delay))
    found = largest_sample_time(INTEGRATOR, static(-gain), delay=delay)
    assert found == pytest.approx(limit, rel=1.1e-3)
    assert found <= limit


def test_a_first_order_plant():
    """x+ = a x - k (1 - a) x with a = e^-T: stable to a = (k - 1) / (k + 1)."""
    found = largest_sample_time(LAG, static(-5.0))
    assert found == pytest.approx(-np.log(4 / 6), rel=1.1e-3)
    assert largest_sample_time(LAG, static(-0.9)) == np.inf


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.8, 1.0])
def test_the_radius_with_a_part_of_a_period_of_delay_and_a_lag(delay):
    """The command before acts for a part of the period, and what it did decays in the rest."""
    k, period = 2.5, 0.7
    rest, first = np.exp(-(1 - delay) * period), np.exp(-delay * period)
    polynomial = [1, -(first * rest - k * (1 - rest)), k * rest * (1 - first)]
    radius = sampled_loop_radius(LAG, static(-k), period, delay)
    assert radius == pytest.approx(np.abs(np.roots(polynomial)).max(), rel=1e-12)


def test_the_radius_is_that_of_the_diagram_that_is_described():
    """The lifted model of plant, controller with states, hold and one period of delay."""
    plant = control.ss([[0, 1], [-4, -0.2]], [[0], [1]], [[1, 0]], [[0]])
    law = control.ss([[-3.0]], [[1.0]], [[4.0]], [[-6.0]])
    period = 0.15
    for delay in (0.0, 1.0):
        discrete = control.c2d(law, period, "zoh")
        diagram = Diagram()
        body, controller = diagram.add(
            body=StateSpace(plant.A, plant.B, plant.C),
            controller=DiscreteStateSpace(
                discrete.A, discrete.B, discrete.C, discrete.D, sample_time=period
            ),
        )
        body >> controller
        if delay:
            controller >> diagram.add(late=UnitDelay(period)) >> body
        else:
            controller >> body
        poles = linearize(diagram, "body.u", "body.y").poles()
        radius = sampled_loop_radius(plant, law, period, delay)
        assert radius == pytest.approx(np.abs(poles).max(), rel=1e-10)


def test_a_loop_that_is_unstable_at_any_period_gets_zero():
    assert largest_sample_time(INTEGRATOR, static(1.0)) == 0.0


@pytest.mark.parametrize(
    ("loop", "message"),
    [
        (-2.0 * LAG, r"has no margins: .* unstable poles 1"),
        (
            control.ss([[-1.0]], [[1.0]], [[1.0], [2.0]], 0),
            r"as many outputs as inputs, not 2 and 1",
        ),
        (SAMPLED, r"the loop must be a continuous model"),
    ],
)
def test_loops_without_a_delay_margin_are_refused(loop, message):
    with pytest.raises(LinearAnalysisError, match=message):
        delay_margin(loop)


@pytest.mark.parametrize(
    ("plant", "gain", "change", "message"),
    [
        (SAMPLED, -1.0, {}, r"the plant must be a continuous model"),
        (LAG, [1.0, 2.0], {}, r"a plant with 1 inputs and 1 outputs does not"),
        (
            control.ss([[-1.0]], [[1.0]], [[1.0]], [[1.0]]),
            -1.0,
            {},
            r"feedthrough has an algebraic loop",
        ),
        (LAG, -1.0, {"delay": 1.5}, r"delay = 1.5 must be from 0 to 1 periods"),
        (LAG, -1.0, {"delay": -0.1}, r"delay = -0.1 must be from 0 to 1 periods"),
        (
            LAG,
            -1.0,
            {"shortest": 0.0},
            r"shortest = 0.0, .* the periods must rise from above zero",
        ),
        (
            LAG,
            -1.0,
            {"shortest": 2.0, "longest": 1.0},
            r"longest = 1.0, .* the periods must rise",
        ),
        (LAG, -1.0, {"points": 1}, r"points = 1: the periods must rise"),
    ],
)
def test_loops_without_a_largest_sample_time_are_refused(plant, gain, change, message):
    with pytest.raises(LinearAnalysisError, match=message):
        largest_sample_time(plant, static(gain), **change)

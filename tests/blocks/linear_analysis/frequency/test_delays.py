"""Delay margins and responses with exact delays, against exact stability limits."""

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import ring

from trussflow.blocks import (
    Gain,
    StateSpace,
    TransportDelay,
    delay_margin,
    frequency_response,
    linearize,
)
from trussflow.blocks.errors import LinearAnalysisError

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


def test_the_worst_eigenvalue_of_a_matrix_counts():
    """Two loops, coupled by a rotation, have the eigenvalues k e^(+-ja) / s."""
    k, angle = 2.0, 0.4
    turn = k * np.array(
        [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    )
    delay, _ = delay_margin(control.ss(0 * turn, np.eye(2), turn, 0 * turn))
    assert delay == pytest.approx((np.pi / 2 - angle) / k, rel=1e-8)


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
        diagram = ring(
            plant=StateSpace(A, B, C, D),
            late=TransportDelay(part * margin, np.zeros(m), pade=10),
            back=Gain(-np.ones(m)),
        )
        wire = {"inputs": diagram.back.y, "outputs": diagram.back.y}
        if part == 1.0:
            L = -frequency_response(
                diagram, **wire, cut=diagram.back.y, omega=[omega]
            ).frdata[:, :, 0]
            assert np.abs(np.linalg.eigvals(L) + 1.0).min() < 1e-8
        else:
            assert (linearize(diagram, **wire).poles().real.max() < 0.0) == (part < 1.0)


@pytest.mark.parametrize(
    "loop, message",
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


@pytest.mark.parametrize("omega", [0.0, -1.0, np.nan, np.inf])
def test_bad_frequencies_are_refused(omega):
    with pytest.raises(
        LinearAnalysisError, match=r"omega = .* must be a positive and finite"
    ):
        frequency_response(Gain(1.0), omega=[omega])


def test_undamped_resonances_have_no_response():
    spring = StateSpace([[0.0, 1.0], [-4.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    with pytest.raises(
        LinearAnalysisError, match=r"at 2 rad/s is not finite: undamped resonance"
    ):
        frequency_response(spring, omega=[2.0])
    found = frequency_response(spring, omega=[1.0, 3.0])
    assert_allclose(found.complex, [1 / 3, -1 / 5], rtol=1e-14)
    assert (found.input_labels, found.output_labels) == (["u[0]"], ["y[0]"])

"""The search finds a known worst case, and the proof brackets a known growth rate."""

import control
import numpy as np
import pytest
from flight.sampled_loop import SampledLoop
from flight.worst_case import Member, ascended, box_is_regular, pole_near, proved

STIFFNESS, DAMPING = (0.8, 1.2), (0.1, 0.3)  # of a unit mass [N/m, N·s/m]


def oscillators(s):
    """Return the impedances of an oscillator at the corners of its parameters."""
    return np.array([[[[s + c + k / s]] for c in DAMPING] for k in STIFFNESS])


def test_the_search_finds_the_largest_resonance():
    """A peak of 1 / (2 z k sqrt(1 - z^2)) is largest at the least damping ratio z and stiffness k."""

    def peaks(points):
        z, k = 0.2 + 0.1 * points[:, 0], 1.0 + 0.2 * points[:, 1]
        return 1.0 / (2.0 * z * k * np.sqrt(1.0 - z**2)) - points[:, 2] ** 2

    best = ascended(peaks, 3)
    assert best[:2].tolist() == [-1.0, -1.0]
    assert abs(best[2]) < 0.5


def test_a_diverged_run_is_the_worst():
    def errors(points):
        return np.where(points[:, 0] < 0.0, np.nan, points[:, 0])

    assert ascended(errors, 2)[0] < 0.0


@pytest.mark.parametrize("factor, found", [(0.98, True), (1.02, False)])
def test_the_proof_ends_at_the_slowest_member(factor, found):
    """The slowest oscillator decays with half its damping."""
    omega = np.linspace(0.0, 3.0, 301)
    assert proved(oscillators, factor * DAMPING[0] / 2.0, omega) == found


def test_boxes_without_a_multiplier_are_split():
    ends = np.array([1.0, -2.0]).reshape(2, 1, 1)
    assert box_is_regular(ends + 0.1j)
    assert not box_is_regular(ends)


def test_the_impedance_is_singular_at_the_poles_of_the_sampled_loop():
    """Aliases of a mode at a hundredth of the sampling frequency are small."""
    plant = control.ss([[0, 1], [-9, -0.2]], [[0], [1]], np.eye(2), np.zeros((2, 1)))
    gains = [[-1.0, -0.8]]  # by the sample before
    late = control.ss(np.zeros((2, 2)), np.eye(2), gains, np.zeros((1, 2)), 0.02)
    loop = SampledLoop(plant=plant, controller=late)
    member = Member(loop, np.array([[2.0]]), np.array([[3.0]]))
    pole = member.slowest()
    assert pole.real < -0.3
    start = complex(plant.poles()[0])
    near = pole_near(member.impedance, complex(start.real, abs(pole.imag)))
    assert near == pytest.approx(complex(pole.real, abs(pole.imag)), rel=1e-4)

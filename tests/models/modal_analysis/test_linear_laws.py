"""Laws made linear by describing functions."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import gamma

from trussflow.blocks.framework.errors import SimulationError
from trussflow.models.modal_analysis import Amplitude, linear_law
from trussflow.models.transport import Mission

MISSION = Mission.of_case(1)
INTEGRATED = 1e-3  # the describing function is an integral over samples of a kinked law
ROUND_OFF = 1e-14  # of a few products


def power_gain(exponent, amplitude):
    """Return the describing function of sgn(x) |x|^b, in closed form (Gelb, table 2.3)."""
    ratio = gamma(exponent / 2 + 1) / gamma((exponent + 3) / 2)
    return float(2 / np.sqrt(np.pi) * ratio * amplitude ** (exponent - 1))


@pytest.mark.parametrize(("error", "omega"), [(1e-3, 1.0), (0.1, 1.0), (1e-3, 20.0)])
def test_gains_are_those_of_fractional_powers(error, omega):
    law = linear_law(MISSION, "ismc", 1, Amplitude(error=error, omega=omega))
    beta = MISSION.exponent
    position = MISSION.error_gain * power_gain(beta / (2 - beta), error)
    velocity = MISSION.rate_gain * power_gain(beta, error * omega)
    assert_allclose(law.B, [[position, velocity]], rtol=INTEGRATED)


def test_gain_falls_with_the_amplitude():
    gains = [abs(linear_law(MISSION, "smc", 1, Amplitude(error=a)).D[0, 0]) for a in (1e-3, 1e-2)]
    # For errors alone: the slope, and a relay of gain 4 eta / (pi a slope) about it.
    relay = 4 * MISSION.conventional_switching_gain / np.pi
    assert gains[0] - gains[1] == pytest.approx(relay / 1e-3 - relay / 1e-2, rel=1e-3)


def test_without_amplitude_the_law_is_linear():
    law = linear_law(MISSION, "ismc", 3, None)
    one = np.eye(3)
    sigma, mu, rate = MISSION.reaching_gain, MISSION.error_gain, MISSION.rate_gain
    assert_allclose(law.B, np.hstack([mu * one, rate * one]), rtol=ROUND_OFF)
    assert_allclose(law.D, -np.hstack([mu * one, (rate + sigma) * one]), rtol=ROUND_OFF)
    assert_allclose(law.C, -sigma * one, rtol=ROUND_OFF)


def test_pd_is_linear_at_any_amplitude():
    law = linear_law(MISSION, "pd", 1, Amplitude(error=1e-5))
    expected = [[-MISSION.proportional_gain, -MISSION.derivative_gain]]
    assert_allclose(law.D, expected, rtol=ROUND_OFF)


@pytest.mark.parametrize(("error", "omega"), [(0.0, 1.0), (1e-3, -1.0), (np.nan, 1.0)])
def test_amplitude_must_be_positive(error, omega):
    with pytest.raises(SimulationError, match=r"(error|omega) = .* must be a positive and finite number"):
        Amplitude(error=error, omega=omega)

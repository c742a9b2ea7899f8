"""Margins: known loops, and that the truss's loop is at its limit where they say."""

import re

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose

from trussflow.blocks.framework.errors import LinearAnalysisError
from trussflow.blocks.linear_analysis.margins import channel_disks, sensitivities
from trussflow.models.modal_analysis import (
    Amplitude,
    channel_margins,
    channel_responses,
    demand_margins,
    disk_margin,
    frequencies,
    modal_margins,
    response,
)

AMPLITUDE = Amplitude(error=1e-3)


@pytest.fixture(scope="module")
def loop(neutral_loop):
    return neutral_loop.loop(bandwidth=4.0, amplitude=AMPLITUDE)


@pytest.fixture(scope="module")
def omega(loop):
    return frequencies(loop)


@pytest.fixture(scope="module")
def margins(loop, omega):
    return demand_margins(loop, omega)


def rightmost(model, gain=1.0):
    """Return the rightmost pole of a loop closed with a gain."""
    values = np.linalg.eigvals(model.A - gain * model.B @ model.C)
    return complex(values[np.argmax(values.real)])


def test_margins_of_a_known_loop():
    """L = 1 / (s (s + 1)^2): gain margin 2, phase margin 21.39 degrees at 0.6823 rad/s."""
    model = control.tf([1], [1, 2, 1, 0])
    grid = np.geomspace(0.01, 100, 400)
    found = channel_margins(model(1j * grid), grid, "test")
    assert found.gain_up == pytest.approx(2.0, rel=1e-4)
    assert found.gain_down == 0.0
    assert found.phase == pytest.approx(21.386, rel=1e-3)
    assert found.crossover == pytest.approx(0.68233, rel=1e-4)
    assert found.delay == pytest.approx(np.radians(21.386) / 0.68233, rel=1e-3)
    scan = np.geomspace(0.1, 10, 20_000)
    assert found.disk == pytest.approx(control.disk_margins(model, scan)[0], rel=1e-6)


def test_nothing_comes_back():
    found = channel_margins(np.zeros(5, dtype=complex), np.arange(1.0, 6.0), "test")
    assert (found.gain_up, found.phase, found.disk) == (np.inf, np.inf, 2.0)


def test_sensitivity_gives_each_channel_with_the_others_closed(loop, omega):
    some = omega[omega > 0.3][::60]  # below, the loop gain is beyond round-off of 1 / (1 + L)
    each = channel_responses(sensitivities(loop.demand_loop, some))
    for k in (2, 5, 20):
        direct = response(loop.closed_but([k]), some)[:, 0, 0]
        assert_allclose(each[:, k], direct, rtol=1e-6, atol=1e-9)


def test_at_the_gain_margin_a_pole_is_on_the_axis(loop, margins):
    for k in (0, 2, 3, 5, 10):
        model = loop.closed_but([k])
        for gain in (margins[k].gain_down, margins[k].gain_up):
            if 0 < gain < np.inf:
                pole = rightmost(model, gain)
                assert abs(pole.real) < 2e-3 * abs(pole), margins[k]
        low, high = max(margins[k].gain_down, 0.01), min(margins[k].gain_up, 100.0)
        inside = np.geomspace(1.05 * low, 0.95 * high, 5)
        assert all(rightmost(model, gain).real < 0 for gain in inside), margins[k]


def test_gains_within_the_disk_keep_the_loop_stable(loop, omega, margins, rng):
    """All six at a time, at random; and the margin is no larger than that of any channel."""
    disk, gain, _, _ = disk_margin(loop.closed_but(range(6)), omega)
    assert disk <= min(m.disk for m in margins[:6]) + 1e-6
    model = loop.closed_but(range(6))
    for _ in range(40):
        factors = 10 ** (rng.uniform(-gain, gain, 6) / 20)
        values = np.linalg.eigvals(model.A - model.B @ np.diag(factors) @ model.C)
        assert values.real.max() < 0


def test_disk_margin_is_that_of_python_control(loop, omega):
    model = loop.closed_but([0, 1, 2])
    expected = control.disk_margins(model, omega)
    found = disk_margin(model, omega)
    assert found[0] <= expected[0]
    assert_allclose(found[:3], expected, rtol=1e-3)


def test_modal_margins_where_actuators_work_on_the_modes(published_loop):
    """With 10 % damping the published allocation is stable, mode by mode up to its margin."""
    loop = published_loop.loop(damping=0.1, modal_actuation=True)
    found = modal_margins(loop)
    assert [m.channel for m in found] == [f"mode_{k + 1}" for k in range(6)]
    for k, m in enumerate(found):
        model = loop.closed_but([loop.rigid + k])
        assert m.gain_up < np.inf
        pole = rightmost(model, m.gain_up)
        assert abs(pole.real) < 2e-3 * abs(pole)


@pytest.mark.parametrize(
    "margins_of",
    [
        demand_margins,
        modal_margins,
        lambda loop: disk_margin(loop.modal_loop, np.array([1.0])),
        lambda loop: channel_disks(loop.modal_loop, np.array([1.0])),
    ],
)
def test_an_unstable_loop_has_no_margins(published_loop, margins_of):
    """With 0.5 % damping the work of the actuators drives a mode; the message lists its poles."""
    loop = published_loop.loop(bandwidth=4.0, modal_actuation=True)
    pole = max(np.linalg.eigvals(loop.closed_matrix), key=lambda value: (value.real, value.imag))
    with pytest.raises(LinearAnalysisError, match=re.escape(f"unstable poles {pole:.4g}, ")):
        margins_of(loop)

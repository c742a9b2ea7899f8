"""Delays and control periods that a loop stands."""

import numpy as np
import pytest

from trussflow.models.modal_analysis import Amplitude, timing
from trussflow.models.modal_analysis.sampling import timing_rows


def test_held_pd_stands_two_over_its_fastest_rate(published_loop):
    """Held over a period, the fastest motion goes to 1 - |s| T of itself."""
    loop = published_loop.loop("pd")
    fastest = np.abs(np.linalg.eigvals(loop.closed_matrix)).max()
    found = timing("pd", loop, omega=np.geomspace(1e-2, 1e8, 400), points=60)
    assert found.period == pytest.approx(2 / fastest, rel=0.01)
    assert found.period_with_computing == pytest.approx(1 / fastest, rel=0.01)
    assert found.delay == pytest.approx(np.pi / 2 / fastest, rel=0.01)  # of k / s


def test_an_unstable_loop_stands_nothing(published_loop):
    found = timing("x", published_loop.loop(modal_actuation=True))
    assert (found.delay, found.period) == (0.0, 0.0)
    assert timing_rows([found])[0][1] == "unstable"


def test_an_observer_costs_delay(neutral_loop):
    amplitude = Amplitude(error=1e-3)
    omega = np.geomspace(0.1, 1e4, 300)
    slow, fast = (
        timing("x", neutral_loop.loop(bandwidth=L, amplitude=amplitude), omega=omega, points=20)
        for L in (None, 4.0)
    )
    assert 0 < fast.delay < slow.delay
    assert 0 < fast.period_with_computing < fast.period < slow.period

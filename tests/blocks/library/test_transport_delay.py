"""Transport delay: smooth signals, loops, every solver, and its approximant in linear models."""

from typing import Any

import numpy as np
import pytest

from trussflow.blocks import (
    BlockError,
    Diagram,
    Integrator,
    Session,
    Sine,
    Step,
    TransportDelay,
    linearize,
    simulate,
)

SMOOTH = 3e-5
"""Cubic interpolation of a sine of 1 Hz between steps of 0.01 s."""


def delayed_loop(gain: float, delay: float) -> Diagram:
    """Return dx/dt = -gain x(t - delay), x = 1 before."""
    d = Diagram("loop")
    x, late = d.add(x=Integrator(1.0), late=TransportDelay(delay, 1.0))
    x >> late
    (-gain * late.y) >> x
    return d


@pytest.mark.parametrize(
    "settings", [{"step": 0.01}, {"step": 0.01, "backend": "numpy"}, {"solver": "RK45", "rtol": 1e-9}]
)
def test_loop_with_a_delay_step_by_step(settings: dict[str, Any]) -> None:
    """By steps: 1 - t, then 1 - t + (t-1)^2/2, then with -(t-2)^3/6 besides."""
    result = simulate(delayed_loop(1.0, 1.0), 3.0, log_step=0.01, progress=False, **settings)
    t = result["time"].values
    exact = 1 - t + np.maximum(t - 1, 0) ** 2 / 2 - np.maximum(t - 2, 0) ** 3 / 6
    np.testing.assert_allclose(result["x.y"], exact, rtol=0, atol=SMOOTH)


@pytest.mark.parametrize("delay", [0.005, 0.1, 0.1234, 1.0])
def test_smooth_signal_comes_out_later(delay: float) -> None:
    d = Diagram("d")
    d.add("sine", Sine([1.0, 2.0])) >> d.add("late", TransportDelay(delay, [0.5, 0.5]))
    result = simulate(d, 2.0, step=0.01, progress=False)
    t = result["time"].values - delay
    exact = np.where(t[:, None] < 0.0, 0.5, np.outer(np.sin(2 * np.pi * t), [1.0, 2.0]))
    np.testing.assert_allclose(result["late.y"], exact, rtol=0, atol=SMOOTH)


def test_jump_comes_out_within_a_step() -> None:
    d = Diagram("d")
    d.add("step", Step(0.5)) >> d.add("late", TransportDelay(0.2))
    result = simulate(d, 1.0, step=0.01, progress=False)
    y = result["late.y"].values
    assert (abs(y[:69]) < 0.1).all()
    np.testing.assert_allclose(y[72:], 1.0, rtol=0, atol=1e-12)


def test_steps_are_no_longer_than_the_delay() -> None:
    """One of an adaptive solver, which would take the whole run at once."""
    d = delayed_loop(0.0, 0.1)
    d.add("sine", Sine()) >> d.add("other", TransportDelay(0.05))
    result = simulate(d, 2.0, solver="RK45", log_step=0.01, progress=False)
    exact = np.sin(2 * np.pi * (result["time"].values - 0.05))
    np.testing.assert_allclose(result["other.y"][6:], exact[6:], rtol=0, atol=1e-3)  # steps of 0.05 s


def test_session_goes_back() -> None:
    with Session(delayed_loop(1.0, 0.5), outputs=["x.y"], step=0.01) as session:
        session.advance(0.8)
        saved = session.save()
        session.advance(2.0)
        there = session.outputs["x.y"]
        session.restore(saved)
        session.advance(2.0)
        assert session.outputs["x.y"] == there


@pytest.mark.parametrize("delay", [1e-3, 0.5])
def test_linear_model_is_the_approximant(delay: float) -> None:
    model = linearize(TransportDelay(delay), ["u"], ["y"])
    omega = np.linspace(0.1, 2.5, 20) / delay
    found = np.array([model(1j * w) for w in omega]).ravel()
    np.testing.assert_allclose(found, np.exp(-1j * omega * delay), rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"delay": 0.0}, "'delay' of TransportDelay is 0; it must be above 0"),
        ({"delay": 1.0, "pade": 0}, "from 1 to 10"),
    ],
)
def test_nonsense_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(BlockError, match=message):
        TransportDelay(**arguments)
